"""Reading GLB and glTF: every way of storing the same mesh gives the same mesh; what is damaged or elsewhere is refused."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.dmp.formats.containers import Gltf, pack_glb, simple_gltf
from tests.dmp.formats.files import SQUARE_FACES, SQUARE_VERTICES, read, refusal
from tests.meshes import sphere_mesh

SINGLE = np.float32(SQUARE_VERTICES).astype(float)
UNIT = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def square_with(**primitive: Any) -> Gltf:
    """The square without faces; ``primitive`` tells them."""
    file = Gltf()
    mesh = file.mesh({"attributes": {"POSITION": file.accessor(SQUARE_VERTICES, "f4")}, **primitive})
    return file.scene({"mesh": mesh})


def faces_as(code: str) -> Gltf:
    return simple_gltf(SQUARE_VERTICES, SQUARE_FACES, code)


def strip() -> Gltf:
    file = square_with(mode=5)
    file.document["meshes"][0]["primitives"][0]["indices"] = file.accessor([1, 2, 0, 3], "u1")
    return file


def fan() -> Gltf:
    return square_with(mode=6)


def interleaved() -> Gltf:
    """Positions and normals in turn, with a stride."""
    file = Gltf()
    rows = np.concatenate([np.float32(SQUARE_VERTICES), np.zeros((4, 3), np.float32)], axis=1)
    view = file.view(b"\xff" * 8 + rows.tobytes(), byteStride=24)
    file.document["accessors"] += [
        {"bufferView": view, "byteOffset": 8 + shift, "componentType": 5126, "count": 4, "type": "VEC3"} for shift in (0, 12)
    ]
    mesh = file.mesh({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": file.accessor(np.ravel(SQUARE_FACES), "u2")})
    return file.scene({"mesh": mesh})


def sparse(base: bool) -> Gltf:
    """All positions but the first replaced one by one, on wrong ones or on nothing."""
    file = Gltf()
    position = file.accessor(np.full((4, 3), 7.0) if base else np.zeros((4, 3)), "f4")
    entry = file.document["accessors"][position]
    if not base:
        del entry["bufferView"]
    values = file.view(np.float32(SQUARE_VERTICES).tobytes())
    entry["sparse"] = {
        "count": 4,
        "indices": {"bufferView": file.view(np.arange(4, dtype="<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": values},
    }
    mesh = file.mesh({"attributes": {"POSITION": position}, "indices": file.accessor(np.ravel(SQUARE_FACES), "u1")})
    return file.scene({"mesh": mesh})


def shared_vertices() -> Gltf:
    """Two primitives, a face each, with the same positions."""
    file = Gltf()
    position = file.accessor(SQUARE_VERTICES, "f4")
    primitives = [{"attributes": {"POSITION": position}, "indices": file.accessor(face, "u1")} for face in SQUARE_FACES]
    return file.scene({"mesh": file.mesh(*primitives)})


def with_seam() -> Gltf:
    """The vertices 0 and 2 twice, as a texture seam makes them."""
    file = Gltf()
    position = file.accessor([*SQUARE_VERTICES, SQUARE_VERTICES[0], SQUARE_VERTICES[2]], "f4")
    texture = file.accessor(np.linspace(0, 1, 12).reshape(6, 2), "f4")
    primitive = {
        "attributes": {"POSITION": position, "TEXCOORD_0": texture},
        "indices": file.accessor([0, 1, 2, 4, 5, 3], "u1"),
    }
    return file.scene({"mesh": file.mesh(primitive)})


@pytest.mark.parametrize(
    "file",
    [
        *(faces_as(code) for code in ("u1", "u2", "u4")),
        *(strip(), fan(), interleaved(), sparse(True), sparse(False), shared_vertices(), with_seam()),
    ],
)
@pytest.mark.parametrize("as_text", [False, True])
def test_the_same_square_in_every_layout(tmp_path: Path, file: Gltf, as_text: bool) -> None:
    mesh, _ = read(tmp_path, "a.gltf" if as_text else "a.glb", file.text() if as_text else file.glb())
    np.testing.assert_array_equal(mesh.vertices, SINGLE)
    assert sorted(tuple(np.roll(face, -int(np.argmin(face)))) for face in mesh.faces.tolist()) == [(0, 1, 2), (0, 2, 3)]


def test_seams_are_joined_in_the_order_of_the_file_with_a_note(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.glb", with_seam().glb())
    assert mesh.faces.tolist() == SQUARE_FACES
    assert notes == (
        "Texture coordinates, normals and the like of the file were left out.",
        "Joined 6 vertices, some of them at the same place, into 4.",
    )
    assert read(tmp_path, "b.glb", faces_as("u1").glb())[1] == ()


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_text_encodings(tmp_path: Path, encoding: str) -> None:
    mesh, _ = read(tmp_path, "a.gltf", faces_as("u1").text().decode().encode(encoding))
    assert mesh.faces.tolist() == SQUARE_FACES


def test_nodes_place_meshes(tmp_path: Path) -> None:
    file = simple_gltf(UNIT, SQUARE_FACES)
    half = float(np.sqrt(0.5))
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0], "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0, half, half]},  # a quarter turn about z
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},  # mirrored, then moved along z
    ]
    mesh, _ = read(tmp_path, "a.glb", file.scene(*nodes, roots=[0]).glb())
    points = np.array(UNIT, dtype=float)
    turned = np.stack([-points[:, 1], points[:, 0], points[:, 2]], axis=1)
    mirrored = points * [-1, 1, 1] + [0, 0, 5]
    np.testing.assert_allclose(mesh.vertices, np.concatenate([turned, mirrored]) * 2 + [10, 0, 0], atol=1e-12)
    # The mirrored square still looks along z.
    normals = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    assert (normals[:, 2] > 0).all()


def test_places_are_exact_in_double_precision(tmp_path: Path) -> None:
    file = simple_gltf(UNIT, SQUARE_FACES).scene({"mesh": 0, "translation": [1e7 + 0.1, 0, 0]})
    mesh, _ = read(tmp_path, "a.glb", file.glb())
    assert mesh.vertices[:, 0].tolist() == [1e7 + 0.1, 1e7 + 1.1, 1e7 + 1.1, 1e7 + 0.1]


def test_colours(tmp_path: Path) -> None:
    for code, values, expected in (
        ("u1", [[0, 51, 255, 255]] * 4, np.uint8),
        ("u2", [[0, 51, 65535]] * 4, np.uint16),
        ("f4", [[0, 0.25, 1]] * 4, np.float32),
    ):
        file = faces_as("u1")
        colour = file.accessor(values, code, normalized=code != "f4")
        file.document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colour
        mesh, notes = read(tmp_path, "a.glb", file.glb())
        assert mesh.vertex_attributes["color"].dtype == expected
        assert mesh.vertex_attributes["color"].tolist() == values
        assert notes == ()


def test_quantised_positions(tmp_path: Path) -> None:
    file = Gltf()
    position = file.accessor([[0, 0, 0], [32767, 0, 0], [32767, -32767, 0], [-32768, 1, 0]], "i2", normalized=True)
    mesh_number = file.mesh({"attributes": {"POSITION": position}, "indices": file.accessor(np.ravel(SQUARE_FACES), "u1")})
    file.scene({"mesh": mesh_number})
    assert "component type 5122" in refusal(tmp_path, "a.glb", file.glb())
    file.document["extensionsRequired"] = file.document["extensionsUsed"] = ["KHR_mesh_quantization"]
    mesh, _ = read(tmp_path, "b.glb", file.glb())
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, -1, 0], [-1, 1 / 32767, 0]]


def test_what_is_left_out_is_told(tmp_path: Path) -> None:
    file = faces_as("u1")
    file.document["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 3)]
    file.document["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    file.mesh({"attributes": {"POSITION": 0}})
    file.document["scenes"].append({"nodes": []})
    file.document["nodes"][0]["skin"] = 0
    file.document["nodes"][0]["translation"] = [5, 5, 5]
    mesh, notes = read(tmp_path, "a.glb", file.glb())
    np.testing.assert_array_equal(mesh.vertices, SINGLE)
    assert notes == (
        "Read scene 0 of 2; the others were left out.",
        "The mesh hangs on a skeleton; it was read as it is without it.",
        "Left out 1 mesh that the scene does not show.",
        "Left out 1 set of points.",
        "Left out 2 sets of lines.",
        "Further shapes of the mesh (morph targets) were left out.",
    )


def test_files_without_scenes_or_nodes(tmp_path: Path) -> None:
    file = faces_as("u1")
    del file.document["scenes"], file.document["scene"]
    file.document["nodes"] = [{"mesh": 0, "translation": [0, 0, 1]}, {"children": [0]}]
    assert read(tmp_path, "a.glb", file.glb())[0].vertices[0, 2] == 1
    del file.document["nodes"]
    mesh, notes = read(tmp_path, "b.glb", file.glb())
    np.testing.assert_array_equal(mesh.vertices, SINGLE)
    assert notes == ("The file places its meshes nowhere; all were read as they are.",)


def test_positions_beyond_the_limits_that_the_file_tells_are_noted(tmp_path: Path) -> None:
    file = faces_as("u1")
    file.document["accessors"][0]["max"] = [1.0, 0.5, 0.001]
    assert "may be damaged" in read(tmp_path, "a.glb", file.glb())[1][0]


@pytest.mark.parametrize(
    ("path", "key"),
    [
        (("nodes", 0), "tranzlation"),
        (("meshes", 0), "primitve"),
        (("meshes", 0, "primitives", 0), "indics"),
        (("accessors", 0), "byteOfset"),
        (("bufferViews", 1), "byteStrid"),
        (("scenes", 0), "node"),
    ],
)
def test_keys_that_may_be_damaged_are_noted(tmp_path: Path, path: tuple, key: str) -> None:
    file = faces_as("u1")
    target: Any = file.document
    for part in path:
        target = target[part]
    target[key] = 0
    assert f"Ignored '{key}'" in read(tmp_path, "a.glb", file.glb())[1][0]
    del target[key]
    target["extras"] = target["extensions"] = {key: 0}
    assert read(tmp_path, "b.glb", file.glb())[1] == ()


def test_trimesh_reads_the_same_from_its_own_scenes(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    sphere = sphere_mesh(2)
    part = trimesh.Trimesh(sphere.vertices, sphere.faces, process=False)
    scene.add_geometry(part, transform=trimesh.transformations.rotation_matrix(1, [1, 2, 3], [4, 5, 6]))
    scene.add_geometry(trimesh.creation.box(), transform=np.diag([1.0, 2.0, 3.0, 1.0]))
    content = scene.export(file_type="glb")
    mesh, _ = read(tmp_path, "a.glb", content)
    other = trimesh.load(tmp_path / "a.glb", process=False).to_mesh()
    assert (mesh.n_vertices, mesh.n_faces) == (len(other.vertices), len(other.faces))
    # The parts come in another order.
    soups = [
        np.sort(points[faces].reshape(-1, 9).round(5), axis=0)
        for points, faces in ((mesh.vertices, mesh.faces), (other.vertices, other.faces))
    ]
    np.testing.assert_allclose(*soups, atol=2e-5)


# -------------------------------------------------------------------------------------------------------------- refusals


def changed(**changes: Any) -> bytes:
    """The square with entries of its JSON replaced; the key "accessors_0_count" goes to accessors[0]["count"]."""
    file = faces_as("u1")
    document = {**file.document, "buffers": [{"byteLength": len(file.binary)}]}
    document = json.loads(json.dumps(document))
    for key, value in changes.items():
        target: Any = document
        *path, last = (int(part) if part.isdigit() else part for part in key.split("__"))
        for part in path:
            target = target[part]
        if value is None:
            del target[last]
        else:
            target[last] = value
    return pack_glb(document, file.binary)


GOOD = changed()


def test_the_unchanged_file_is_good(tmp_path: Path) -> None:
    assert read(tmp_path, "a.glb", GOOD)[1] == ()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (changed(accessors__0__count=5), "5 elements take 60 bytes, but buffer view 0 has 48"),
        (changed(accessors__0__count=2**40), "but buffer view 0 has 48"),
        (changed(accessors__0__count=0), "'count' is 0"),
        (changed(accessors__0__count=-1), "accessor 0: 'count' is not a whole number"),
        (changed(accessors__0__count=True), "accessor 0: 'count' is not a whole number"),
        (changed(accessors__0__count=None), "accessor 0: 'count' is missing"),
        (changed(accessors__0__bufferView=9), "'bufferViews' has 2 entries, but number 9"),
        (changed(accessors__0__byteOffset=4), "4 elements take 52 bytes"),
        (changed(accessors__0__componentType=5130), "of 5130 is unknown"),
        (changed(accessors__0__componentType=5123), "positions are of the component type 5123"),
        (changed(accessors__0__type="VEC2"), "must be of the type 'VEC3'"),
        (
            changed(accessors__0__bufferView=None, accessors__0__count=10**9),
            "elements are declared without any data",
        ),
        (changed(accessors__0__bufferView=None), "no face has three different corners"),
        (changed(accessors__1__componentType=5120), "must be whole numbers without sign"),
        (changed(accessors__1__count=5), "5 corners are not whole triangles"),
        (changed(bufferViews__0__byteLength=10**9), "of a buffer that has 54"),
        (changed(bufferViews__0__byteOffset=50), "takes the bytes 50 to 98"),
        (changed(bufferViews__0__byteStride=4), "elements of 12 bytes stand every 4 bytes"),
        (changed(buffers__0__byteLength=10**12), "tells that it has 1,000,000,000,000 bytes"),
        (
            changed(buffers__0__uri="scene.bin"),
            "in another file, 'scene.bin', which is not opened. Export the mesh as GLB",
        ),
        (changed(buffers__0__uri="file:///etc/passwd"), "lies in another file, 'file:///etc/passwd'"),
        (changed(buffers__0__uri="http://localhost/a.bin"), "lies in another file"),
        (changed(buffers__0__uri="data:,abc"), "in a form that is not base64"),
        (changed(buffers__0__uri="data:x;base64,!!!!"), "the base64 data of buffer 0 is damaged"),
        (changed(buffers__0__uri="data:x;base64,AAAA"), "tells that it has 54 bytes, but there are 3"),
        (changed(asset__version="1.0"), "glTF of version 1.0"),
        (changed(asset__minVersion="2.1"), "glTF of version 2.0"),
        (changed(asset=None), "glTF of version missing"),
        (changed(meshes=[]), "holds no meshes"),
        (changed(meshes__0__primitives__0__mode=9), "the mode 9 is unknown"),
        (changed(meshes__0__primitives__0__mode=0), "holds no faces (1 point cloud"),
        (changed(meshes__0__primitives__0__attributes={}), "mesh 0, primitive 0 has no positions"),
        (changed(meshes__0__primitives=[]), "mesh 0 has no primitives"),
        (changed(meshes__0__primitives__0__attributes__POSITION=7), "'accessors' has 2 entries, but number 7"),
        (changed(meshes__0__primitives__0__indices="x"), "'indices' is not a whole number"),
        (changed(nodes__0__mesh=3), "'meshes' has 1 entries, but number 3"),
        (changed(nodes__0__children=[0]), "scene names node 0, which is the child of another node"),
        (changed(nodes__0__children=[5]), "has the child 5, but there are 1 nodes"),
        (changed(nodes=[{"mesh": 0}, {"children": [0]}, {"children": [0]}]), "node 0 has two parents"),
        (changed(nodes=[{"mesh": 0}, {"children": [2]}, {"children": [1]}], scenes__0__nodes=[1]), "child of another node"),
        (changed(scenes__0__nodes=[0, 0]), "names a node twice"),
        (changed(scenes__0__nodes=[1]), "names node 1, but there are 1"),
        (changed(scenes__0__nodes=[]), "shows no mesh"),
        (changed(nodes__0__matrix=[1] * 15), "'matrix' is not a list of 16 finite numbers"),
        (changed(nodes__0__matrix=[1e300] * 12 + [0, 0, 0, 1]), "last row of its matrix"),
        (changed(nodes__0__scale=[1e300, 1e300, 1e300], nodes__0__translation=[1, 2, 3]), "absurd|range of numbers"),
        (changed(nodes__0__scale=[0, 0, 0]), "no face has three different corners"),
        (changed(nodes__0__rotation=[0, 0, 0, 0]), "no unit quaternion"),
        (changed(nodes__0__translation=[10**400, 0, 0]), "'translation' is not a list of 3 finite numbers"),
        (changed(extensionsRequired=["VENDOR_thing"]), "without the extension 'VENDOR_thing'"),
        (changed(bufferViews__0__extensions={"EXT_meshopt_compression": {}}), "compressed with meshopt"),
        (
            changed(meshes__0__primitives__0__extensions={"KHR_draco_mesh_compression": {}}, accessors__0__bufferView=None),
            "compressed with Draco",
        ),
        (changed(nodes__0__extensions={"EXT_mesh_gpu_instancing": {}}), "repeats its mesh with EXT_mesh_gpu_instancing"),
        (GOOD[:-1], f"tells that the file has {len(GOOD):,} bytes, but it has {len(GOOD) - 1:,}"),
        (GOOD[:15], "ends after 15 bytes"),
        (GOOD + b"more", "follow after the end that the header tells"),
        (GOOD[:4] + b"\1" + GOOD[5:], "version 1; version 2 can be read"),
        (GOOD[:12] + b"\xff\xff\xff\x7f" + GOOD[16:], "byte 12: a chunk of 2,147,483,647 bytes goes beyond the end"),
        (GOOD[:16] + b"BIN\0" + GOOD[20:], "first chunk of the GLB file is not its JSON"),
        (GOOD[:20] + b"!" + GOOD[21:], "byte 20: the JSON text of the GLB file is damaged"),
        (GOOD[:20] + b"\xff" + GOOD[21:], "is no UTF-8 text (byte 20)"),
        (pack_glb(b"[]", b""), "is no JSON object"),
        (pack_glb(b'{"a": 1, "a": 2}', b""), "gives 'a' twice"),
        (pack_glb(b'{"a": NaN}', b""), "holds 'NaN'"),
        (pack_glb(b'{"a": ' + b"1" * 5000 + b"}", b""), "a number that is too long"),
        (pack_glb(b'{"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", b""), "nested too deeply"),
        (pack_glb(b'{"a": [' + b"0," * 1_100_000 + b"0]}", b""), "more than 1,000,000 values"),
        (b'{"asset": {"version": "2.0"},\n "meshes": [}', "line 2, column 13: the glTF text is damaged"),
        (b'{"asset": {"version": "2.0"}, "meshes": []}\0', "zero byte at byte 43"),
    ],
)
def test_refusals(tmp_path: Path, content: bytes, expected: str) -> None:
    text = refusal(tmp_path, "a.glb", content)
    assert any(part in text for part in expected.split("|"))


def test_numbers_that_are_not_finite_are_told_with_their_byte(tmp_path: Path) -> None:
    place = len(GOOD) - 56 + 12  # the second position
    damaged = GOOD[:place] + struct.pack("<f", np.nan) + GOOD[place + 4 :]
    assert f"byte {place:,}: position 1 of accessor 0" in refusal(tmp_path, "a.glb", damaged)


def test_an_index_out_of_range_is_refused(tmp_path: Path) -> None:
    place = len(GOOD) - 8 + 3
    text = refusal(tmp_path, "a.glb", GOOD[:place] + b"\4" + GOOD[place + 1 :])
    assert "mesh 0, primitive 0: corner 3 refers to vertex 4, but there are vertices 0 to 3" in text


def test_other_files_are_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "scene.bin")  # opening it would wait for ever
    os.mkfifo(tmp_path / "picture.png")
    file = faces_as("u1")
    text = json.dumps({**file.document, "buffers": [{"byteLength": len(file.binary), "uri": "scene.bin"}]})
    assert "lies in another file, 'scene.bin', which is not opened" in refusal(tmp_path, "a.gltf", text)
    assert read(tmp_path, "b.glb", changed(images=[{"uri": "picture.png"}]))[0].n_faces == 2


def test_a_small_file_does_not_become_a_large_mesh(tmp_path: Path) -> None:
    mesh = sphere_mesh(4)
    file = simple_gltf(mesh.vertices, mesh.faces)
    content = file.scene(*({"mesh": 0, "translation": [i, 0, 0]} for i in range(2000))).glb()
    assert "placed so often that the mesh would have 2,052,000 vertices and 12,288,000 corners" in refusal(
        tmp_path, "a.glb", content
    )
    file = faces_as("u1")
    content = file.scene(*({"mesh": 0} for _ in range(60_000))).glb()
    assert "the scene shows 60,000 parts" in refusal(tmp_path, "b.glb", content)


def test_positions_that_were_never_written_are_refused(tmp_path: Path) -> None:
    mesh = sphere_mesh(2)
    vertices = mesh.vertices.copy()
    vertices[20:40] = 0
    assert "the vertices 20 to 39 all lie at exactly 0 0 0" in refusal(
        tmp_path, "a.glb", simple_gltf(vertices, mesh.faces).glb()
    )
