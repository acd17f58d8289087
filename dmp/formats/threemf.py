"""3MF (3MF Consortium, "3D Manufacturing Format Core Specification", version 1.3), with the production extension.

All objects that are to be built are placed as the file tells and become one mesh; the vertices keep their order, and
an object that is built twice is there twice.
"""

from __future__ import annotations

from urllib.parse import unquote

import numpy as np

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.limits import check_repeated
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import show
from dmp.formats.threemf_model import UNITS, Key, ModelObject, ModelPart, Reference
from dmp.formats.xml_events import XmlEvents
from dmp.formats.zip_parts import ZipParts
from dmp.mesh import FloatArray

_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_RELATIONS = "_rels/.rels"
_MAXIMUM_RELATIONS = 1000
_MAXIMUM_DEPTH = 64
_MAXIMUM_PLACED = 20_000
_SMALLEST_ELEMENTS = 300_000
_RESAVE = "Save or copy the file again from where it came from."


def read_threemf(source: SourceFile) -> PolygonMesh:
    """Read a 3MF file.

    Raises:
        FormatError: with the part of the archive and its line, when something is damaged, needs an extension that is
            not known, or would become far larger than the file.
    """
    package = _Package(ZipParts(source))
    notes: list[str] = []
    roots = package.roots(notes)
    n_vertices = n_corners = n_placed = 0
    for root in roots[:_MAXIMUM_PLACED]:
        package.find(root)
        extent = package.extent(root.key, 0)
        n_vertices, n_corners, n_placed = n_vertices + extent[0], n_corners + extent[1], n_placed + extent[2]
    check_repeated(n_vertices, n_corners, source.size)
    n_placed += len(roots[_MAXIMUM_PLACED:])
    if n_placed > _MAXIMUM_PLACED:
        raise FormatError(
            f"the file places {n_placed:,} objects; at most {_MAXIMUM_PLACED:,} can be read",
            "Save only the part of it that you need.",
        )
    vertices: list[FloatArray] = [np.zeros((0, 3))]
    faces = [np.zeros((0, 3), dtype=np.int64)]
    places: list[str] = [""]
    first = 0
    pending = [(root, np.eye(3), np.zeros(3)) for root in reversed(roots)]
    while pending:
        reference, matrix, shift = pending.pop()
        # Row vectors: the inner place comes first.
        matrix, shift = reference.transform[:3] @ matrix, reference.transform[3] @ matrix + shift
        found = package.find(reference)
        pending.extend((component, matrix, shift) for component in reversed(found.components))
        if not len(found.triangles):
            continue
        is_moved = not (np.array_equal(matrix, np.eye(3)) and not shift.any())
        placed = found.vertices @ matrix + shift if is_moved else found.vertices
        if not np.isfinite(placed).all():
            raise FormatError(f"{found.where} is placed beyond the range of numbers", _RESAVE)
        triangles = found.triangles[:, ::-1] if np.linalg.det(matrix) < 0 else found.triangles
        vertices.append(placed)
        faces.append(triangles + first)
        places.append(found.where)
        first += len(placed)
    corners = np.concatenate(faces)
    ends = np.cumsum([len(triangles) for triangles in faces])

    def place(face: int) -> str:
        block = int(np.searchsorted(ends, face, side="right"))
        return f"{places[block]}, triangle {face - int(ends[block - 1]):,}"

    package.add_notes(notes, len(places) - 1)
    return PolygonMesh(np.concatenate(vertices), corners.ravel(), np.full(len(corners), 3, dtype=np.int64), place, notes=notes)


