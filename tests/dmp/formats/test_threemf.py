"""Reading 3MF: objects at their places, and archives and XML from strangers."""

from __future__ import annotations

import os
import struct
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.dmp.formats.containers import RELATIONS, model_xml, object_xml, pack_3mf, pack_zip
from tests.dmp.formats.files import SQUARE_FACES, SQUARE_VERTICES, read, refusal
from tests.meshes import sphere_mesh

OBJECT = object_xml(1, SQUARE_VERTICES, SQUARE_FACES)
MODEL = model_xml(OBJECT)
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
MILLIMETRES = "The coordinates are in millimetres."


@pytest.mark.parametrize(
    "content",
    [
        pack_3mf(MODEL),
        pack_zip({"_rels/.rels": RELATIONS, "3D/3dmodel.model": MODEL}, method=zipfile.ZIP_STORED),
        pack_3mf("\ufeff" + MODEL),
        pack_3mf(MODEL.replace("UTF-8", "UTF-16").encode("utf-16")),
        pack_3mf(MODEL.replace("\n", "\r\n")),
        pack_3mf(MODEL.replace('"', "'")),
        pack_3mf(MODEL.replace("<vertex ", "<!-- a --><vertex\n\t  ").replace("/>", "></vertex>", 4)),
        pack_3mf(MODEL.replace("xmlns=", "xmlns:q=").replace("</", "</q:").replace("<m", "<q:m").replace("<r", "<q:r")
            .replace("<o", "<q:o").replace("<v", "<q:v").replace("<t", "<q:t").replace("<b", "<q:b").replace("<i", "<q:i")),
        pack_3mf(MODEL, relations=RELATIONS.replace("/3D/3dm", "3D/3DM")),
        pack_zip({"3D/3dmodel.model": MODEL}),
        pack_3mf(MODEL, {"../../../evil": "x", "/etc/passwd": "x", "C:\\a": "x"}),
    ],
)  # fmt: skip
def test_the_same_square_in_every_spelling(tmp_path: Path, content: bytes) -> None:
    mesh, notes = read(tmp_path, "a.3mf", content)
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert mesh.faces.tolist() == SQUARE_FACES
    assert notes == (MILLIMETRES,)
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {"a.3mf"}


def test_items_and_components_are_placed(tmp_path: Path) -> None:
    parts = object_xml(1, SQUARE_VERTICES, SQUARE_FACES) + (
        '<object id="2"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/>'
        '<component objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/></components></object>'
    )
    build = '<item objectid="2" transform="2 0 0 0 2 0 0 0 2 0 0 7"/>'
    mesh, notes = read(tmp_path, "a.3mf", pack_3mf(model_xml(parts, build)))
    points = np.array(SQUARE_VERTICES)
    turned = np.stack([10 - points[:, 1], points[:, 0], points[:, 2]], axis=1)
    mirrored = points * [-1, 1, 1]
    np.testing.assert_allclose(mesh.vertices, np.concatenate([turned, mirrored]) * 2 + [0, 0, 7], atol=1e-15)
    # The mirrored object is turned round, so that it still looks outward.
    assert mesh.faces.tolist() == [*SQUARE_FACES, [6, 5, 4], [7, 6, 4]]
    assert notes == (MILLIMETRES, "Put together 2 objects as the file places them.")


def test_objects_in_other_parts_of_the_archive(tmp_path: Path) -> None:
    component = '<object id="5"><components><component objectid="1" p:path="/3D/Objects/part_1.model"/></components></object>'
    attributes = f'unit="inch" xmlns:p="{PRODUCTION}" requiredextensions="p"'
    root = model_xml(component, '<item objectid="5"/>', attributes)
    part = model_xml(OBJECT, "", 'unit="inch"')
    mesh, notes = read(tmp_path, "a.3mf", pack_3mf(root, {"3D/Objects/part_1.model": part}))
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert notes[0] == "The coordinates are in inches."
    assert "have different units" in refusal(
        tmp_path, "b.3mf", pack_3mf(root, {"3D/Objects/part_1.model": part.replace("inch", "meter")})
    )
    assert "no part '/3D/Objects/part_1.model'" in refusal(tmp_path, "c.3mf", pack_3mf(root))


def test_attributes_that_may_be_damaged_are_noted(tmp_path: Path) -> None:
    model = MODEL.replace('objectid="1"', 'objectid="1" tranzform="2 0 0 0 2 0 0 0 2 0 0 0"')
    assert "Ignored 'tranzform' in the part '/3D/3dmodel.model', item" in read(tmp_path, "a.3mf", pack_3mf(model))[1][1]
    model = MODEL.replace('objectid="1"', 'objectid="1" printable="1" p:UUID="7"').replace(
        "<model", f'<model xmlns:p="{PRODUCTION}"'
    )
    assert read(tmp_path, "b.3mf", pack_3mf(model))[1] == (MILLIMETRES,)


