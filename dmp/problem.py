"""What to fit: the smoothed base, the target positions, which vertices are known, and the scale of training."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dmp.errors import MeshError
from dmp.geometry import face_areas, mean_edge_length
from dmp.hole_metrics import HoleTruth
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh, read_only
from dmp.metrics import GroundTruth
from dmp.seam import Seam
from dmp.settings import Settings, Task
from dmp.smoothing import smooth
from dmp.topology import connected_vertices, unique_edges


@dataclass(frozen=True, eq=False)
class Problem:
    """One restoration task, ready to be trained on.

    Attributes:
        task: ``"denoise"`` or ``"complete"``.
        mesh: the input; its connectivity is that of the result. For completion the mesh with its holes filled.
        base: smoothed positions S(y), (V, 3) float64, file units.
        known: (V,) bool, False for vertices that hole filling inserted.
        origin: the point that is 0 during training, (3,) float64, file units.
        unit: the length that is 1 during training, in file units: the mean edge length of the input, or the largest
            side of its bounding box.
        edge_length: mean edge length of the input, file units; the unit of every reported distance.
        ground_truth: what to compare the prediction with, or None.
        keep_known: whether the result leaves known vertices exactly where they were.
        notes: sentences for the user on what was done to set the problem up.
        n_input_faces: faces of the mesh as it was given; those after them were inserted by hole filling.
        whole: the problem that this one is the trainable part of, see :meth:`trainable_part`; None for a whole one.
        part: the vertices of ``whole`` that are here, (V,) int64, ascending; None for a whole problem.
    """

    task: Task
    mesh: TriangleMesh
    base: FloatArray
    known: BoolArray
    origin: FloatArray
    unit: float
    edge_length: float
    ground_truth: GroundTruth | HoleTruth | None = field(default=None)
    keep_known: bool = False
    notes: tuple[str, ...] = ()
    n_input_faces: int | None = None
    whole: Problem | None = None
    part: IntArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", read_only(self.base, np.float64))
        object.__setattr__(self, "known", read_only(self.known, np.bool_))
        object.__setattr__(self, "origin", read_only(self.origin, np.float64))

    @classmethod
    def from_base(
        cls,
        mesh: TriangleMesh,
        settings: Settings,
        *,
        base: FloatArray,
        known: BoolArray | None = None,
        ground_truth: TriangleMesh | None = None,
        notes: tuple[str, ...] = (),
        n_input_faces: int | None = None,
    ) -> Problem:
        """Set up a problem whose base is there already, choosing the scale that ``settings`` ask for.

        Args:
            mesh: the input.
            settings: task and scaling are taken from here.
            base: smoothed positions, (V, 3), file units.
            known: (V,) bool; None when every vertex is.
            ground_truth: the clean mesh, with the same connectivity; for a completion the complete one, with any.
            notes: sentences for the user.
            n_input_faces: faces before hole filling; None when it inserted none.

        Raises:
            MeshError: when the ground truth does not belong to the mesh, or no edge joins two different known places.
        """
        known = np.ones(mesh.n_vertices, dtype=bool) if known is None else known
        # Of the known part: what hole filling made of the rest is no measure of the scan.
        edges = unique_edges(mesh.faces[known[mesh.faces].all(axis=1)])
        edge_length = mean_edge_length(mesh.vertices, edges) if len(edges) else 0.0
        if edge_length <= 0:
            raise MeshError("The mesh has no edge of any length between known vertices, so it has no shape to learn.")
        truth: GroundTruth | HoleTruth | None = None
        if ground_truth is not None and settings.task == "complete":
            truth = HoleTruth.for_filled(ground_truth, mesh, known, edge_length)
        elif ground_truth is not None:
            truth = GroundTruth.for_input(ground_truth, mesh)
        # A stray vertex far away must not move the origin: around the surface no digits are lost.
        surface = mesh.vertices[connected_vertices(mesh.faces, mesh.n_vertices)]
        low, high = surface.min(axis=0), surface.max(axis=0)
        return cls(
            task=settings.task,
            mesh=mesh,
            base=base,
            known=known,
            origin=(low + high) / 2,
            unit=edge_length if settings.scaling == "edge" else float((high - low).max()),
            edge_length=edge_length,
            ground_truth=truth,
            keep_known=settings.task == "complete" and settings.known_vertices == "keep",
            notes=notes,
            n_input_faces=n_input_faces,
        )

    def trainable_part(self) -> Problem:
        """Return the problem without its isolated vertices, which have no neighbours to learn from; itself without any.

        Scale and origin stay. :meth:`placed` brings a prediction for the part back to all vertices.
        """
        connected = connected_vertices(self.mesh.faces, self.mesh.n_vertices)
        if connected.all():
            return self
        part = np.flatnonzero(connected)
        kept: BoolArray = np.asarray(connected[self.mesh.faces].all(axis=1))
        mesh = TriangleMesh(self.mesh.vertices[part], (np.cumsum(connected) - 1)[self.mesh.faces[kept]])
        truth = self.ground_truth
        if isinstance(truth, HoleTruth):
            truth = HoleTruth.for_filled(truth.mesh, mesh, self.known[part], self.edge_length)
        elif truth is not None:
            truth = truth.restricted(part, mesh.faces, kept)
        return replace(self, mesh=mesh, base=self.base[part], known=self.known[part], ground_truth=truth, whole=self, part=part)

    def placed(self, vertices: FloatArray) -> FloatArray:
        """Return predicted positions (V, 3) among those of the whole problem, whose isolated vertices stay in place."""
        if self.whole is None or self.part is None:
            return vertices
        everywhere = self.whole.target.copy()
        everywhere[self.part] = vertices
        return everywhere

    def exact(self, vertices: FloatArray) -> FloatArray:
        """Return positions (V, 3), kept in single precision meanwhile, with those that never move exactly in place."""
        fixed = ~connected_vertices(self.mesh.faces, self.mesh.n_vertices)
        if self.keep_known:
            fixed |= self.known
        if not fixed.any():
            return vertices
        restored = vertices.copy()
        restored[fixed] = self.target[fixed]
        return restored

    @property
    def target(self) -> FloatArray:
        """Positions of the input y, (V, 3) float64, file units."""
        return self.mesh.vertices

    def joined(self, predicted: FloatArray) -> FloatArray:
        """Return the result for predicted positions, (V, 3), file units: with known vertices in place if they are kept."""
        return self._seam.apply(predicted) if self.keep_known else predicted

    @cached_property
    def _seam(self) -> Seam:
        return Seam(self.mesh, self.known)

    def to_training_units(self, positions: FloatArray) -> FloatArray:
        """Map positions of the file into the units of the training."""
        return (positions - self.origin) / self.unit

    def to_file_units(self, positions: FloatArray) -> FloatArray:
        """Map positions of the training back into the units and place of the file."""
        return np.asarray(positions, dtype=np.float64) * self.unit + self.origin


def check_trainable(mesh: TriangleMesh) -> None:
    """Refuse a mesh that the method cannot work on.

    Raises:
        MeshError: in one or two sentences, when there are no faces, most faces have no area, or the extent is zero or
            beyond what double precision carries. Isolated vertices are left out of the training and stay in place.
    """
    if mesh.n_faces == 0:
        raise MeshError(
            "The mesh has no faces. A point cloud has to be turned into a triangle mesh first, for example in MeshLab."
        )
    used = connected_vertices(mesh.faces, mesh.n_vertices)
    if not used.any():
        raise MeshError("No face of the mesh has three different corners, so it has no shape to learn.")
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices[used], axis=0)))
    if not 1e-12 <= diagonal <= 1e12:
        raise MeshError(f"The mesh is {diagonal:.3g} units large; sizes from 1e-12 to 1e12 can be worked with. Scale it first.")
    flat = np.count_nonzero(face_areas(mesh.vertices, mesh.faces) <= 1e-14 * diagonal**2)
    if flat > mesh.n_faces / 2:
        raise MeshError(f"{flat} of {mesh.n_faces} faces have no area, so the mesh has no shape to learn.")


def denoising(mesh: TriangleMesh, settings: Settings, ground_truth: TriangleMesh | None = None) -> Problem:
    """Set up the denoising of ``mesh`` (paper, section 4.1): every vertex is known, the base is the smoothed input.

    Args:
        mesh: the noisy mesh.
        settings: smoothing and scaling are taken from here.
        ground_truth: the clean mesh, with the same connectivity; only for measuring.

    Raises:
        MeshError: when the mesh cannot be trained on or the ground truth does not belong to it.
    """
    check_trainable(mesh)
    return Problem.from_base(
        mesh, settings, base=smooth(mesh, settings.smoothing, settings.smoothing_steps), ground_truth=ground_truth
    )
