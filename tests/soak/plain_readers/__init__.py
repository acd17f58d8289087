"""Readers written for nothing but comparison: a few plain lines for each format, by the book, one value at a time.

They share no code with the readers under test, take no care of speed or size, and may raise anything: an exception
means that they have no opinion. What they return is what the bytes of a file say.
"""

from __future__ import annotations

import json
import re
import struct

from tests.soak.plain_readers.flat import read_binary_off, read_binary_stl, read_obj, read_off, read_ply, read_text_stl
from tests.soak.plain_readers.scenes import glb_parts, read_gltf, read_threemf
from tests.soak.plain_readers.values import Polygons, text_of
from tests.soak.plain_readers.vtk import read_vtk, read_vtp


def read_plainly(content: bytes) -> Polygons:
    """Return the positions and polygons of a file of any format; corners count from 0."""
    if content.startswith(b"glTF"):
        return read_gltf(*glb_parts(content))
    if content.startswith(b"PK"):
        return read_threemf(content)
    facets = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
    if facets and len(content) == 84 + 50 * facets:
        return read_binary_stl(content, facets)
    head = text_of(content).lstrip()
    if head.startswith("ply"):
        return read_ply(content)
    if head.startswith("# vtk"):
        return read_vtk(content)
    if "<VTKFile" in head[:3000]:
        return read_vtp(content)
    if head.startswith("{"):
        return read_gltf(json.loads(head.lstrip("\ufeff")), b"")
    if head[:5].lower() == "solid" and "facet" in head.lower():
        return read_text_stl(text_of(content))
    first = next((line for line in head.splitlines() if line.strip() and not line.strip().startswith("#")), "").split()
    if first and re.fullmatch(r"(ST|C|N|4)*n?OFF|(st|c|n|4)*off", first[0]):
        return read_binary_off(content) if first[1:2] == ["BINARY"] else read_off(head)
    if first and re.fullmatch(r"[\d.+-].*", first[0]):
        return read_off("OFF\n" + head)
    if facets and b"\0" in content and len(content) > 84 + 50 * facets:
        return read_binary_stl(content, facets)
    return read_obj(text_of(content))