def test_what_is_left_out_is_told(tmp_path: Path) -> None:
    lattice = '<b:beamlattice xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"/></mesh>'
    model = MODEL.replace("</mesh>", lattice).replace('v3="2"', 'v3="2" pid="3" p1="0"')
    assert read(tmp_path, "a.3mf", pack_3mf(model))[1] == (
        MILLIMETRES,
        "Colours and materials of the file were left out.",
        "Left out what extensions of 3MF add to the objects: beamlattice.",
    )
    mesh, notes = read(tmp_path, "b.3mf", pack_3mf(model_xml(OBJECT, "")))
    assert mesh.n_faces == 2
    assert notes[0] == "The file does not tell what is to be built; all of its objects were read."


BOMB = '<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (MODEL.replace("<model", BOMB + "<model"), "line 2: a document type or an entity is declared"),
        (MODEL.replace("<model", '<!DOCTYPE a SYSTEM "file:///etc/passwd"><model'), "a document type or an entity is declared"),
        (MODEL.replace("</model>", ""), "the XML text is damaged (no element found)"),
        (MODEL[: len(MODEL) // 2], "the XML text is damaged"),
        (MODEL.replace("UTF-8", "klingon"), "unknown encoding"),
        ("", "the XML text is damaged"),
        ("\0" * 100, "the XML text is damaged"),
        (MODEL.replace('x="1.0"', 'x="nan"', 1), "'/3D/3dmodel.model', vertex 1: 'nan' is not a finite number"),
        (MODEL.replace('x="1.0"', 'x="1e999"', 1), "vertex 1: the number '1e999' is too large"),
        (MODEL.replace('x="1.0"', 'x="1,0"', 1), "vertex 1: the number '1,0' has a decimal comma"),
        (MODEL.replace('x="1.0"', 'x="1 0"', 1), "vertex 1: '1 0' is not a number"),
        (MODEL.replace('x="1.0" y="0.25"', 'x="1.0 0.25" y=""', 1), "vertex 1: '1.0 0.25' is not a number"),
        (MODEL.replace('x="1.0"', 'x="1&#10;0"', 1), "is not a number"),
        (MODEL.replace('x="1.0"', 'x="0x1"', 1), "'0x1' is not a number"),
        (MODEL.replace('x="1.0" ', "", 1), "line 7: 'vertex' has no 'x'"),
        (MODEL.replace('v1="0"', 'v1="0.0"', 1), "triangle 0: '0.0' is not the index of a vertex"),
        (MODEL.replace('v1="0"', 'v1="-1"', 1), "triangle 0: it refers to the vertices -1, 1, 2, but there are 4"),
        (MODEL.replace('v3="3"', 'v3="4"', 1), "triangle 1: it refers to the vertices 0, 2, 4, but there are 4"),
        (MODEL.replace('v3="3"', 'v3="99999999999999999999"', 1), "it refers to the vertices 0, 2, 9223372036854775807"),
        (MODEL.replace('objectid="1"', 'objectid="7"'), "an item that is to be built refers to object 7, which is not there"),
        (MODEL.replace('objectid="1"', 'objectid="1" transform="1 0 0"'), "a transform is not 12 numbers"),
        (MODEL.replace('objectid="1"', 'objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 1e999"'), "number that is too large"),
        (MODEL.replace('objectid="1"', 'objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 nan"'), "a transform is not 12 numbers"),
        (MODEL.replace("millimeter", "parsec"), "the unit 'parsec' is unknown"),
        (MODEL.replace("<model", '<model requiredextensions="x" xmlns:x="http://x.org/2020"'), "extension 'http://x.org/2020'"),
        (MODEL.replace("core/2015/02", "core/1999/01"), "no 3MF model of the core specification"),
        (model_xml(OBJECT + OBJECT), "there are two objects 1"),
        (model_xml('<object id="1"><components><component objectid="1"/></components></object>'), "of each other without end"),
        (model_xml(""), "object 1, which is not there"),
        (model_xml("", ""), "no vertices"),
        (model_xml('<object id="1"><mesh/></object>'), "no vertices"),
        (MODEL.replace("<triangles>", "").replace("</triangles>", ""), "a triangle is out of place"),
        (MODEL.replace("</resources>", "").replace("</build>", "</build></resources>"), "'build' is out of place"),
        (MODEL.replace("<item", "<itgm"), "'itgm' is no element of 3MF"),
        (MODEL.replace("<mesh>", "").replace("</mesh>", ""), "'vertices' stand outside of a mesh"),
        (MODEL.replace("<build>", "<metadata>" * 100 + "</metadata>" * 100 + "<build>"), "nested too deeply"),
    ],
)  # fmt: skip
def test_refusals_of_models(tmp_path: Path, model: str, expected: str) -> None:
    assert expected in refusal(tmp_path, "a.3mf", pack_3mf(model))


GOOD = pack_3mf(MODEL)


