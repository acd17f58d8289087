"""Telling the format of a file by its content; the extension of its name decides only where the content cannot."""

from __future__ import annotations

import re

from dmp.formats.gltf_container import MAGIC as GLB_MAGIC
from dmp.formats.names import NAMES, READ_SENTENCE, Format
from dmp.formats.obj import STATEMENTS
from dmp.formats.off import KEYWORD
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.stl import FACET_BYTES, HEADER_BYTES, said_facets
from dmp.formats.text import encoding_of, show, transcode
from dmp.formats.vtk_legacy import MAGIC as VTK_MAGIC

_CONVERT = f"{READ_SENTENCE}; convert it to one of them, for example in MeshLab."
_NO_MESH = f"{READ_SENTENCE}; choose one of them."

# Beginnings of files that are no mesh or hold one in a format that is not read; the white space before is skipped.
_OTHERS: tuple[tuple[bytes, str, str], ...] = (
    (b"\x1f\x8b", "a gzip archive", "Unpack it first."),
    (b"BZh", "a bzip2 archive", "Unpack it first."),
    (b"\xfd7zXZ", "an xz archive", "Unpack it first."),
    (b"7z\xbc\xaf", "a 7-Zip archive", "Unpack it first."),
    (b"Rar!", "a RAR archive", "Unpack it first."),
    (b"<!DOCTYPE", "a web page", "Download the mesh itself."),
    (b"<html", "a web page", "Download the mesh itself."),
    (b"<?xml", "an XML file, such as X3D or COLLADA", _CONVERT),
    (b"Kaydara FBX", "an FBX file", _CONVERT),
    (b"; FBX", "an FBX file", _CONVERT),
    (b"BLENDER", "a Blender file", "Export the mesh from Blender as PLY or OBJ."),
    (b"$MeshFormat", "a Gmsh file", _CONVERT),
    (b"MeshVersionFormatted", "a Medit file", _CONVERT),
    (b"# .PCD", "a point cloud (PCD)", _CONVERT),
    (b"#VRML", "a VRML file", _CONVERT),
    (b"#Inventor", "an Open Inventor file", _CONVERT),
    (b"ISO-10303-21", "a STEP file", "Open it in a CAD program and export a triangle mesh."),
    (b"\x89PNG", "a picture (PNG)", _NO_MESH),
    (b"\xff\xd8\xff", "a picture (JPEG)", _NO_MESH),
    (b"GIF8", "a picture (GIF)", _NO_MESH),
    (b"%PDF", "a PDF document", _NO_MESH),
    (b"\x7fELF", "a program", _NO_MESH),
    (b"version https://git-lfs", "a pointer of Git LFS and not the mesh itself", "Fetch the mesh with 'git lfs pull'."),
    (b"newmtl", "a material library (MTL), which holds no mesh", "Choose the OBJ file that belongs to it."),
)
_OTHER_TEXTS: tuple[tuple[bytes, str, str], ...] = (
    (b"<", "an XML file or a web page", _CONVERT),
    (b"{", "a JSON file, but no glTF file", _CONVERT),
    (b"[", "a JSON file", _NO_MESH),
)
_OBJ_VERTEX = re.compile(rb"(?:^|[\r\n])[ \t]*v[ \t]+[+-]?\.?\d")
_FACET = re.compile(rb"facet\s+normal\s", re.IGNORECASE)
_OFF_KEYWORD = re.compile(rb"(?:" + KEYWORD.pattern + rb")(?=\s|$)")
_NUMBER = re.compile(rb"[+-]?\.?\d")
_ZIP_BEGINNINGS = (b"PK\x03\x04", b"PK\x05\x06")
_GLTF_KEY = re.compile(rb'"(?:asset|accessors|bufferViews|buffers)"\s*:')
_BEGINNINGS = {
    **{".ply": "'ply'", ".off": "'OFF'", ".stl": "'solid'", ".glb": "'glTF'", ".gltf": "'{'"},
    **{".3mf": "'PK', as ZIP archives do", ".vtp": "'<VTKFile'", ".vtk": "'# vtk DataFile'"},
}


