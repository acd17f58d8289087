"""What ``dmp info`` and the application tell about a mesh."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from dmp.boundary import boundary_loops, outer_rims
from dmp.errors import MeshError
from dmp.geometry import face_areas, mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.problem import check_trainable
from dmp.topology import topology_report, unique_edges


def describe_mesh(mesh: TriangleMesh) -> dict[str, Any]:
    """Return counts, sizes (units of the file) and whether the mesh can be trained on, as plain values for JSON."""
    report = topology_report(mesh)
    loops = boundary_loops(mesh)
    rims = outer_rims(mesh, loops)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    try:
        check_trainable(mesh)
        obstacle = None
    except MeshError as error:
        obstacle = str(error)
    return {
        **asdict(report),
        "euler_characteristic": report.euler_characteristic,
        "closed": report.is_closed,
        "degenerate_faces": int(np.count_nonzero(face_areas(mesh.vertices, mesh.faces) <= 1e-14 * diagonal**2)),
        "mean_edge_length": mean_edge_length(mesh.vertices, unique_edges(mesh.faces)),
        "bounding_box": [low.tolist(), high.tolist()],
        "diagonal": diagonal,
        "boundaries": [
            {
                "edges": loop.n_edges,
                "perimeter": loop.perimeter,
                "size": loop.size,
                "center": loop.center.tolist(),
                "kind": "outer rim" if index in rims else "hole" if loop.is_simple else "not fillable",
                "problem": loop.problem or None,
            }
            for index, loop in enumerate(loops)
        ],
        "attributes": sorted(mesh.vertex_attributes),
        "trainable": obstacle is None,
        "obstacle": obstacle,
    }


def description_text(values: dict[str, Any]) -> str:
    """Return the description as lines for people."""
    low, high = values["bounding_box"]
    size = " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))
    shape = "closed" if values["closed"] else f"open, {values['boundary_edges']} boundary edges"
    if values["non_manifold_edges"]:
        shape += f", {values['non_manifold_edges']} edges with more than two faces"
    lines = [
        f"{values['file']}",
        f"  vertices            {values['vertices']}",
        f"  faces               {values['faces']}"
        + (f" ({values['degenerate_faces']} without area)" if values["degenerate_faces"] else ""),
        f"  edges               {values['edges']}, mean length {values['mean_edge_length']:.6g}",
        f"  surface             {shape}, {values['components']} component{'s' * (values['components'] != 1)}, "
        f"Euler characteristic {values['euler_characteristic']}",
        f"  valence             {values['valence_min']} to {values['valence_max']}, mean {values['valence_mean']:.2f}",
        f"  size                {size} (diagonal {values['diagonal']:.6g})",
    ]
    lines += _boundary_lines(values["boundaries"])
    if values["attributes"]:
        lines.append(f"  vertex attributes   {', '.join(values['attributes'])}")
    lines += [f"  note                {note}" for note in values["notes"]]
    lines.append(f"  training            {'possible' if values['trainable'] else 'not possible: ' + values['obstacle']}")
    return "\n".join(lines)


def _boundary_lines(boundaries: list[dict[str, Any]], most: int = 20) -> list[str]:
    lines = []
    for number, loop in enumerate(boundaries[:most], start=1):
        text = f"{loop['edges']} edges, perimeter {loop['perimeter']:.6g}, size {loop['size']:.6g}, {loop['kind']}"
        lines.append(f"  boundary {number:<10} {text}" + (f": {loop['problem']}" if loop["problem"] else ""))
    if len(boundaries) > most:
        lines.append(f"  boundary            and {len(boundaries) - most} more")
    return lines
