"""glTF 2.0, as GLB or as text with everything embedded (Khronos Group, "glTF 2.0 Specification", 2021).

All meshes of the scene are placed as their nodes tell and become one mesh. glTF repeats a vertex wherever its normal,
texture coordinate or colour changes; vertices at exactly the same place are joined again, in the order in which they
first appear, as for STL.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.gltf_accessors import Accessors
from dmp.formats.gltf_container import read_container, unknown_entries
from dmp.formats.gltf_nodes import Placed, placed_meshes
from dmp.formats.json_items import Item
from dmp.formats.limits import check_repeated
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.strips import unroll_fan, unroll_strips
from dmp.formats.text import show
from dmp.formats.weld import join_equal
from dmp.formats.zero_runs import refuse_unwritten_end
from dmp.mesh import FloatArray, IntArray

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MAXIMUM_PRIMITIVES = 20_000
_DRACO = "KHR_draco_mesh_compression"
_QUANTISED = "KHR_mesh_quantization"
# Extensions that a file may require and that do not change where its vertices are.
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
_RESAVE = "Save or copy the file again from where it came from."
_UNCOMPRESSED = "Export it without compression, for example as plain GLB."


def read_gltf(source: SourceFile) -> PolygonMesh:
    """Read a GLB or glTF file.

    Positions are read as they are stored, mostly in single precision, and placed in double precision. The colours
    ``COLOR_0`` become the attribute ``color`` when all vertices have some of the same type.

    Raises:
        FormatError: with the entry of the file or the byte, when something is damaged, compressed, lies in another file,
            or would become far larger than the file.
    """
    container = read_container(source)
    document = container.document
    _check_version(document)
    container.notes.extend(unknown_entries(document))
    quantised = _QUANTISED in (*document.texts("extensionsUsed"), *document.texts("extensionsRequired"))
    collector = _Collector(document, Accessors(container), quantised)
    placed = placed_meshes(document, container.notes)
    check_repeated(*collector.extent(placed), source.size)
    for place in placed:
        collector.add(place)
    return collector.polygon_mesh(container.notes)


def _check_version(document: Item) -> None:
    asset = document.item("asset")
    version = asset.text("version", "missing")
    minimum = asset.text("minVersion", "2.0")
    if not version.startswith("2.") or minimum != "2.0":
        raise FormatError(
            f"the file is glTF of version {show(version.encode(errors='replace'))}; version 2.0 can be read",
            "Export it as glTF 2.0, best as GLB.",
        )
    for name in document.texts("extensionsRequired"):
        if name not in (_DRACO, _QUANTISED) and not name.startswith(_HARMLESS) and "meshopt" not in name:
            raise FormatError(
                f"the file cannot be understood without the extension '{show(name.encode(errors='replace'))}'",
                "Export it without that extension, or as PLY.",
            )


@dataclass(frozen=True)
class _Part:
    """A primitive with faces, at its own place.

    Attributes:
        where: what to call it in messages.
        positions: its vertices, (n, 3); empty when an earlier primitive of the mesh has the same ones.
        colours: their colours, (n, 3) or (n, 4), or None.
        triangles: corners, counted from the first vertex of the mesh, (m, 3).
    """

    where: str
    positions: FloatArray
    colours: np.ndarray | None
    triangles: IntArray


class _Collector:
    """All primitives read so far, placed."""

    def __init__(self, document: Item, accessors: Accessors, quantised: bool) -> None:
        self.document = document
        self.accessors = accessors
        self.quantised = quantised
        self.parts: dict[int, list[_Part]] = {}
        self.vertices: list[FloatArray] = []
        self.colours: list[np.ndarray | None] = []
        self.faces: list[IntArray] = []
        self.places: list[str] = []
        self.n_vertices = 0
        self.left_out = {"points": 0, "lines": 0}
        self.others = self.shapes = False

    def extent(self, placed: list[Placed]) -> tuple[int, int]:
        """Return how many vertices and corners all placed meshes have together, as the file tells; nothing is read yet.

        Raises:
            FormatError: when there are more than 20,000 primitives.
        """
        n_placed = Counter(place.mesh for place in placed)
        n_vertices = n_corners = n_primitives = 0
        for mesh, n in n_placed.items():
            sources: dict[tuple[int, int], int] = {}
            for primitive in self._primitives(mesh):
                key = _vertex_source(primitive)
                sources[key] = self.accessors.count(key[0])
                counted_by = primitive.integer("indices") if primitive.has("indices") else key[0]
                is_list = primitive.integer("mode", _TRIANGLES) == _TRIANGLES
                n_corners += n * self.accessors.count(counted_by) * (1 if is_list else 3)
                n_primitives += n
            n_vertices += n * sum(sources.values())
        if n_primitives > _MAXIMUM_PRIMITIVES:
            raise FormatError(
                f"the scene shows {n_primitives:,} parts; at most {_MAXIMUM_PRIMITIVES:,} can be read",
                "Join the parts into one mesh in the program that they come from, or save only the one that you need.",
            )
        return n_vertices, n_corners

    def _primitives(self, mesh: int) -> Iterator[Item]:
        """Yield the primitives of a mesh that have faces."""
        item = self.document.entry("meshes", mesh, "mesh")
        for index, primitive in enumerate(item.items("primitives", "primitive")):
            mode = primitive.integer("mode", _TRIANGLES)
            if mode > _FAN:
                raise FormatError(f"mesh {mesh:,}, primitive {index:,}: the mode {mode} is unknown", _RESAVE)
            if not primitive.item("attributes").has("POSITION"):
                raise FormatError(f"mesh {mesh:,}, primitive {index:,} has no positions", _RESAVE)
            if mode >= _TRIANGLES:
                yield Item(primitive.values, f"mesh {mesh:,}, primitive {index:,}")

    def add(self, placed: Placed) -> None:
        """Add a mesh at its place."""
        if placed.mesh not in self.parts:
            self.parts[placed.mesh] = self._read(placed.mesh)
        first = self.n_vertices
        for part in self.parts[placed.mesh]:
            if len(part.positions):
                self.vertices.append(placed.apply(part.positions))
                self.colours.append(part.colours)
                self.n_vertices += len(part.positions)
            self.faces.append((part.triangles[:, ::-1] if placed.mirrors else part.triangles) + first)
            self.places.append(part.where)

    def _read(self, mesh: int) -> list[_Part]:
        for primitive in self.document.entry("meshes", mesh, "mesh").items("primitives", "primitive"):
            mode = primitive.integer("mode", _TRIANGLES)
            if mode < _TRIANGLES:
                self.left_out["points" if mode == 0 else "lines"] += 1
        # Primitives often share their vertices; these are taken once, so that they stay in the order of the file.
        first_of: dict[tuple[int, int], tuple[int, int]] = {}
        parts: list[_Part] = []
        n_vertices = 0
        for primitive in self._primitives(mesh):
            key = _vertex_source(primitive)
            positions, colours = np.zeros((0, 3)), None
            if key not in first_of:
                positions, colours = self._vertices(primitive, key)
                first_of[key] = n_vertices, len(positions)
                n_vertices += len(positions)
            first, n = first_of[key]
            parts.append(_Part(primitive.where, positions, colours, self._triangles(primitive, n) + first))
            names = primitive.item("attributes").values.keys()
            self.others |= any(name not in ("POSITION", "COLOR_0") for name in names)
            self.shapes |= bool(primitive.n_items("targets"))
        return parts

    def _vertices(self, primitive: Item, key: tuple[int, int]) -> tuple[FloatArray, np.ndarray | None]:
        compressed = _DRACO in primitive.item("extensions").values
        # Where it is required, whatever stands beside the compressed data is no copy of them.
        required = _DRACO in self.document.texts("extensionsRequired")
        if compressed and (required or not self.accessors.has_data(key[0])):
            raise FormatError("the mesh is compressed with Draco, which cannot be read", _UNCOMPRESSED)
        positions = self.accessors.positions(key[0], quantised=self.quantised)
        colours = self.accessors.colours(key[1]) if key[1] >= 0 else None
        if colours is not None and len(colours) != len(positions):
            raise FormatError(
                f"{primitive.where}: there are {len(positions):,} positions but {len(colours):,} colours", _RESAVE
            )
        return positions, colours

    def _triangles(self, primitive: Item, n_vertices: int) -> IntArray:
        indices = self.accessors.indices(primitive.integer("indices")) if primitive.has("indices") else np.arange(n_vertices)
        if indices.max() >= n_vertices:
            corner = int((indices >= n_vertices).argmax())
            raise FormatError(
                f"{primitive.where}: corner {corner:,} refers to vertex {int(indices[corner]):,}, but there are "
                f"vertices 0 to {n_vertices - 1:,}",
                _RESAVE,
            )
        if primitive.has("indices"):
            refuse_unwritten_end(indices, np.array([len(indices)]), f"{primitive.where}, corners")
        mode = primitive.integer("mode", _TRIANGLES)
        if mode == _STRIP:
            return unroll_strips(indices, np.array([len(indices)]))[0]
        if mode == _FAN:
            return unroll_fan(indices)
        if len(indices) % 3:
            raise FormatError(f"{primitive.where}: {len(indices):,} corners are not whole triangles", _RESAVE)
        return indices.reshape(-1, 3)

    def polygon_mesh(self, notes: list[str]) -> PolygonMesh:
        """Return everything added, vertices at the same place joined."""
        if not self.faces:
            points, lines = self.left_out["points"], self.left_out["lines"]
            held = f" ({counted(points, 'point cloud')}, {counted(lines, 'set')} of lines)" if points or lines else ""
            raise FormatError(f"the file holds no faces{held}", "Choose a file that holds a triangle mesh.")
        for what, n in self.left_out.items():
            if n:
                notes.append(f"Left out {counted(n, 'set')} of {what}.")
        if self.others:
            notes.append("Texture coordinates, normals and the like of the file were left out.")
        if self.shapes:
            notes.append("Further shapes of the mesh (morph targets) were left out.")
        notes.extend(dict.fromkeys(self.accessors.notes))
        vertices = np.concatenate(self.vertices)
        faces = np.concatenate(self.faces)
        first, kinds = join_equal(vertices)
        colours = self._all_colours(notes)
        if len(first) < len(vertices):
            notes.append(
                f"Joined {counted(len(vertices), 'vertex', 'vertices')}, some of them at the same place, into {len(first):,}."
            )
            if colours is not None and (colours[first][kinds] != colours).any():
                notes.append("Where joined vertices had different colours, the first was kept.")
        ends = np.cumsum([len(triangles) for triangles in self.faces])

        def place(face: int) -> str:
            block = int(np.searchsorted(ends, face, side="right"))
            return f"{self.places[block]}, triangle {face - int(ends[block]) + len(self.faces[block]):,}"

        return PolygonMesh(
            vertices=vertices[first],
            corners=kinds[faces].ravel(),
            counts=np.full(len(faces), 3, dtype=np.int64),
            place=place,
            attributes={} if colours is None else {"color": colours[first]},
            notes=notes,
        )

    def _all_colours(self, notes: list[str]) -> np.ndarray | None:
        found = [colours for colours in self.colours if colours is not None]
        if not found:
            return None
        if len(found) < len(self.colours) or len({(colours.dtype, colours.shape[1]) for colours in found}) > 1:
            notes.append("Colours were left out, because not all vertices have one of the same kind.")
            return None
        return np.concatenate(found)


def _vertex_source(primitive: Item) -> tuple[int, int]:
    """Return the accessors of positions and colours; -1 without colours."""
    attributes = primitive.item("attributes")
    return attributes.integer("POSITION"), attributes.integer("COLOR_0") if attributes.has("COLOR_0") else -1
