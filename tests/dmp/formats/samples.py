"""Good files of every kind that can be read, small, the same bytes each time: what the tests cut, change and injure."""

from __future__ import annotations

import numpy as np

from dmp.formats.obj_writing import write_obj
from dmp.formats.off import write_off
from dmp.formats.ply_writing import write_ply
from dmp.formats.stl import write_stl
from dmp.formats.vtk_writing import write_vtp
from dmp.mesh import TriangleMesh
from tests.dmp.formats.containers import Gltf, Vtp, binary_off, model_xml, object_xml, pack_3mf, simple_gltf, vtk_file
from tests.dmp.formats.files import binary_ply, ply_header, text_stl
from tests.meshes import sphere_mesh

WRITERS = {".obj": write_obj, ".ply": write_ply, ".stl": write_stl, ".off": write_off, ".vtp": write_vtp}
# The octahedron before it is split: small enough for formats whose samples are wordy.
SMALL = sphere_mesh(0)


def content_of(suffix: str, mesh: TriangleMesh) -> bytes:
    return b"".join(WRITERS[suffix](mesh))


def _rich_gltf() -> Gltf:
    """Colours, normals, a strip, indices of several types, interleaved and sparse data, and nodes below each other."""
    file = Gltf()
    points = SMALL.vertices.astype(np.float32)
    position = file.accessor(points, "f4", limits=True)
    attributes = {
        "POSITION": position,
        "NORMAL": file.accessor(points, "f4"),
        "COLOR_0": file.accessor(np.arange(24).reshape(6, 4) * 10, "u1", normalized=True),
    }
    first = file.mesh({"attributes": attributes, "indices": file.accessor(SMALL.faces.ravel(), "u2")})
    rows = file.view(np.concatenate([points, points], axis=1).tobytes(), byteStride=24)
    sparse = {
        "count": 2,
        "indices": {"bufferView": file.view(np.array([1, 4], dtype="<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": file.view(np.array([[-2, 0, 0], [0, 0, 3]], dtype="<f4").tobytes())},
    }
    file.document["accessors"].append({"bufferView": rows, "componentType": 5126, "count": 6, "type": "VEC3", "sparse": sparse})
    colour = file.accessor(np.arange(24).reshape(6, 4), "u1", normalized=True)
    strip = {
        "attributes": {"POSITION": len(file.document["accessors"]) - 2, "COLOR_0": colour},
        "mode": 5,
        "indices": file.accessor([0, 2, 4, 1, 3], "u1"),
    }
    second = file.mesh(strip)
    half = float(np.sqrt(0.5))
    return file.scene(
        {"mesh": first, "children": [1], "translation": [0.5, 0, 1], "rotation": [0, half, 0, half], "name": "one"},
        {"mesh": second, "matrix": [-1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1], "name": "two"},
        roots=[0],
    )


def _rich_3mf() -> bytes:
    """Two objects, one of them made of the other, at places."""
    resources = object_xml(1, SMALL.vertices, SMALL.faces) + (
        '<object id="2" type="model"><components><component objectid="1"/>'
        '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 5 0 0.25"/></components></object>\n'
    )
    return pack_3mf(model_xml(resources, '<item objectid="2" transform="2 0 0 0 2 0 0 0 2 1 1 1"/>', 'unit="inch"'))


def _vtp(layout: str, **how: object) -> bytes:
    writer = Vtp(layout, **how)  # type: ignore[arg-type]
    data = writer.array(np.linspace(0, 1, SMALL.n_vertices), "Float32", "quality")
    strip = writer.piece(SMALL.vertices + 4, [], strips=[[0, 2, 4, 1, 3]], data=data, kind="Float32")
    return writer.file(writer.piece(SMALL.vertices, SMALL.faces, data=data, kind="Float32"), strip)


def _samples() -> dict[str, bytes]:
    mesh = sphere_mesh(1)
    vertices, faces = mesh.vertices.tolist(), mesh.faces.tolist()
    rows = "".join("{!r} {!r} {!r}\n".format(*vertex) for vertex in vertices)
    return {
        **{f"written{suffix}": content_of(suffix, mesh) for suffix in WRITERS},
        "big_endian.ply": binary_ply(">", vertices, faces),
        "text.ply": (
            ply_header("ascii", len(vertices), len(faces)) + rows + "".join("3 {} {} {}\n".format(*face) for face in faces)
        ).encode(),
        "text.stl": text_stl(mesh.vertices[mesh.faces]).encode(),
        "binary.off": binary_off(vertices, faces),
        "plain.glb": simple_gltf(vertices, faces, "u2").glb(),
        "plain.gltf": simple_gltf(SMALL.vertices, SMALL.faces, "u1").text(),
        "plain.3mf": pack_3mf(model_xml(object_xml(1, vertices, faces))),
        "text.vtp": _vtp("ascii"),
        "inline.vtp": _vtp("binary", word="u8"),
        "packed.vtp": _vtp("binary", packed=True),
        "raw.vtp": _vtp("raw", order=">"),
        "text.vtk": vtk_file(vertices, faces),
        "binary.vtk": vtk_file(vertices, faces, binary=True),
    }


def _rich() -> dict[str, bytes]:
    points = [(i, i * i % 7, i * 3 % 5) for i in range(12)]
    ply = ply_header("ascii", 4, 2, "uchar red;uchar green;uchar blue;list uchar int n", "list uchar float w;int id")
    return {
        "rich.obj": b"mtllib a.mtl\no a\n"
        + b"".join(b"v %d %d %d 0.5 0.5 1\nvt 0 %d\n" % (*point, index) for index, point in enumerate(points))
        + b"g b\ns 1\nf 1/1 2/2 3/3\nf -1//1 -2//1 -3//1 -5//1\nf 4 5 6 \\\n7 8\nl 1 2\nf 9/1/1 10/1/1 11/1/1\n",
        "rich.off": b"STCNOFF # all\n4 2 0\n"
        + b"".join(b"%d %d %d 0 0 1 255 %d 0 255 0.5 0.5\n" % (i, i * i, i % 3, i) for i in range(4))
        + b"3 0 1 2 1 0 0\n3 0 2 3\n",
        "rich.ply": ply.encode()
        + b"0 0 0 1 2 3 2 5 5\n1 0 0 1 2 3 0\n1 1 0 1 2 3 1 7\n0 1 0 1 2 3 0\n3 0 1 2 1 0.5 7\n3 0 2 3 0 9\n",
        "rich.glb": _rich_gltf().glb(),
        "rich.gltf": _rich_gltf().text(),
        "rich.3mf": _rich_3mf(),
        "packed_raw.vtp": _vtp("raw", packed=True, word="u8"),
        "version_5.vtk": vtk_file(SMALL.vertices, SMALL.faces, strips=[[0, 2, 4, 1, 3]], version=5),
        "version_5_binary.vtk": vtk_file(SMALL.vertices, SMALL.faces, strips=[[0, 2, 4, 1, 3]], version=5, binary=True),
    }


# A small file of each kind, and files with everything that a format can hold.
SAMPLES = _samples()
RICH_SAMPLES = _rich()
ALL_SAMPLES = {**SAMPLES, **RICH_SAMPLES}
