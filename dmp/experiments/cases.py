"""What an experiment works on: a damaged mesh and its ground truth, read from files or made by this program."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from dmp.errors import MeshError, MeshFileError, SettingsError
from dmp.files import in_words
from dmp.mesh import TriangleMesh
from dmp.noise import NoiseKind, add_noise
from dmp.settings import Task

# Directions in which the holes lie that are cut into a mesh without any; the first faces the eye of the pictures.
_HOLE_DIRECTIONS = ((0.45, 0.35, 1.0), (-0.8, 0.3, 0.6))
# The paper's bumpy sphere lacks about 200 of its 5,724 vertices, in two holes.
_HOLE_SHARE = 0.0175


@dataclass(frozen=True)
class Case:
    """One mesh to restore and what the result should be.

    Attributes:
        name: how tables call it.
        truth: path of the clean mesh, or the name of a shape of :mod:`dmp.shapes.development` if ``is_shape``.
        is_shape: whether the clean mesh is made by this program.
        damaged: path of the damaged mesh; None when the damage is made here.
        task: whether it is noisy or has holes.
        noise: kind of noise that is added to the clean mesh; None for none.
        level: of that noise, mean edge lengths.
        noise_seed: of that noise.
        cut_holes: whether two holes are cut into the clean mesh.
        digest: of the contents of the files, so that a result belongs to what was read.
        n_vertices: about how many vertices there are, to foresee the time.
    """

    name: str
    truth: str
    is_shape: bool = False
    damaged: str | None = None
    task: Task = "denoise"
    noise: NoiseKind | None = None
    level: float = 0.0
    noise_seed: int = 1
    cut_holes: bool = False
    digest: str = ""
    n_vertices: int = 5000

    def description(self) -> dict[str, Any]:
        """Return what decides the meshes of this case, and not where their files lie."""
        names: dict[str, Any] = {"name": self.name, "task": self.task}
        names["clean"] = self.truth if self.is_shape else self.digest
        names["damaged"] = self.damaged is not None
        if self.noise is not None:
            names |= {"noise": self.noise, "level": self.level, "noise_seed": self.noise_seed}
        if self.cut_holes:
            names["holes"] = [list(_HOLE_DIRECTIONS), _HOLE_SHARE]
        return names

    def noisy(self, kind: NoiseKind, level: float, seed: int, name: str = "") -> Case:
        """Return the clean mesh of this case with noise of this program; a level of 0 leaves it clean."""
        plain = self.clean(name)
        return replace(plain, noise=kind, level=level, noise_seed=seed) if level else plain

    def clean(self, name: str = "") -> Case:
        """Return a case whose input is the clean mesh itself."""
        return replace(
            self, name=name or self.name, damaged=None, task="denoise", noise=None, level=0.0, noise_seed=1, cut_holes=False
        )

    def with_cut_holes(self) -> Case:
        """Return the clean mesh of this case with two holes cut into it."""
        return replace(self.clean(), task="complete", cut_holes=True)

    @property
    def damage(self) -> str:
        """What is wrong with the input, in words."""
        if self.damaged is not None:
            return "holes as in the file" if self.task == "complete" else "noise as in the file"
        if self.cut_holes:
            return "two holes cut into it"
        return "none" if self.noise is None else f"{self.noise} noise of level {self.level:g}, seed {self.noise_seed}"


def pair(name: str, damaged: Path, truth: Path) -> Case:
    """Return the case of two files; with the same faces it is about noise, otherwise about holes.

    Raises:
        MeshFileError: when one of them cannot be read.
    """
    is_denoising = _read(damaged).same_connectivity(_read(truth))
    return Case(
        name,
        str(truth),
        damaged=str(damaged),
        task="denoise" if is_denoising else "complete",
        digest=_digest(damaged, truth),
        n_vertices=_read(damaged).n_vertices,
    )


def clean_file(name: str, path: Path) -> Case:
    """Return the case of a clean mesh in a file (raises :class:`MeshFileError`)."""
    return Case(name, str(path), digest=_digest(path), n_vertices=_read(path).n_vertices)


def clean_shape(name: str) -> Case:
    """Return the case of one of the shapes that this program makes (raises :class:`SettingsError`)."""
    from dmp.shapes.development import DEVELOPMENT_SHAPES

    if name not in DEVELOPMENT_SHAPES:
        raise SettingsError(f"There is no shape named '{name}'. There are {', '.join(DEVELOPMENT_SHAPES)}.")
    return Case(name, name, is_shape=True)


def sample_case(name: str) -> Case:
    """Return the case of one of the samples that come with the program (raises :class:`MeshError`)."""
    from dmp.samples import sample

    found = sample(name)
    return pair(name, found.mesh_path, found.ground_truth_path)


def meshes_of(case: Case, folder: Path) -> tuple[TriangleMesh, TriangleMesh]:
    """Return the damaged mesh of a case and its ground truth.

    Args:
        case: which one.
        folder: where shapes are kept once they were made; some take half a minute.

    Raises:
        MeshError: when a file cannot be read any more, or was changed since the case was made.
    """
    return _meshes_of(case, str(folder))


@lru_cache(maxsize=2)
def _meshes_of(case: Case, folder: str) -> tuple[TriangleMesh, TriangleMesh]:
    from dmp.shapes.alterations import with_holes

    truth = _shape(case.truth, Path(folder)) if case.is_shape else _unchanged(case)
    if case.damaged is not None:
        return _read(Path(case.damaged)), truth
    if case.cut_holes:
        count = max(6, round(_HOLE_SHARE * truth.n_vertices))
        centres = [truth.vertices[(truth.vertices @ direction).argmax()] for direction in _HOLE_DIRECTIONS]
        return with_holes(truth, centres, [count] * len(centres)), truth
    if case.noise is not None:
        return add_noise(truth, case.level, case.noise, seed=case.noise_seed), truth
    return truth, truth


def _unchanged(case: Case) -> TriangleMesh:
    files = [Path(name) for name in (case.damaged, case.truth) if name is not None]
    # A noisy version made here is known by the digest of all files that its case came from.
    if case.damaged is not None and _digest(*files) != case.digest:
        raise MeshError(f"{case.damaged} or its ground truth was changed while the experiment ran. Start it again.")
    return _read(Path(case.truth))


def _shape(name: str, folder: Path) -> TriangleMesh:
    from dmp.meshio import read_mesh, write_mesh
    from dmp.shapes.development import DEVELOPMENT_SHAPES

    path = folder / f"{name}.ply"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_mesh(path, DEVELOPMENT_SHAPES[name]())
    # Read also when it was just made, so that first and later uses have the same digits.
    return read_mesh(path)


@lru_cache(maxsize=8)
def _read(path: Path) -> TriangleMesh:
    from dmp.meshio import read_mesh

    return read_mesh(path)


def _digest(*paths: Path) -> str:
    content = hashlib.sha256()
    for path in paths:
        try:
            content.update(hashlib.sha256(path.read_bytes()).digest())
        except OSError as error:
            raise MeshFileError(path, f"it cannot be read: {in_words(error)}", "Name another file.") from error
    return content.hexdigest()[:24]
