"""The names of the formats and the extensions of their files: one list for readers, dialogs, help and messages.

Imports nothing, so that help texts can use it without loading NumPy.
"""

from __future__ import annotations

from typing import Literal

Format = Literal["obj", "ply", "stl", "text stl", "off", "glb", "gltf", "3mf", "vtp", "vtk"]

NAMES: dict[Format, str] = {
    "obj": "OBJ",
    "ply": "PLY",
    "stl": "STL",
    "text stl": "STL",
    "off": "OFF",
    "glb": "GLB",
    "gltf": "glTF",
    "3mf": "3MF",
    "vtp": "VTP",
    "vtk": "VTK",
}
READABLE_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".3mf", ".vtp", ".vtk")
WRITABLE_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".vtp")
_READ_NAMES = ("OBJ", "PLY", "STL", "OFF", "GLB", "glTF", "3MF", "VTP", "VTK")


def in_a_row(names: tuple[str, ...], conjunction: str) -> str:
    """Return names as in a sentence, such as "OBJ, PLY or STL"."""
    return f"{', '.join(names[:-1])} {conjunction} {names[-1]}" if len(names) > 1 else names[0]


READABLE_FORMATS = in_a_row(_READ_NAMES, "or")
READ_SENTENCE = f"{in_a_row(_READ_NAMES, 'and')} files can be read"