class _Package:
    """The model parts of an archive, each read when it is first needed."""

    def __init__(self, parts: ZipParts) -> None:
        self.parts = parts
        self.models: dict[str, ModelPart] = {}
        self.extents: dict[Key, tuple[int, int, int]] = {}
        self.root_name = self._find_root()

    def _find_root(self) -> str:
        """Return the name of the part that the archive names as its 3-D model."""
        targets: list[str] = []

        def start(name: str, attributes: dict[str, str]) -> None:
            if (
                name.rpartition(" ")[2] == "Relationship"
                and attributes.get("Type") == _MODEL_TYPE
                and attributes.get("TargetMode") != "External"
            ):
                targets.append(unquote(attributes.get("Target", "")))

        if _RELATIONS in self.parts:
            XmlEvents(f"the part '{_RELATIONS}'", _MAXIMUM_RELATIONS).parse(
                self.parts.read(_RELATIONS), start, lambda name: None
            )
        else:
            targets = [name for name in self.parts.names if name.lower().endswith(".model")][:1]
        if not targets:
            shown = ", ".join(f"'{show(name.encode(errors='replace'))}'" for name in self.parts.names[:3])
            raise FormatError(
                f"this is a ZIP archive but no 3MF file: it names no 3-D model{'; it holds ' + shown if shown else ''}",
                "Unpack it first, and open the mesh that is in it.",
            )
        return targets[0]

    def model(self, name: str) -> ModelPart:
        """Return a model part, read at most once."""
        if name not in self.models:
            content = self.parts.read(name)
            self.models[name] = ModelPart(name, content, max(_SMALLEST_ELEMENTS, self.parts.n_packed))
        return self.models[name]

    def roots(self, notes: list[str]) -> list[Reference]:
        """Return what is to be built; all objects, when nothing is."""
        model = self.model(self.root_name)
        if model.items:
            return model.items
        if model.objects:
            notes.append("The file does not tell what is to be built; all of its objects were read.")
        used = {component.key for found in model.objects.values() for component in found.components}
        identity = np.vstack([np.eye(3), np.zeros(3)])
        keys = [(self.root_name, number) for number in model.objects]
        return [Reference(key, identity, "the file") for key in keys if key not in used]

    def find(self, reference: Reference) -> ModelObject:
        """Return the object that is placed."""
        name, number = reference.key
        found = self.model(name).objects.get(number)
        if found is None:
            raise FormatError(
                f"{reference.where} refers to object {show(number.encode(errors='replace'))}, which is not there", _RESAVE
            )
        return found

    def extent(self, key: Key, depth: int) -> tuple[int, int, int]:
        """Return how many vertices, corners and objects an object becomes, each counted as often as it is placed."""
        if depth > _MAXIMUM_DEPTH:
            raise FormatError("objects are made of each other without end", _RESAVE)
        if key not in self.extents:
            found = self.find(Reference(key, np.zeros((4, 3)), "the file"))
            n_vertices, n_corners, n_placed = len(found.vertices), 3 * len(found.triangles), 1
            for component in found.components:
                self.find(component)
                more = self.extent(component.key, depth + 1)
                n_vertices, n_corners, n_placed = n_vertices + more[0], n_corners + more[1], n_placed + more[2]
            self.extents[key] = n_vertices, n_corners, n_placed
        return self.extents[key]

    def add_notes(self, notes: list[str], n_meshes: int) -> None:
        """Tell the unit, and what was left out.

        Raises:
            FormatError: when parts have different units.
        """
        models = list(self.models.values())
        units = sorted({UNITS[model.unit] for model in models})
        if len(units) > 1:
            raise FormatError(f"its parts have different units: {', '.join(units)}", "Export it again with one unit.")
        notes.append(f"The coordinates are in {units[0]}.")
        notes.extend(note for model in models for note in model.notes)
        if n_meshes > 1:
            notes.append(f"Put together {counted(n_meshes, 'object')} as the file places them.")
        if any(model.has_materials for model in models):
            notes.append("Colours and materials of the file were left out.")
        extensions = sorted({name for model in models for name in model.extensions()})
        if extensions:
            notes.append(f"Left out what extensions of 3MF add to the objects: {', '.join(extensions)}.")
