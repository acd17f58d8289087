"""What ``dmp info`` and the application tell about a mesh."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from dmp.errors import MeshError
from dmp.geometry import face_areas, mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.problem import check_trainable
from dmp.topology import topology_report, unique_edges


def describe_mesh(mesh: TriangleMesh) -> dict[str, Any]:
    """Return counts, sizes (units of the file) and whether the mesh can be trained on, as plain values for JSON."""
    report = topology_report(mesh)
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
    if values["attributes"]:
        lines.append(f"  vertex attributes   {', '.join(values['attributes'])}")
    lines += [f"  note                {note}" for note in values["notes"]]
    lines.append(f"  training            {'possible' if values['trainable'] else 'not possible: ' + values['obstacle']}")
    return "\n".join(lines)
