"""One model part of a 3MF file: its objects with their vertices and triangles, and what is to be built."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.formats.source import FormatError
from dmp.formats.text import not_a_number, parse_all, show, token_counts
from dmp.formats.xml_events import XmlEvents
from dmp.mesh import FloatArray, IntArray

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
# Extensions that change how a mesh looks or is made, not its vertices and triangles.
_HARMLESS = (
    CORE,
    PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
)
UNITS = {
    "micron": "micrometres",
    "millimeter": "millimetres",
    "centimeter": "centimetres",
    "inch": "inches",
    "foot": "feet",
    "meter": "metres",
}
_VERTEX, _TRIANGLE, _OBJECT = f"{CORE} vertex", f"{CORE} triangle", f"{CORE} object"
_VERTICES, _TRIANGLES = f"{CORE} vertices", f"{CORE} triangles"
_NUMBER = re.compile(rb"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_INDEX = re.compile(r"[0-9]{1,18}")
_MAXIMUM_OBJECTS = 20_000
_RESAVE = "Save or copy the file again from where it came from."

_OTHER_ELEMENTS = {"metadata", "metadatagroup", "resources", "basematerials", "base", "mesh", "vertices", "triangles"}
_OTHER_ELEMENTS |= {"components", "build"}
_PARENTS = {"resources": "model", "build": "model", "mesh": "object", "components": "object"}
_ONCE = {"mesh", "vertices", "triangles", "components"}
_OBJECT_ATTRIBUTES = {"id", "type", "thumbnail", "partnumber", "name", "pid", "pindex"}
# Slicers write "printable" without a namespace.
_PLACE_ATTRIBUTES = {"objectid", "transform", "partnumber", "printable"}

Key = tuple[str, str]


@dataclass(frozen=True)
class Reference:
    """A place of an object: which part of the archive and which object in it, and 12 numbers that place it.

    Attributes:
        key: the name of the part and the number of the object.
        transform: the first three rows turn and scale row vectors, the last one moves them, (4, 3).
        where: what to call it in messages.
    """

    key: Key
    transform: FloatArray
    where: str


@dataclass
class ModelObject:
    """An object: a mesh of its own, or places of other objects."""

    where: str
    vertices: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    triangles: IntArray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    components: list[Reference] = field(default_factory=list)


class ModelPart:
    """Reads a model part.

    Attributes:
        unit: one of :data:`UNITS`.
        objects: by their numbers.
        items: what is to be built.
        has_materials: whether triangles refer to colours or materials.
        foreign: namespaces of other elements in the objects.
        notes: a full sentence when something is doubtful.
    """

    def __init__(self, name: str, content: bytes, maximum_elements: int) -> None:
        self.name = name
        self.unit = "millimeter"
        self.objects: dict[str, ModelObject] = {}
        self.items: list[Reference] = []
        self.has_materials = False
        self.foreign: set[str] = set()
        self.notes: list[str] = []
        self._events = XmlEvents(f"the part '{show(name.encode(errors='replace'))}'", maximum_elements, namespaces=True)
        self._path: list[str] = []
        self._met: set[str] = set()
        self._prefixes: dict[str, str] = {}
        self._object: ModelObject | None = None
        self._coordinates: list[str] = []
        self._corners: list[str] = []
        self._events.parse(content, self._start, self._end, self._prefixes.__setitem__)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        path = self._path
        parent = path[-1] if path else ""
        path.append(name)
        if name == _VERTEX and parent == _VERTICES:
            try:
                self._coordinates += (attributes["x"], attributes["y"], attributes["z"])
            except KeyError as missing:
                raise self._events.error(f"'vertex' has no {missing}") from None
        elif name == _TRIANGLE and parent == _TRIANGLES:
            try:
                self._corners += (attributes["v1"], attributes["v2"], attributes["v3"])
            except KeyError as missing:
                raise self._events.error(f"'triangle' has no {missing}") from None
            if "pid" in attributes or "p1" in attributes:
                self.has_materials = True
        elif not parent:
            if name != f"{CORE} model":
                raise self._events.error("the part is no 3MF model of the core specification", "Export the file again as 3MF.")
            self._begin_model(attributes)
        else:
            self._start_other(name, parent, attributes)

    def _start_other(self, name: str, parent: str, attributes: dict[str, str]) -> None:
        space, _, local = name.rpartition(" ")
        if space != CORE:
            if self._object is not None:
                self.foreign.add(space)
        elif local == "object" and parent == f"{CORE} resources":
            number = self._get(attributes, "id")
            if number in self.objects:
                raise self._events.error(f"there are two objects {show(number.encode(errors='replace'))}")
            if len(self.objects) == _MAXIMUM_OBJECTS:
                raise self._events.error(
                    f"there are more than {_MAXIMUM_OBJECTS:,} objects", "Save only the part that you need."
                )
            self._object = ModelObject(f"object {show(number.encode(errors='replace'))} of {self._events.where}")
            self.objects[number] = self._object
            self._met.clear()
            self._note_unknown(attributes, _OBJECT_ATTRIBUTES)
            self.has_materials |= "pid" in attributes
        elif local == "component" and parent == f"{CORE} components" and self._object is not None:
            self._object.components.append(self._reference(attributes, self._object.where))
        elif local == "item" and parent == f"{CORE} build":
            self.items.append(self._reference(attributes, "an item that is to be built"))
        elif local in ("vertices", "triangles") and (parent != f"{CORE} mesh" or self._object is None):
            raise self._events.error(f"'{local}' stand outside of a mesh")
        elif local in _PARENTS and parent != f"{CORE} {_PARENTS[local]}":
            raise self._events.error(f"'{local}' is out of place")
        elif local in _ONCE and local in self._met:
            # The triangles of a second mesh would be taken for those of the first one.
            raise self._events.error(f"the object has '{local}' twice")
        elif local in ("vertex", "triangle"):
            raise self._events.error(f"a {local} is out of place")
        elif local not in _OTHER_ELEMENTS:
            raise self._events.error(f"'{show(local.encode(errors='replace'))}' is no element of 3MF")
        if space == CORE:
            self._met.add(local)

    def _end(self, name: str) -> None:
        self._path.pop()
        if name == _OBJECT and self._object is not None:
            found, self._object = self._object, None
            if not self._coordinates and not self._corners:
                return
            found.vertices = self._numbers(self._coordinates, np.float64, found.where, "vertex").reshape(-1, 3)
            found.triangles = self._numbers(self._corners, np.int64, found.where, "triangle").reshape(-1, 3)
            if found.components and len(found.triangles):
                raise self._events.error("an object has both a mesh and components")
            self._check_corners(found)
            self._coordinates, self._corners = [], []

    def _begin_model(self, attributes: dict[str, str]) -> None:
        self.unit = attributes.get("unit", "millimeter")
        if self.unit not in UNITS:
            raise self._events.error(f"the unit '{show(self.unit.encode(errors='replace'))}' is unknown")
        for prefix in attributes.get("requiredextensions", "").split():
            address = self._prefixes.get(prefix, prefix)
            if address not in _HARMLESS:
                raise self._events.error(
                    f"the file cannot be understood without the extension '{show(address.encode(errors='replace'))}'",
                    "Export it as plain 3MF without extensions, or as STL.",
                )

    def _get(self, attributes: dict[str, str], key: str) -> str:
        value = attributes.get(key)
        if value is None:
            raise self._events.error(f"'{self._path[-1].rpartition(' ')[2]}' has no '{key}'")
        return value

    def _note_unknown(self, attributes: dict[str, str], known: set[str]) -> None:
        """Note an attribute that 3MF does not know: it may be one that is damaged, such as "tranzform"."""
        for name in attributes:
            if " " not in name and name not in known and not self.notes:
                shown = show(name.encode(errors="replace"))
                place = f"{self._events.where}, {self._path[-1].rpartition(' ')[2]}"
                self.notes.append(f"Ignored '{shown}' in {place}, which 3MF does not know; the file may be damaged.")

    def _reference(self, attributes: dict[str, str], where: str) -> Reference:
        self._note_unknown(attributes, _PLACE_ATTRIBUTES)
        part = attributes.get(f"{PRODUCTION} path", self.name)
        transform = np.vstack([np.eye(3), np.zeros(3)])
        text = attributes.get("transform")
        if text is not None:
            tokens = text.encode(errors="replace").split()
            if len(tokens) != 12 or not all(_NUMBER.fullmatch(token) for token in tokens):
                raise self._events.error("a transform is not 12 numbers")
            transform = np.array([float(token) for token in tokens]).reshape(4, 3)
            if not np.isfinite(transform).all():
                raise self._events.error("a transform has a number that is too large")
        return Reference((part, self._get(attributes, "objectid")), transform, where)

    def _numbers(self, values: list[str], dtype: type, where: str, what: str) -> NDArray:
        """Return texts as numbers, each of which must be one finite number, or one whole number without sign."""
        text = ("\n".join(values) + "\n").encode(errors="replace") if values else b""
        counts = token_counts(np.frombuffer(text, dtype=np.uint8)) if values else np.zeros(0)
        if len(counts) == len(values) and (counts == 1).all():
            numbers = parse_all(text, len(values), dtype)
            if numbers is not None and np.isfinite(numbers).all():
                return numbers
        for index, value in enumerate(values):
            token = value.strip(" \t\r\n").encode(errors="replace")
            place = f"{where}, {what} {index // 3:,}"
            if dtype is np.int64 and not _INDEX.fullmatch(value.strip(" \t\r\n")):
                raise FormatError(f"{place}: '{show(token)}' is not the index of a vertex", _RESAVE)
            if not _NUMBER.fullmatch(token):
                raise FormatError(str(not_a_number(token, 0).cause).replace("line 0", place), _RESAVE)
            if not np.isfinite(float(token)):
                raise FormatError(f"{place}: the number '{show(token)}' is too large", "Scale the mesh before saving it.")
        raise FormatError(f"{where}: a number of a {what} cannot be read", _RESAVE)

    def _check_corners(self, found: ModelObject) -> None:
        n = len(found.vertices)
        good = ((found.triangles >= 0) & (found.triangles < n)).all(axis=1)
        if not good.all():
            row = int(good.argmin())
            corners = ", ".join(map(str, found.triangles[row].tolist()))
            raise FormatError(
                f"{found.where}, triangle {row:,}: it refers to the vertices {corners}, but there are {n:,}, counted from 0",
                _RESAVE,
            )

    def extensions(self) -> list[str]:
        """Return short names of the extensions whose elements were left out, such as "beamlattice"."""
        return sorted({_short(space) for space in self.foreign if space not in _HARMLESS})


def _short(address: str) -> str:
    parts = [part for part in address.split("/") if part and not part[0].isdigit()]
    return show((parts[-1] if parts else address).encode(errors="replace"))
