"""From settings to the training that they name."""

from __future__ import annotations

from collections.abc import Iterator

from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.made_up_holes.training import MadeUpHoles
from dmp.memory_needs import check_memory
from dmp.problem import Problem
from dmp.recorrupted.training import RecorruptedTraining
from dmp.settings import Settings
from dmp.snapshot import Snapshot
from dmp.training import Training


def training_for(problem: Problem, settings: Settings, *, run_id: str | None = None) -> Training:
    """Return a fresh training of the method that ``settings`` name, of all vertices that have neighbours.

    Raises:
        SettingsError: when the method cannot do what the settings say, or the memory will not do.
        MeshError: when the mesh gives the method nothing to learn from.
    """
    problem = problem.trainable_part()
    check_memory(settings, problem.mesh.n_vertices)
    if settings.method == "made-up-holes":
        return MadeUpHoles(problem, settings, run_id=run_id)
    if settings.method == "recorrupted":
        return RecorruptedTraining(problem, settings, run_id=run_id)
    return DeepMeshPrior(problem, settings, run_id=run_id)


def train(problem: Problem, settings: Settings) -> Iterator[Snapshot]:
    """Train on one problem and yield a snapshot at step 0, every ``settings.snapshot_every`` steps and at the end.

    Example:
        >>> settings = settings_for("denoise", steps=200)
        >>> for snapshot in train(denoising(read_mesh("noisy.ply"), settings), settings):
        ...     print(snapshot.step, snapshot.metrics["data_loss"])
    """
    for record in training_for(problem, settings).steps():
        if record.snapshot is not None:
            yield record.snapshot
