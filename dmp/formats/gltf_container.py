"""The outside of a glTF 2.0 file: the chunks of a GLB file, or the text of a .gltf file."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from dmp.formats.assemble import counted
from dmp.formats.json_items import Item, parse_json
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import encoding_of, transcode

MAGIC = b"glTF"
_HEADER_BYTES = 12
_CHUNK_HEADER_BYTES = 8
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_RESAVE = "Save or copy the file again from where it came from."


# What the specification allows in each kind of entry that tells where vertices are.
_COMMON = {"name", "extensions", "extras"}
_KNOWN = {
    "accessor": {"bufferView", "byteOffset", "componentType", "normalized", "count", "type", "max", "min", "sparse"},
    "buffer view": {"buffer", "byteOffset", "byteLength", "byteStride", "target"},
    "mesh": {"primitives", "weights"},
    "node": {"camera", "children", "skin", "matrix", "mesh", "rotation", "scale", "translation", "weights"},
    "primitive": {"attributes", "indices", "material", "mode", "targets"},
    "scene": {"nodes"},
}
KNOWN = {kind: frozenset(keys | _COMMON) for kind, keys in _KNOWN.items()}
_LISTS = {"accessors": "accessor", "bufferViews": "buffer view", "meshes": "mesh", "nodes": "node", "scenes": "scene"}


def unknown_entries(document: Item) -> list[str]:
    """Return a note when entries that tell where vertices are have keys that glTF does not know.

    A damaged key would otherwise be taken for one that is not there: "tranzlation" for no translation at all.

    Raises:
        FormatError: when a mesh has no primitives.
    """
    notes: list[str] = []
    for key, kind in _LISTS.items():
        for item in document.items(key, kind):
            parts = [item]
            if kind == "mesh":
                if not item.n_items("primitives"):
                    raise FormatError(f"{item.where} has no primitives", _RESAVE)
                parts += item.items("primitives", "primitive")
            for part in parts:
                unknown = part.unknown(KNOWN["primitive" if part is not item else kind])
                if unknown is not None and not notes:
                    notes.append(f"Ignored '{unknown}' of {item.where}, which glTF does not know; the file may be damaged.")
    return notes


@dataclass(frozen=True)
class Container:
    """What a file holds.

    Attributes:
        document: the JSON text.
        binary: the data that follows it in a GLB file, None where there is none.
        binary_start: at which byte of the file they begin, for messages.
        notes: full sentences on what was left out.
    """

    document: Item
    binary: memoryview | None
    binary_start: int
    notes: list[str]


def read_container(source: SourceFile) -> Container:
    """Read a GLB or glTF file whole.

    Raises:
        FormatError: with the byte, when lengths do not fit the file; with line or byte, when its JSON is damaged.
    """
    source.seek(0)
    content = source.read_exactly(source.size)
    if not content.startswith(MAGIC):
        text = bytes(content) if encoding_of(source.head) == "utf-8" else transcode(bytes(content))
        if b"\0" in text:
            raise FormatError(f"the text has a zero byte at byte {text.index(0):,}, so the file is damaged", _RESAVE)
        return Container(parse_json(text.removeprefix(b"\xef\xbb\xbf"), "the glTF text"), None, 0, [])
    return _read_chunks(content)


def _read_chunks(content: bytearray) -> Container:
    if len(content) < _HEADER_BYTES + _CHUNK_HEADER_BYTES:
        raise FormatError(f"the GLB file ends after {len(content)} bytes, inside its header", _RESAVE)
    _, version, length = struct.unpack_from("<4sII", content)
    if version != 2:
        raise FormatError(f"the GLB file is of version {version}; version 2 can be read", "Export it as glTF 2.0.")
    if length > len(content):
        raise FormatError(
            f"the header tells that the file has {length:,} bytes, but it has {len(content):,}", f"It was cut off. {_RESAVE}"
        )
    notes: list[str] = []
    if surplus := len(content) - length:
        if content[length:].strip(b"\0 \t\r\n"):
            raise FormatError(
                f"byte {length:,}: {counted(surplus, 'byte')} follow after the end that the header tells",
                f"The length is wrong, or the file is damaged. {_RESAVE}",
            )
        notes.append(f"Ignored {counted(surplus, 'byte')} after the end of the mesh.")
    view = memoryview(content).toreadonly()
    document: Item | None = None
    binary, binary_start = None, 0
    position = _HEADER_BYTES
    while position < length:
        if position + _CHUNK_HEADER_BYTES > length:
            raise FormatError(f"byte {position:,}: the file ends inside the header of a chunk", _RESAVE)
        n_bytes, kind = struct.unpack_from("<II", content, position)
        position += _CHUNK_HEADER_BYTES
        if position + n_bytes > length:
            raise FormatError(
                f"byte {position - _CHUNK_HEADER_BYTES:,}: a chunk of {n_bytes:,} bytes goes beyond the end of the file",
                f"It was cut off or is damaged. {_RESAVE}",
            )
        if document is None:
            if kind != _JSON:
                raise FormatError(f"byte {position:,}: the first chunk of the GLB file is not its JSON text", _RESAVE)
            text = bytes(view[position : position + n_bytes]).rstrip(b"\0 ")
            document = parse_json(text, "the JSON text of the GLB file", position)
        elif kind == _BINARY:
            if binary is not None:
                raise FormatError(f"byte {position:,}: the GLB file has a second binary chunk", _RESAVE)
            binary, binary_start = view[position : position + n_bytes], position
        position += n_bytes
    assert document is not None
    return Container(document, binary, binary_start, notes)
