from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import dmp.samples as module
from dmp.errors import MeshError
from dmp.geometry import mean_edge_length, vertex_normals
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh_with_notes
from dmp.samples import HOLE_SIZES, MANIFEST, SAMPLES, SampleEntry, assets_folder, main, sample, samples, write_samples
from dmp.shapes.separation import is_closed_surface
from dmp.topology import topology_report, unique_edges

NOISY = [entry for entry in SAMPLES if entry.noise is not None]
CLEAN_FILES = sorted({entry.ground_truth for entry in SAMPLES})


def read(file: str) -> TriangleMesh:
    mesh, notes = read_mesh_with_notes(assets_folder() / file)
    assert notes == ()
    return mesh


def test_the_manifest_says_what_the_program_says() -> None:
    manifest = json.loads((assets_folder() / MANIFEST).read_text())
    assert manifest == {"samples": [asdict(entry) for entry in SAMPLES]}


def test_all_samples_are_there_small_and_described() -> None:
    found = samples()
    assert [one.name for one in found] == ["bumpy-sphere", "fan-block", "dinosaur", "holed-bumpy-sphere"]
    assert [one.task for one in found] == ["denoise", "denoise", "denoise", "complete"]
    for one in found:
        assert one.mesh_path.stat().st_size < 1_000_000
        assert one.ground_truth_path.stat().st_size < 1_000_000
        assert one.title
        assert one.description.endswith(".")


@pytest.mark.parametrize(("file", "euler"), [("bumpy-sphere.ply", 2), ("dinosaur.ply", 2), ("fan-block.ply", -4)])
def test_ground_truths_are_closed_and_even(file: str, euler: int) -> None:
    mesh = read(file)
    report = topology_report(mesh)
    edges = unique_edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    assert is_closed_surface(mesh.faces, mesh.n_vertices)
    assert (report.euler_characteristic, report.components) == (euler, 1)
    assert 5000 < mesh.n_vertices < 9000
    assert report.valence_mean == pytest.approx(6, abs=0.01)
    assert lengths.std() / lengths.mean() < 0.17
    # The convex hull would have been larger: outward faces enclose a positive volume.
    centroids, area_vectors = mesh.vertices[mesh.faces].mean(axis=1), _area_vectors(mesh)
    assert 0 < (centroids * area_vectors).sum() / 3 < np.prod(np.ptp(mesh.vertices, axis=0))


def _area_vectors(mesh: TriangleMesh) -> np.ndarray:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def test_there_is_a_ground_truth_for_each_sample() -> None:
    assert CLEAN_FILES == ["bumpy-sphere.ply", "dinosaur.ply", "fan-block.ply"]


@pytest.mark.parametrize("entry", NOISY, ids=lambda entry: entry.name)
def test_noisy_samples_differ_from_their_truth_by_the_noise_of_the_manifest(entry: SampleEntry) -> None:
    noisy, clean = read(entry.mesh), read(entry.ground_truth)
    assert noisy.same_connectivity(clean)
    moved = (noisy.vertices - clean.vertices) / mean_edge_length(clean.vertices, unique_edges(clean.faces))
    if entry.noise == "normal":
        normals = vertex_normals(clean.vertices, clean.faces)
        moved = (moved * normals).sum(axis=1)
    assert moved.std() == pytest.approx(entry.level, rel=0.04)


def test_the_holed_sphere_is_part_of_the_whole_with_two_holes() -> None:
    holed, whole = read("holed-bumpy-sphere.ply"), read("bumpy-sphere.ply")
    known = {tuple(point) for point in whole.vertices.tolist()}
    assert all(tuple(point) in known for point in holed.vertices.tolist())
    assert whole.n_vertices - holed.n_vertices == sum(HOLE_SIZES) == 200
    report = topology_report(holed)
    assert (report.euler_characteristic, report.components, report.unreferenced_vertices) == (0, 1, 0)
    assert not report.is_closed


def test_the_fan_block_has_truly_sharp_edges() -> None:
    mesh = read("fan-block.ply")
    normals = _area_vectors(mesh) / np.linalg.norm(_area_vectors(mesh), axis=1, keepdims=True)
    owners: dict[tuple[int, int], list[int]] = {}
    for index, face in enumerate(mesh.faces.tolist()):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            owners.setdefault((min(a, b), max(a, b)), []).append(index)
    angles = np.degrees(np.arccos(np.clip([normals[i] @ normals[j] for i, j in owners.values()], -1, 1)))
    # Right angles along flange, floor and bores are many; between smooth and sharp there is almost nothing.
    assert np.count_nonzero(np.abs(angles - 90) < 8) > 500
    assert np.count_nonzero(angles > 30) < 0.08 * len(angles)
    assert np.count_nonzero((angles > 25) & (angles < 35)) < 0.002 * len(angles)
    # The flat floor is flat to the last digits.
    floor = mesh.vertices[np.abs(mesh.vertices[:, 2] + 0.45) < 1e-3]
    assert len(floor) > 800
    np.testing.assert_allclose(floor[:, 2], -0.45, atol=1e-12)


def test_making_the_samples_again_gives_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "assets"
    assert main(["--out", str(folder)]) == 0
    made = sorted(path.name for path in folder.iterdir())
    assert made == sorted({MANIFEST, *(entry.mesh for entry in SAMPLES), *CLEAN_FILES})
    assert capsys.readouterr().out.count("\n") == len(made)
    for file in made:
        if file == MANIFEST:
            assert (folder / file).read_bytes() == (assets_folder() / file).read_bytes()
            continue
        again, kept = read_mesh_with_notes(folder / file)[0], read(file)
        assert np.array_equal(again.faces, kept.faces), file
        # The last bits of sine and square root differ between processors and libraries.
        np.testing.assert_allclose(again.vertices, kept.vertices, rtol=0, atol=1e-12, err_msg=file)


def test_an_unknown_sample_and_a_missing_file_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MeshError, match=r"'teapot'.*bumpy-sphere"):
        sample("teapot")
    monkeypatch.setattr(module, "assets_folder", lambda: tmp_path)
    with pytest.raises(MeshError, match=r"bumpy-sphere-noisy\.ply.*python -m dmp.samples"):
        sample("bumpy-sphere")


def test_the_folder_is_found_in_a_package_before_the_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "dmp"
    package.mkdir()
    monkeypatch.setattr(module, "__file__", str(package / "samples.py"))
    with pytest.raises(MeshError, match="missing"):
        assets_folder()
    (tmp_path / "assets").mkdir()
    assert assets_folder() == tmp_path / "assets"
    (package / "assets").mkdir()
    assert assets_folder() == package / "assets"


def test_a_folder_that_cannot_be_made_ends_the_command_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    assert main(["--out", str(blocker / "below")]) == 2
    assert "file" in capsys.readouterr().err
    with pytest.raises(OSError, match="file"):
        write_samples(blocker / "below")
