"""Meshes with hard holes go the whole way: filled and trained on, or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.completion import completion
from dmp.errors import MeshError
from dmp.methods import training_for
from dmp.settings import settings_for
from tests.dmp import holed_meshes

HARD = {
    "large and strongly curved": lambda: holed_meshes.sphere_without_cap(0.3),
    "several in one mesh": holed_meshes.sphere_with_six_holes,
    "a sheet with inner holes": holed_meshes.sheet_with_square_holes,
    "three that touch in a row": holed_meshes.touching_holes,
    "four that touch around a piece": holed_meshes.ring_of_touching_holes,
    "a tube cut open": holed_meshes.open_tube,
    "across a sharp edge": holed_meshes.cube_with_hole_across_an_edge,
    "a corner broken off": holed_meshes.cube_without_a_corner,
    "a ragged and noisy rim": holed_meshes.sphere_with_ragged_hole,
    "a winding slit": holed_meshes.sheet_with_winding_slit,
    "no free chord": holed_meshes.seven_vertex_torus_without_a_vertex,
    "an edge with three faces at the rim": holed_meshes.hole_with_a_fin,
    "a face the wrong way round": holed_meshes.hole_with_a_turned_face,
    "an unwelded seam": holed_meshes.sheet_with_unwelded_seam,
}


@pytest.mark.parametrize("preset", ["compact", "best"])
@pytest.mark.parametrize("name", HARD)
def test_hard_holes_are_completed_or_refused_with_a_reason(name: str, preset: str) -> None:
    mesh = HARD[name]()
    settings = settings_for("complete", preset, steps=6, log_every=3, snapshot_every=6, threads=1)
    try:
        problem = completion(mesh, settings)
        records = list(training_for(problem, settings).steps())
    except MeshError as error:
        assert str(error).endswith(".")
        assert len(str(error)) > 20
        return
    assert records[-1].snapshot is not None
    result = records[-1].snapshot.vertices
    assert np.isfinite(result).all()
    assert np.array_equal(result[problem.known], mesh.vertices)
    extent = np.ptp(mesh.vertices, axis=0).max()
    assert np.linalg.norm(result - problem.target, axis=1).max() < extent
