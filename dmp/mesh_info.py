"""What ``dmp info`` and the application tell about a mesh."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from dmp.boundary import boundary_loops, outer_rims
from dmp.errors import MeshError
from dmp.geometry import mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.mesh_report import mesh_report
from dmp.problem import check_trainable
from dmp.topology import topology_report, unique_edges

_REPAIRS = "'dmp repair' mends it."
# What is mended only on request, and how to ask.
REMEDIES = {
    "boundaries": "'dmp complete' fills the holes.",
    "close vertices": "'dmp repair --weld 0.01' joins them.",
    "non-manifold edges": "'dmp repair --split' takes the sheets apart.",
    "non-manifold vertices": "'dmp repair --split' takes the parts apart.",
    "separate pieces": "'dmp repair --keep-pieces 1' or '--min-faces' drops the small ones.",
}


def describe_mesh(mesh: TriangleMesh) -> dict[str, Any]:
    """Return counts, sizes (units of the file), findings and whether the mesh can be trained on, as plain values for JSON."""
    report, findings, edges = topology_report(mesh), mesh_report(mesh), unique_edges(mesh.faces)
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
        "degenerate_faces": sum(finding.count for finding in findings if finding.kind == "degenerate faces"),
        "mean_edge_length": mean_edge_length(mesh.vertices, edges) if len(edges) else 0.0,
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
        "findings": [finding.values() for finding in findings],
    }


def description_text(values: dict[str, Any]) -> str:
    """Return the description as lines for people."""
    low, high = values["bounding_box"]
    size = " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))
    shape = "closed" if values["closed"] else f"open, {values['boundary_edges']} boundary edges"
    if values["non_manifold_edges"]:
        count = values["non_manifold_edges"]
        shape += f", {count} edge{'s' * (count != 1)} with more than two faces"
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
    return "\n".join([*lines, *finding_lines(values["findings"])])


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what is odd about a mesh and what it means, as lines; ``findings`` as plain values."""
    if not findings:
        return ["  report              nothing odd was found"]
    lines = ["  report"]
    for finding in findings:
        mark = "!" if finding["severity"] == "warning" else "-"
        indent = "      "
        lines += textwrap.wrap(finding["text"], 110, initial_indent=f"    {mark} ", subsequent_indent=indent)
        lines += textwrap.wrap(finding["meaning"], 110, initial_indent=indent, subsequent_indent=indent)
        remedy = REMEDIES.get(finding["kind"], _REPAIRS if finding["remedy"] == "repair" else "")
        if finding["kind"] == "boundaries" and "hole" not in finding["text"]:
            remedy = ""
        lines += [indent + remedy] if remedy else []
    return lines


def _boundary_lines(boundaries: list[dict[str, Any]], most: int = 20) -> list[str]:
    lines = []
    for number, loop in enumerate(boundaries[:most], start=1):
        text = f"{loop['edges']} edges, perimeter {loop['perimeter']:.6g}, size {loop['size']:.6g}, {loop['kind']}"
        lines.append(f"  boundary {number:<10} {text}" + (f": {loop['problem']}" if loop["problem"] else ""))
    if len(boundaries) > most:
        lines.append(f"  boundary            and {len(boundaries) - most} more")
    return lines
