"""The tree of nodes of a glTF 2.0 file: which meshes are placed, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.formats.assemble import counted
from dmp.formats.json_items import Item
from dmp.formats.source import FormatError
from dmp.mesh import FloatArray

_MAXIMUM_NODES = 100_000
_RESAVE = "Save or copy the file again from where it came from."


@dataclass(frozen=True)
class Placed:
    """A mesh at its place.

    Attributes:
        mesh: its number.
        matrix: from its own coordinates to those of the scene, (4, 4), for columns.
    """

    mesh: int
    matrix: FloatArray

    @property
    def mirrors(self) -> bool:
        """Whether the place turns a mesh inside out, so that its faces have to be turned round."""
        return bool(np.linalg.det(self.matrix[:3, :3]) < 0)

    def apply(self, positions: FloatArray) -> FloatArray:
        """Return positions (V, 3) in the coordinates of the scene; unchanged to the last bit where nothing moves them."""
        if np.array_equal(self.matrix, np.eye(4)):
            return positions
        placed = positions @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        if not np.isfinite(placed).all():
            raise FormatError("a node places a mesh beyond the range of numbers", _RESAVE)
        return placed


def placed_meshes(document: Item, notes: list[str]) -> list[Placed]:
    """Return the meshes of the default scene in the order of the tree, each before those of the children of its node.

    Without scenes all nodes count, and without nodes all meshes, each at its own place.

    Args:
        document: the JSON text.
        notes: receives sentences on what is left out.

    Raises:
        FormatError: when a node has two parents or is its own ancestor, or a matrix is none.
    """
    if not document.n_items("meshes"):
        raise FormatError("the file holds no meshes", "Choose a file that holds a triangle mesh.")
    if not document.n_items("nodes"):
        named = [node for scene in document.items("scenes", "scene") for node in scene.indices("nodes")]
        if named:
            raise FormatError(f"a scene names node {named[0]:,}, but there are none", _RESAVE)
        notes.append("The file places its meshes nowhere; all were read as they are.")
        return [Placed(mesh, np.eye(4)) for mesh in range(document.n_items("meshes"))]
    tree = _Tree(document)
    n_scenes = document.n_items("scenes")
    if n_scenes:
        chosen = document.integer("scene", 0)
        roots = document.entry("scenes", chosen, "scene").indices("nodes")
        if n_scenes > 1:
            notes.append(f"Read scene {chosen:,} of {n_scenes:,}; the others were left out.")
    else:
        roots = tuple(node for node in range(len(tree.nodes)) if tree.parents[node] < 0)
    placed = tree.walk(roots, notes)
    n_left_out = document.n_items("meshes") - len({place.mesh for place in placed})
    if not placed:
        raise FormatError("the scene of the file shows no mesh", "Export the mesh again, as a part of the scene.")
    if n_left_out:
        notes.append(f"Left out {counted(n_left_out, 'mesh', 'meshes')} that the scene does not show.")
    return placed


class _Tree:
    """The nodes, each of which has one parent at most."""

    def __init__(self, document: Item) -> None:
        if document.n_items("nodes") > _MAXIMUM_NODES:
            raise FormatError(
                f"the file has {document.n_items('nodes'):,} nodes; at most {_MAXIMUM_NODES:,} can be read",
                "Join its parts into one mesh in the program that they come from.",
            )
        self.nodes = list(document.items("nodes", "node"))
        self.parents = [-1] * len(self.nodes)
        for index, node in enumerate(self.nodes):
            for child in node.indices("children"):
                if child >= len(self.nodes):
                    raise FormatError(f"{node.where} has the child {child:,}, but there are {len(self.nodes):,} nodes", _RESAVE)
                if self.parents[child] >= 0:
                    raise FormatError(f"node {child:,} has two parents", _RESAVE)
                self.parents[child] = index

    def walk(self, roots: tuple[int, ...], notes: list[str]) -> list[Placed]:
        """Return the meshes below the roots.

        A node that is no root of the tree but is named as one is refused: with one parent for each node, that is the
        only way to come to a node twice or to go in a circle.
        """
        if len(set(roots)) < len(roots):
            raise FormatError("the scene names a node twice", _RESAVE)
        placed: list[Placed] = []
        skinned = False
        pending = [(root, np.eye(4)) for root in reversed(roots)]
        for root in roots:
            if root >= len(self.nodes):
                raise FormatError(f"the scene names node {root:,}, but there are {len(self.nodes):,}", _RESAVE)
            if self.parents[root] >= 0:
                raise FormatError(f"the scene names node {root:,}, which is the child of another node", _RESAVE)
        while pending:
            index, above = pending.pop()
            node = self.nodes[index]
            matrix = above @ _local(node)
            if not np.isfinite(matrix).all():
                raise FormatError(f"{node.where}: its place is beyond the range of numbers", _RESAVE)
            if node.has("mesh"):
                if "EXT_mesh_gpu_instancing" in node.item("extensions").values:
                    raise FormatError(
                        f"{node.where} repeats its mesh with EXT_mesh_gpu_instancing, which cannot be read",
                        "Export each copy as a mesh, or the part once.",
                    )
                skinned |= node.has("skin")
                # The skeleton alone places a mesh that hangs on it.
                placed.append(Placed(node.integer("mesh"), np.eye(4) if node.has("skin") else matrix))
            pending.extend((child, matrix) for child in reversed(node.indices("children")))
        if skinned:
            notes.append("The mesh hangs on a skeleton; it was read as it is without it.")
        return placed


def _local(node: Item) -> FloatArray:
    """Return the matrix (4, 4) from the coordinates of a node to those of its parent."""
    if node.has("matrix"):
        matrix = np.array(node.numbers("matrix", 16)).reshape(4, 4).T  # the file has columns one after the other
        if (matrix[3] != [0, 0, 0, 1]).any():
            raise FormatError(f"{node.where}: the last row of its matrix is not 0 0 0 1", _RESAVE)
        return matrix
    if not (node.has("translation") or node.has("rotation") or node.has("scale")):
        return np.eye(4)
    x, y, z, w = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    length = float(np.sqrt(x * x + y * y + z * z + w * w))
    if not 0.9 < length < 1.1:
        raise FormatError(f"{node.where}: its rotation is no unit quaternion", _RESAVE)
    x, y, z, w = x / length, y / length, z / length, w / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.numbers("scale", 3, (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    return matrix
