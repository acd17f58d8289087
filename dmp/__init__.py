"""Deep Mesh Prior: restore one damaged triangle mesh with nothing but that mesh.

A graph convolutional network is trained on a single mesh to predict the displacement of each vertex from a smoothed copy
(Hattori et al. 2021). Stopped in time, it has learnt the shape and not yet the noise.

Example:
    >>> import dmp
    >>> settings = dmp.settings_for("denoise", steps=500)
    >>> problem = dmp.denoising(dmp.read_mesh("scan.ply"), settings)
    >>> for snapshot in dmp.train(problem, settings):
    ...     print(snapshot.step, snapshot.metrics["held_out_error"])
    >>> dmp.write_mesh("clean.ply", problem.mesh.with_vertices(snapshot.vertices))
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# The names are looked up when they are used, because torch takes seconds to import and `--help` needs none of it.
_HOME = {
    "DmpError": "errors",
    "MeshError": "errors",
    "MeshFileError": "errors",
    "NoHolesError": "errors",
    "RunError": "errors",
    "SettingsError": "errors",
    "TrainingError": "errors",
    "TriangleMesh": "mesh",
    "read_mesh": "meshio",
    "read_mesh_with_notes": "meshio",
    "write_mesh": "meshio",
    "mean_angular_difference": "metrics",
    "add_noise": "noise",
    "Problem": "problem",
    "denoising": "problem",
    "completion": "completion",
    "fill_holes": "holes",
    "boundary_loops": "boundary",
    "Run": "runs",
    "list_runs": "runs",
    "record": "runs",
    "Settings": "settings",
    "settings_for": "settings",
    "smooth": "smoothing",
    "Snapshot": "snapshot",
    "StepRecord": "snapshot",
    "suggest": "stopping",
    "Training": "training",
    "train": "methods",
    "training_for": "methods",
}

__all__ = [*sorted(_HOME), "__version__"]  # noqa: PLE0604

if TYPE_CHECKING:
    from dmp.boundary import boundary_loops
    from dmp.completion import completion
    from dmp.errors import DmpError, MeshError, MeshFileError, NoHolesError, RunError, SettingsError, TrainingError
    from dmp.holes import fill_holes
    from dmp.mesh import TriangleMesh
    from dmp.meshio import read_mesh, read_mesh_with_notes, write_mesh
    from dmp.methods import train, training_for
    from dmp.metrics import mean_angular_difference
    from dmp.noise import add_noise
    from dmp.problem import Problem, denoising
    from dmp.runs import Run, list_runs, record
    from dmp.settings import Settings, settings_for
    from dmp.smoothing import smooth
    from dmp.snapshot import Snapshot, StepRecord
    from dmp.stopping import suggest
    from dmp.training import Training


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(f"dmp.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'dmp' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