def encrypted() -> bytes:
    """The archive with the mark of encryption on its model."""
    content = bytearray(GOOD)
    entry = content.rindex(b"PK\1\2")
    content[entry + 8] |= 1
    return bytes(content)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (GOOD[:-1], "no valid list of its parts"),
        (GOOD[: len(GOOD) // 2], "no valid list of its parts"),
        (GOOD[:30], "no valid list of its parts"),
        (GOOD[:400] + bytes([GOOD[400] ^ 4]) + GOOD[401:], "of the archive is damaged"),
        (encrypted(), "is encrypted. Save the file without a password."),
        (pack_3mf(MODEL.replace("\n", " " * 2_000_000 + "\n")), "A mesh does not shrink so much"),
        (pack_zip({"a.obj": "v 0 0 0\n"}), "no 3MF file: it names no 3-D model; it holds 'a.obj'. Unpack"),
        (pack_zip({}), "it names no 3-D model"),
        (pack_3mf(MODEL, relations="<Relationships/>"), "it names no 3-D model"),
        (pack_3mf(MODEL, relations=RELATIONS.replace("3dmodel.model", "other.model")), "no part '/3D/other.model'"),
        (pack_3mf(MODEL, {"3d/3DMODEL.model": MODEL}), "more than one part '/3D/3dmodel.model'"),
        (pack_zip({f"part{i}": "" for i in range(50_001)}), "at most 50,000"),
    ],
)  # fmt: skip
def test_refusals_of_archives(tmp_path: Path, content: bytes, expected: str) -> None:
    start = time.perf_counter()
    assert expected in refusal(tmp_path, "a.3mf", content)
    assert time.perf_counter() - start < 5


def test_a_part_that_is_longer_than_the_archive_tells(tmp_path: Path) -> None:
    content = bytearray(pack_zip({"3D/a.model": MODEL.replace("\n", " " * 1000 + "\n")}))
    entry = content.rindex(b"PK\1\2")
    content[entry + 24 : entry + 28] = struct.pack("<I", 1000)
    assert "is damaged" in refusal(tmp_path, "a.3mf", bytes(content))


def test_objects_made_of_objects_do_not_explode(tmp_path: Path) -> None:
    mesh = sphere_mesh(1)
    levels = [object_xml(1, mesh.vertices, mesh.faces)]
    levels += [
        f'<object id="{i}"><components>{f"""<component objectid="{i - 1}"/>""" * 10}</components></object>'
        for i in range(2, 30)
    ]
    start = time.perf_counter()
    text = refusal(tmp_path, "a.3mf", pack_3mf(model_xml("".join(levels), '<item objectid="29"/>')))
    assert "placed so often" in text
    assert time.perf_counter() - start < 1
    empty = ['<object id="1"><components/></object>', *levels[1:]]
    assert "at most 20,000 can be read" in refusal(
        tmp_path, "b.3mf", pack_3mf(model_xml("".join(empty), '<item objectid="29"/>'))
    )


def test_other_files_are_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "other.model")  # opening it would wait for ever
    for path in ("../other.model", str(tmp_path / "other.model"), "other.model"):
        component = f'<object id="5"><components><component objectid="1" p:path="{path}"/></components></object>'
        root = model_xml(component, '<item objectid="5"/>', f'xmlns:p="{PRODUCTION}"')
        assert "the archive has no part" in refusal(tmp_path, "a.3mf", pack_3mf(root))


@pytest.mark.parametrize(
    ("begin", "end", "name"),
    [
        ("<mesh>", "</object>", "mesh"),
        ("<vertices>", "<triangles>", "vertices"),
        ("<triangles>", "</mesh>", "triangles"),
    ],
)
def test_an_object_has_one_mesh(tmp_path: Path, begin: str, end: str, name: str) -> None:
    one = object_xml(1, SQUARE_VERTICES, SQUARE_FACES)
    part = one[one.index(begin) : one.index(end)]
    twice = one.replace(part, 2 * part)
    assert f"the object has '{name}' twice" in refusal(tmp_path, "a.3mf", pack_3mf(model_xml(twice)))
    other = one.replace('id="1"', 'id="2"')
    mesh, _ = read(tmp_path, "b.3mf", pack_3mf(model_xml(one + other, '<item objectid="1"/><item objectid="2"/>')))
    assert mesh.n_faces == 2 * len(SQUARE_FACES)


def test_elements_of_very_many_attributes_are_refused_before_they_are_taken_in(tmp_path: Path) -> None:
    def attributes(start: int, n: int) -> str:
        return " ".join(f'a{start + index}="x=>\'"' for index in range(n))

    square = object_xml(1, SQUARE_VERTICES, SQUARE_FACES)
    text = refusal(tmp_path, "a.3mf", pack_3mf(model_xml(square, attributes=attributes(0, 1001))))
    assert "line 2: an element has more than 1,000 attributes" in text
    assert read(tmp_path, "a.3mf", pack_3mf(model_xml(square, attributes=attributes(0, 400))))[0].n_faces == 2
    many = "".join(f"<metadata {attributes(index, 500)}/>" for index in range(50))
    assert "far more attributes" in refusal(tmp_path, "b.3mf", pack_3mf(model_xml(many)))