def recognise(source: SourceFile) -> tuple[Format, tuple[str, ...]]:
    """Return the format of a file, and a note when its extension tells of another.

    Raises:
        FormatError: when the content is of no format that can be read; it says which it looks like.
    """
    found = _by_content(source) or _by_extension(source)
    name = NAMES[found]
    if source.suffix == f".{name.lower()}":
        return found, ()
    if source.suffix:
        shown = show(source.path.suffix.encode(errors="replace"))
        return found, (f"The content is {name}, although the name ends in '{shown}'.",)
    return found, (f"The name has no extension; the content is {name}.",)


def _by_content(source: SourceFile) -> Format | None:
    head = source.head
    n_facets = said_facets(head)
    # First of all, because the first 80 bytes of a binary STL file may be anything.
    if n_facets and source.size == HEADER_BYTES + FACET_BYTES * n_facets:
        return "stl"
    if head.startswith(GLB_MAGIC):
        return "glb"
    if head.startswith(_ZIP_BEGINNINGS):
        return "3mf"
    text = transcode(head).lstrip()
    if text.startswith(VTK_MAGIC):
        return "vtk"
    if _first_element(text) == b"VTKFile":
        return "vtp"
    if text.startswith(b"{") and (_GLTF_KEY.search(text) or source.suffix == ".gltf"):
        return "gltf"
    if re.match(rb"ply[ \t]*(?:[\r\n]|$)", text):
        return "ply"
    is_text = b"\0" not in text
    # Binary headers often begin with "solid" too.
    if re.match(rb"solid\b", text, re.IGNORECASE) and (_FACET.search(text) or (is_text and source.suffix == ".stl")):
        return "text stl"
    statement = _first_statement(text)
    keyword = statement.split(None, 1)[0] if statement else b""
    if _OFF_KEYWORD.match(statement):
        return "off"
    for beginning, name, remedy in (*_OTHERS, *(_OTHER_TEXTS if is_text else ())):
        if any(start[: len(beginning)].lower() == beginning.lower() for start in (text, statement)):
            raise FormatError(f"this is {name}", remedy)
    if keyword in STATEMENTS and (_OBJ_VERTEX.search(text) or source.suffix == ".obj"):
        return "obj"
    return None


def _by_extension(source: SourceFile) -> Format:
    """Decide about a file whose content shows no format.

    Raises:
        FormatError: unless it may be a damaged or unusual file of the format that its extension tells.
    """
    text = transcode(source.head)
    shown = show(text.split(None, 1)[0]) if text.strip(b"\0 \t\r\n") and encoding_of(source.head) == "utf-8" else ""
    if not source.head.strip(b"\0"):
        raise FormatError(
            f"the first {len(source.head):,} of {source.size:,} bytes are zeros, so it was never written",
            "Save or copy it again from where it came from.",
        )
    is_text = b"\0" not in text
    if source.suffix == ".stl" and not is_text:
        return "stl"
    if source.suffix == ".obj" and is_text:
        return "obj"
    if source.suffix == ".off" and is_text and _NUMBER.match(_first_statement(text)):
        return "off"
    begins = f"; it begins with '{shown}'" if shown and is_text else ""
    if source.suffix in _BEGINNINGS:
        raise FormatError(
            f"this is no {source.suffix[1:].upper()} file: it does not begin with {_BEGINNINGS[source.suffix]}{begins}",
            "Check whether it is the right file, or save it again in the program it came from.",
        )
    if source.suffix == ".obj":
        raise FormatError(
            "this is no OBJ file: it is not a text", "Check whether it is the right file; a text has to be UTF-8."
        )
    raise FormatError(f"the format is unknown{begins}", _CONVERT)


def _first_element(text: bytes) -> bytes:
    """Return the name of the first element of an XML text; nothing when it is no XML."""
    position = 0
    while text.startswith((b"<?", b"<!--"), position):
        close = b"?>" if text.startswith(b"<?", position) else b"-->"
        end = text.find(close, position)
        if end < 0:
            return b""
        position = end + len(close)
        position += len(text[position:]) - len(text[position:].lstrip())
    match = re.compile(rb"<([\w.:-]+)").match(text, position)
    return match[1] if match else b""


def _first_statement(text: bytes) -> bytes:
    """Return the first line that is neither blank nor a remark, without the white space before it."""
    for line in re.split(rb"[\r\n]+", text):
        content = line.strip()
        if content and not content.startswith(b"#"):
            return content
    return b""
