"""A generator of broken and odd files: every kind that is known to upset readers, and every one that ever upset ours.

Each file comes with what must happen: ``"refused"`` (in words), ``"same"`` (the mesh of the good file), or
``"told"`` (refused, the same mesh, or a mesh with a note that it may be damaged or was cut off).
"""

from __future__ import annotations

import base64
import json
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.dmp.formats.containers import (
    Gltf,
    Vtp,
    binary_off,
    model_xml,
    object_xml,
    pack_3mf,
    pack_glb,
    pack_zip,
    simple_gltf,
    vtk_file,
)
from tests.dmp.formats.files import binary_stl, ply_header, text_stl
from tests.dmp.formats.samples import ALL_SAMPLES, SMALL
from tests.meshes import sphere_mesh

# Name, content, what must happen, and the good file that it was made of (empty for none).
Broken = tuple[str, bytes, str, str]

_TEXTS = ("written.obj", "rich.obj", "text.ply", "rich.ply", "text.stl", "written.off", "rich.off", "text.vtp", "text.vtk")
_TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def broken_files() -> Iterator[Broken]:
    """Yield all of them."""
    yield from _of_every_format()
    yield from _of_every_text()
    yield from _foreign()
    yield from _large_for_their_size()
    yield from _found()


def _of_every_format() -> Iterator[Broken]:
    for name, good in ALL_SAMPLES.items():
        suffix = Path(name).suffix
        is_text = b"\0" not in good
        yield f"empty_{name}", b"", "refused", name
        yield f"blank_{name}", b" \r\n\t\n" * 100, "refused", name
        yield f"remarks_{name}", b"# nothing here\n" * 100, "refused", name
        yield f"zeros_{name}", bytes(len(good)), "refused", name
        yield f"ones_{name}", b"\xff" * len(good), "refused", name
        yield f"half_{name}", good[: len(good) // 2], "told", name
        yield f"two_thirds_{name}", good[: 2 * len(good) // 3], "told", name
        yield f"zero_tail_{name}", good[: len(good) // 2] + bytes(len(good) - len(good) // 2), "refused", name
        yield f"last_sector_zero_{name}", good[:-128] + bytes(128), "refused", name
        yield f"page_{name}", b"<!DOCTYPE html><html><body>Sign in</body></html>", "refused", name
        yield f"picture_{name}", b"\x89PNG\r\n\x1a\n" + bytes(100), "refused", name
        yield f"program_{name}", b"\x7fELF\2\1\1" + bytes(100), "refused", name
        yield f"letter_{name}", b"Dear Sir or Madam,\nplease find the mesh attached.\n", "refused", name
        yield f"lfs_{name}", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 7\n", "refused", name
        yield f"packed_{name}", b"\x1f\x8b\x08" + zlib.compress(good)[2:], "refused", name
        yield f"noise_{name}", np.random.default_rng(7).bytes(3000), "refused", name
        yield f"wrong_extension_{name}.xyz", good, "same", name
        yield f"no_extension_{name.replace('.', '_')}", good, "same", name
        yield f"upper_case_{name.removesuffix(suffix)}{suffix.upper()}", good, "same", name
        other = next(other for other in ALL_SAMPLES if Path(other).suffix != suffix)
        yield f"extension_of_another_{name}{Path(other).suffix}", good, "same", name
        if not is_text:
            # As an old FTP client, or an editor, does to a file that is no text.
            yield f"as_text_{name}", good.replace(b"\n", b"\r\n"), "told" if b"\n" in good else "same", name
            yield f"as_utf8_{name}", good.decode("latin-1").encode(), "refused", name
            yield f"marked_{name}", b"\xef\xbb\xbf" + good, "told", name


def _of_every_text() -> Iterator[Broken]:
    for name in (*_TEXTS, "plain.gltf", "rich.gltf", "inline.vtp", "packed.vtp"):
        good = ALL_SAMPLES[name].decode()
        is_xml = name.endswith(".vtp")
        plain = good.replace('<?xml version="1.0"?>\n', "")
        yield f"marked_{name}", b"\xef\xbb\xbf" + good.encode(), "same", name
        yield f"crlf_{name}", good.replace("\n", "\r\n").encode(), "same", name
        if not (name == "rich.obj" or is_xml):
            yield f"cr_{name}", good.replace("\n", "\r").encode(), "same", name
        for encoding in ("utf-16", "utf-32"):
            if not (is_xml and encoding == "utf-32"):
                yield f"{encoding}_{name}", plain.encode(encoding), "same", name
        yield f"utf16_without_mark_{name}", plain.encode("utf-16-le"), "refused", name
        yield f"nul_inside_{name}", good.replace("\n", "\n\0", 3).encode(), "refused", name
        if not name.endswith((".obj", ".stl")):  # two OBJ or STL files, one after the other, are one with both
            yield f"twice_{name}", (good + good).encode(), "told", name
        yield f"no_last_line_end_{name}", good.rstrip("\n").encode(), "same", name
        yield f"control_z_{name}", good.encode() + b"\x1a", "told", name
        if not name.endswith((".gltf", ".vtp")):
            yield (
                f"tabs_{name}",
                good.replace(" ", "\t").replace("#\tvtk\tDataFile\tVersion\t", "# vtk DataFile Version ").encode(),
                "same",
                name,
            )
            yield f"decimal_commas_{name}", re.sub(r"(\d)\.(\d)", r"\1,\2", good).encode(), "told", name
    for name in ("written.obj", "text.ply", "text.stl", "written.off", "text.vtk", "text.vtp"):
        good = ALL_SAMPLES[name].decode()
        # The positions of the octahedron are whole numbers.
        pattern = r"-?1\.0" if name.endswith(".vtp") else r"-?0\.\d{4,}"
        number = re.compile(rf"(?<=[ \n]){pattern}(?=[ \n])").search(good, max(good.find("<Points>"), 0))
        assert number is not None
        for word in ("nan", "inf", "-Infinity", "1.#QNAN", "1e999", "0x1p3", "1_0", "1.2.3", "--1", "1e", "zero", "1d0", "(1)"):
            changed = good[: number.start()] + word + good[number.end() :]
            yield f"number_{word.encode().hex()}_{name}", changed.encode(), "refused", name
    obj = ALL_SAMPLES["written.obj"].decode()
    yield "latin_1_remark.obj", ("# Größe\n" + obj).encode("latin-1"), "same", "written.obj"
    lines = obj.splitlines(keepends=True)
    continued = "".join(line if line.startswith("#") else line.replace(" ", " \\\n ") for line in lines)
    yield "continued.obj", continued.encode(), "same", "written.obj"
    n = sum(line.startswith("v ") for line in lines)
    relative = [
        re.sub(r"(?<= )\d+", lambda m: str(int(m[0]) - n - 1), line) if line.startswith("f") else line for line in lines
    ]
    yield "relative.obj", "".join(relative).encode(), "same", "written.obj"
    slashed = [re.sub(r"(?<= )(\d+)", r"\1/1/\1", line) if line.startswith("f") else line for line in lines]
    yield "seams.obj", ("mtllib /etc/passwd\nmtllib ../a.mtl\nvt 0 0\n" + "".join(slashed)).encode(), "same", "written.obj"
    colours = [line.rstrip() + " 0.5 0.5 1\n" if line.startswith("v") else line for line in lines]
    yield "colours.obj", "".join(colours).encode(), "same", "written.obj"
    yield (
        "objects.obj",
        "".join(f"o part{i}\ng a b c\ns {i}\nusemtl x\n{line}" for i, line in enumerate(lines)).encode(),
        "same",
        "written.obj",
    )
    yield "faces_first.obj", "".join(sorted(lines, key=lambda line: line[0] != "f")).encode(), "same", "written.obj"


def _foreign() -> Iterator[Broken]:
    """What is no triangle mesh, in every format that can hold it."""
    points = SMALL.vertices
    yield "points.obj", _TRIANGLE, "refused", ""
    yield "points.ply", ply_header("ascii", 3, 0).encode() + b"0 0 0\n1 0 0\n0 1 0\n", "refused", ""
    yield "points.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "refused", ""
    yield "points.vtk", vtk_file(points, []), "refused", ""
    yield "points.vtp", Vtp().file(Vtp().piece(points, [])), "refused", ""
    cloud = Gltf()
    cloud.scene({"mesh": cloud.mesh({"attributes": {"POSITION": cloud.accessor(points, "f4")}, "mode": 0})})
    yield "points.glb", cloud.glb(), "refused", ""
    yield "points.3mf", pack_3mf(model_xml(object_xml(1, points, np.zeros((0, 3), int)))), "refused", ""
    yield "lines.obj", _TRIANGLE + b"l 1 2 3\n", "refused", ""
    yield "lines.vtp", Vtp().file(Vtp().piece(points, [], lines=[[0, 1, 2]])), "refused", ""
    grid = ply_header("ascii", 3, 0).partition("element face")[0].replace("comment", "obj_info num_cols 2\ncomment")
    grid += "element range_grid 4\nproperty list uchar int vertex_indices\nend_header\n"
    yield "range_grid.ply", grid.encode() + b"0 0 0\n1 0 0\n0 1 0\n1 0\n1 1\n1 2\n0\n", "refused", ""
    yield "curves.obj", _TRIANGLE + b"cstype bspline\ndeg 3\ncurv 0 1 1 2 3\nend\n", "refused", ""
    yield "one_point.obj", b"v 1 2 3\n" * 6 + b"f 1 2 3\nf 4 5 6\n", "refused", ""
    yield "one_line.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "refused", ""
    yield "degenerate.ply", ply_header("ascii", 3, 2).encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 0 1\n3 2 2 2\n", "refused", ""
    for scale in (1e300, 1e200, 1e13, 1e-13, 1e-30, 1e-300):
        yield (
            f"scale_{scale:g}.obj",
            b"".join(b"v %r %r %r\n" % tuple(row) for row in (points * scale).tolist()) + b"f 1 3 5\nf 2 4 6\n",
            "refused",
            "",
        )
    far = b"".join(b"v %r %r %r\n" % tuple(row) for row in (points * 1e-3 + 1e20).tolist()) + b"f 1 3 5\n"
    yield "beyond_double_precision.obj", far, "refused", ""
    yield "index_0.obj", _TRIANGLE + b"f 0 1 2\n", "refused", ""
    yield "index_beyond.obj", _TRIANGLE + b"f 1 2 4\n", "refused", ""
    yield "index_huge.obj", _TRIANGLE + b"f 1 2 9223372036854775807\n", "refused", ""
    yield "index_before.obj", _TRIANGLE + b"f -1 -2 -4\n", "refused", ""
    yield "index_minus_1.ply", ply_header("ascii", 3, 1).encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "refused", ""
    yield "index_minus_1.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "refused", ""
    yield "index_minus_1.vtk", vtk_file(points, [[0, 1, -1]], binary=True), "refused", ""
    yield "index_beyond.vtp", Vtp("raw").file(Vtp("raw").piece(points, [[0, 1, 6]])), "refused", ""
    yield "index_beyond.glb", simple_gltf(points, [[0, 1, 6]]).glb(), "refused", ""
    yield "index_beyond.3mf", pack_3mf(model_xml(object_xml(1, points, [[0, 1, 6]]))), "refused", ""
    yield (
        "index_of_another_object.3mf",
        pack_3mf(
            model_xml(
                object_xml(1, points, [[0, 2, 6]]) + object_xml(2, points, SMALL.faces),
                '<item objectid="1"/><item objectid="2"/>',
            )
        ),
        "refused",
        "",
    )
    yield "grid.vtk", b"# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n", "refused", ""
    yield "volume.vtp", Vtp().file(kind="ImageData"), "refused", ""
    yield "archive.zip", pack_zip({"mesh.obj": _TRIANGLE + b"f 1 2 3\n"}), "refused", ""
    yield "settings.json", b'{"asset": "none", "meshes": 7}', "refused", ""
    yield "list.json", b"[1, 2, 3]", "refused", ""
    yield "materials.mtl", b"# a\nnewmtl red\nKd 1 0 0\n", "refused", ""
    yield "blender.blend", b"BLENDER-v300", "refused", ""
    yield "scan.fbx", b"Kaydara FBX Binary  \0\x1a\0" + bytes(99), "refused", ""
    yield "part.step", b"ISO-10303-21;\nHEADER;\n", "refused", ""


def _huge_counts() -> Iterator[Broken]:
    for count in (b"999999999", b"4294967295", b"18446744073709551615", b"-1", b"1e9", b"0x10"):
        label = count.decode().replace("-", "minus_")
        yield f"{label}_vertices.ply", ALL_SAMPLES["written.ply"].replace(b"vertex 18", b"vertex " + count), "refused", ""
        yield f"{label}_faces.ply", ALL_SAMPLES["big_endian.ply"].replace(b"face 32", b"face " + count), "refused", ""
        yield f"{label}_rows.ply", ALL_SAMPLES["text.ply"].replace(b"face 32", b"face " + count), "refused", ""
        yield f"{label}_vertices.off", ALL_SAMPLES["written.off"].replace(b"18 32 0", count + b" 32 0"), "refused", ""
        yield f"{label}_faces.off", ALL_SAMPLES["written.off"].replace(b"18 32 0", b"18 " + count + b" 0"), "refused", ""
        yield f"{label}_points.vtk", ALL_SAMPLES["binary.vtk"].replace(b"POINTS 18", b"POINTS " + count), "refused", ""
        yield f"{label}_cells.vtk", ALL_SAMPLES["text.vtk"].replace(b"POLYGONS 32", b"POLYGONS " + count), "refused", ""
        yield f"{label}_points.vtp", ALL_SAMPLES["raw.vtp"].replace(b'Points="6"', b'Points="' + count + b'"'), "refused", ""
        yield f"{label}_cells.vtp", ALL_SAMPLES["text.vtp"].replace(b'Polys="8"', b'Polys="' + count + b'"'), "refused", ""
        yield f"{label}_elements.gltf", re.sub(rb'"count": \d+', b'"count": ' + count, ALL_SAMPLES["plain.gltf"]), "refused", ""
        yield (
            f"{label}_bytes.gltf",
            re.sub(rb'"byteLength": \d+', b'"byteLength": ' + count, ALL_SAMPLES["plain.gltf"]),
            "refused",
            "",
        )
    stl = bytearray(ALL_SAMPLES["written.stl"])
    for number in (0, 1, 2**31, 2**32 - 1):
        stl[80:84] = struct.pack("<I", number)
        yield f"{number}_facets.stl", bytes(stl), "refused", ""
    yield (
        "4_billion_vertices.off",
        binary_off(SMALL.vertices, SMALL.faces).replace(struct.pack(">i", 6), b"\x7f\xff\xff\xff", 1),
        "refused",
        "",
    )
    lists = ply_header("binary_little_endian", 3, 1).replace("list uchar", "list uint").encode()
    yield "huge_list.ply", lists + bytes(72) + struct.pack("<I", 2**32 - 1), "refused", ""


def _large_for_their_size() -> Iterator[Broken]:
    """Small files that would become large, or take long."""
    yield from _huge_counts()
    lol = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
    entities = f'<?xml version="1.0"?><!DOCTYPE model [<!ENTITY l0 "lol">{lol}]>'
    yield "entities.3mf", pack_3mf(entities + model_xml("&l9;").partition("?>")[2]), "refused", ""
    yield "entities.vtp", entities.encode() + b"<VTKFile type='PolyData'>&l9;</VTKFile>", "refused", ""
    outside = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    yield "outside_entity.3mf", pack_3mf(outside + model_xml("&x;").partition("?>")[2]), "refused", ""
    yield "outside_entity.vtp", outside.encode() + b"<VTKFile type='PolyData'>&x;</VTKFile>", "refused", ""
    yield "bomb.3mf", pack_3mf(model_xml(" " * 40_000_000)), "refused", ""
    yield "many_elements.3mf", pack_3mf(model_xml("<metadata/>" * 400_000)), "refused", ""
    yield "many_objects.3mf", pack_3mf(model_xml("".join(f'<object id="{i}"/>' for i in range(40_000)))), "refused", ""
    yield "names.3mf", pack_zip({f"../../{i}": b"" for i in range(60_000)}), "refused", ""
    sphere = sphere_mesh(3)
    placed = simple_gltf(sphere.vertices, sphere.faces).scene(*({"mesh": 0} for _ in range(5000)))
    yield "repeated.glb", placed.glb(), "refused", ""
    circle = {**simple_gltf(SMALL.vertices, SMALL.faces).document, "nodes": [{"children": [1], "mesh": 0}, {"children": [0]}]}
    yield "circle.gltf", json.dumps({**circle, "buffers": []}).encode(), "refused", ""
    yield "deep.glb", pack_glb(b'{"a":' + b"[" * 200_000, b""), "refused", ""
    yield "wide.glb", pack_glb(b'{"a":[' + b"{}," * 1_100_000 + b"{}]}", b""), "refused", ""
    yield "long_number.glb", pack_glb(b'{"a":' + b"9" * 1_000_000 + b"}", b""), "refused", ""
    yield "deep.vtp", b"<VTKFile type='PolyData'>" + b"<a>" * 300_000, "refused", ""
    yield "pieces.vtp", Vtp().file(*["<Piece NumberOfPoints='0'/>"] * 30_000), "refused", ""
    zeros = zlib.compress(bytes(48_000_000), 9)
    inline = base64.b64encode(struct.pack("<4I", 1, 48_000_000, 0, len(zeros))) + base64.b64encode(zeros)
    text = Vtp("binary", packed=True).file(Vtp().piece([[0, 0, 0]] * 3, [[0, 1, 2]], kind="Float64")).decode()
    text = text.replace('NumberOfPoints="3"', 'NumberOfPoints="2000000"')
    packed = re.sub(
        r'(?s)(Name="Points"[^>]*format=")ascii(">).*?<', lambda m: f"{m[1]}binary{m[2]}{inline.decode()}<", text, count=1
    )
    yield "bomb.vtp", packed.encode(), "refused", ""
    yield "blank_lines.vtk", b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n" + b"\n" * 2_000_000, "refused", ""
    yield (
        "fields.vtk",
        b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n" + b"FIELD F 1\na 1 1 int\n1\n" * 50_000,
        "refused",
        "",
    )
    yield "metadata.vtk", b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n" + b"METADATA\n\n" * 100_000, "refused", ""
    yield "properties.ply", b"ply\nformat ascii 1.0\n" + b"".join(
        b"element e%d 0\n" % i + b"".join(b"property int p%d\n" % k for k in range(999)) for i in range(40)
    ), "refused", ""  # fmt: skip


def _found() -> Iterator[Broken]:
    """What upset our own readers, once each."""
    # A pattern that tried all ways to part blanks at the ends of remarks: hours for a dozen lines.
    yield "found_remarks.off", b"#          \n" * 60 + ALL_SAMPLES["written.off"], "same", "written.off"
    # Patterns for numbers that went back over all digits for each digit.
    digits = b"1" * 300_000 + b"x"
    yield "found_digits.obj", b" v 0 0 " + digits + b"\n", "refused", ""
    yield "found_digits.off", b"OFF\n1 1 0\n0 0 " + digits + b"\n", "refused", ""
    yield "found_digits.ply", ply_header("ascii", 1, 0).encode() + b"0 0 " + digits + b"\n", "refused", ""
    yield "found_digits.stl", b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 " + digits + b"\n", "refused", ""
    yield "found_digits.vtk", ALL_SAMPLES["text.vtk"].replace(b"double\n", b"double\n" + digits + b" "), "refused", ""
    yield "found_remarks.vtp", b"<!-- -->" * 5000, "refused", ""
    # Parts in the middle that were never written.
    stl = ALL_SAMPLES["written.stl"]
    yield "found_hole.stl", stl[:584] + bytes(512) + stl[1096:], "refused", ""
    mesh = sphere_mesh(3)
    vertices = mesh.vertices.copy()
    vertices[100:140] = 0
    yield "found_hole.glb", simple_gltf(vertices, mesh.faces).glb(), "refused", ""
    yield "found_hole.vtk", vtk_file(vertices, mesh.faces, binary=True), "refused", ""
    yield "found_hole.off", binary_off(vertices, mesh.faces), "refused", ""
    faces = mesh.faces.copy()
    faces[100:120] = 0
    yield "found_unwritten_faces.glb", simple_gltf(mesh.vertices, faces).glb(), "refused", ""
    yield "found_unwritten_faces.vtp", Vtp("raw").file(Vtp("raw").piece(mesh.vertices, faces)), "refused", ""
    # Bytes that were added in the middle shift all that follows.
    for added in (b"\0", b"\r", b"\xef\xbb\xbf"):
        yield f"found_added_{added.hex()}.stl", stl[:700] + added + stl[700:], "refused", ""
    yield "found_row_in_row.off", ALL_SAMPLES["written.off"].replace(b"\n3 9 15 16\n", b"\n34 5\n3 9 15 16\n"), "refused", ""
    # Damaged names of what places or holds a mesh, which were taken for missing ones.
    rich = ALL_SAMPLES["rich.gltf"]
    yield "found_translation.gltf", rich.replace(b'"translation"', b'"tranzlation"'), "told", "rich.gltf"
    yield "found_primitives.gltf", rich.replace(b'"primitives"', b'"pris"', 1), "refused", ""
    yield (
        "found_item.3mf",
        pack_3mf(model_xml(object_xml(1, SMALL.vertices, SMALL.faces), '<itgm objectid="1"/>')),
        "refused",
        "",
    )
    yield "found_number_of_polys.vtp", ALL_SAMPLES["text.vtp"].replace(b"NumberOfPolys", b"NumberOfPplys"), "refused", ""
    # A row that lost a part, so that all rows together are as many numbers as shorter ones would be.
    yield "found_short_row.off", ALL_SAMPLES["rich.off"].replace(b" 3 0 255 0.5 0.5\n3", b" 3.5\n3"), "refused", ""
    # Differences between numbers of 64 bits that are larger than such a number.
    overflow = [3, 2**63 - 1, -(2**63) + 9, *range(12, 25, 3)]
    wide = Vtp("raw")
    corners = wide.array(SMALL.faces.ravel(), "Int64", "connectivity") + wide.array(overflow, "Int64", "offsets")
    piece = wide.piece(SMALL.vertices, SMALL.faces)
    start, end = piece.index("<Polys>"), piece.index("</Polys>")
    yield "found_overflow.vtp", wide.file(f"{piece[:start]}<Polys>{corners}{piece[end:]}"), "refused", ""
    # base64 text that goes on after its data.
    yield "found_base64.vtp", ALL_SAMPLES["inline.vtp"].replace(b"\n</DataArray>", b"AAAA\n</DataArray>"), "refused", ""
    # The last line break of a binary file is missing, or a zero: its last section may be too.
    yield (
        "found_cut_section.vtk",
        ALL_SAMPLES["version_5_binary.vtk"].partition(b"\nTRIANGLE")[0],
        "told",
        "version_5_binary.vtk",
    )
    yield "found_zero_end.vtk", ALL_SAMPLES["version_5_binary.vtk"][:-2] + bytes(2), "told", "version_5_binary.vtk"
    # A place so far away that nothing of the shape is left, which joined its vertices.
    for distance in (1e17, 1e300):
        far = simple_gltf(SMALL.vertices, SMALL.faces)
        far.document["nodes"][0]["translation"] = [distance, 0, 0]
        yield f"found_far_place_{distance:g}.glb", far.glb(), "refused", ""
    # What stands beside data that are required to be unpacked is not what they hold.
    draco = "KHR_draco_mesh_compression"
    packed = simple_gltf(SMALL.vertices, SMALL.faces)
    packed.document |= {"extensionsUsed": [draco], "extensionsRequired": [draco]}
    packed.document["meshes"][0]["primitives"][0]["extensions"] = {draco: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    yield "found_required_draco.glb", packed.glb(), "refused", ""
    lost = simple_gltf(SMALL.vertices, SMALL.faces)
    lost.document["nodes"] = []
    yield "found_nodes_lost.glb", lost.glb(), "refused", ""
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 1\nv 1 0 1\nv 0 1 1\nl 1 2"
    yield "found_cut_after_line.obj", obj, "told", ""
    soup = SMALL.vertices[SMALL.faces]
    yield "found_solid_header.stl", binary_stl(soup, b"solid made by a program"), "same", ""
    # The last word of a cut text reached beyond the end of the text.
    cut = text_stl(SMALL.vertices[SMALL.faces]).rpartition("endfacet")[0] + "e\n"
    yield "found_cut_word.stl", cut.encode(), "refused", ""
    # Two meshes in one object: the triangles of the second were taken for those of the first.
    one = object_xml(1, SMALL.vertices, SMALL.faces)
    mesh_xml = one[one.index("<mesh>") : one.index("</object>")]
    yield "found_second_mesh.3mf", pack_3mf(model_xml(one.replace("</object>", f"{mesh_xml}</object>"))), "refused", ""
    points_xml = one[one.index("<vertices>") : one.index("<triangles>")]
    yield "found_second_vertices.3mf", pack_3mf(model_xml(one.replace(points_xml, 2 * points_xml))), "refused", ""
    # Millions of attributes: a minute, and a gigabyte.
    attributes = " ".join(f'a{i:x}=""' for i in range(500_000))
    yield "found_attributes.3mf", pack_3mf(model_xml("", "", attributes)), "refused", ""
    yield "found_attributes.vtp", f"<VTKFile type='PolyData' {attributes}/>".encode(), "refused", ""
    # All of its bytes are faces without corners, but for the first.
    bare = ply_header("binary_little_endian", 3, 2_000_000).replace("uchar int", "uchar uchar").encode()
    empty = bare + np.eye(3).tobytes() + b"\3\0\1\2" + bytes(1_999_999)
    yield "found_empty_faces.ply", empty, "refused", ""
    # Which of the two lists holds the faces?
    both = ply_header("ascii", 3, 1, face="list uchar int vertex_index").encode() + b"0 0 0\n1 0 0\n0 1 0\n"
    yield "found_two_lists.ply", both + b"3 0 1 2 3 0 2 1\n", "refused", ""
    # The word that is no number was looked for word by word.
    numbers = b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 300000 double\n"
    yield "found_cut_numbers.vtk", numbers + b"0.1 0.2 0.3\n" * 299_999, "refused", ""
