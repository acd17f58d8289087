"""``dmp repair``: mends a mesh before it is restored."""

from __future__ import annotations

import json as json_module
from typing import Annotated

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, check_output, load, refuse_as_output, say
from dmp.commands.options import AsJson, MeshPath, OutPath, Quiet


def repair(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    weld: Annotated[
        float, Parameter(help="Also join vertices nearer to each other than this, in mean edge lengths, such as 0.01.")
    ] = 0.0,
    split: Annotated[
        bool, Parameter(help="Also take the surface apart where it branches or touches itself, so that it is a manifold.")
    ] = False,
    keep_pieces: Annotated[
        int,
        Parameter(
            name=["--keep-pieces", "--keep-components"], help="Keep only so many pieces, those with the most faces; 0: all."
        ),
    ] = 0,
    min_faces: Annotated[int, Parameter(help="Drop separate pieces with fewer faces.")] = 0,
    json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Mend a mesh without changing its shape, and say what was done. The file that is read stays as it is.

    Always: vertices at the same place are joined, faces that are there twice or have no area removed, faces turned to look
    the same way as their neighbours and closed pieces outwards, and vertices without a face removed.
    """
    from dmp.mesh_info import finding_lines
    from dmp.mesh_report import mesh_report
    from dmp.meshio import write_mesh
    from dmp.repair import RepairOptions
    from dmp.repair import repair as mend

    options = RepairOptions(weld, split, keep_pieces, min_faces)
    check_output(output)
    refuse_as_output(output, mesh)
    loaded = load(mesh, quiet)
    repaired = mend(loaded, options)
    notes = write_mesh(output, repaired.mesh)
    left = [finding.values() for finding in mesh_report(repaired.mesh) if finding.severity == "warning"]
    if json:
        values = {
            "mesh": str(mesh),
            "output": str(output),
            "vertices": [loaded.n_vertices, repaired.mesh.n_vertices],
            "faces": [loaded.n_faces, repaired.mesh.n_faces],
            "changes": [{"kind": change.kind, "count": change.count, "text": change.text} for change in repaired.changes],
            "findings_left": left,
        }
        print(json_module.dumps(values, indent=2))
        return EXIT_DONE
    for change in repaired.changes:
        say(change.text, quiet)
    done = "The repaired mesh" if repaired.changes else "Nothing had to be repaired. The mesh"
    size = f"{repaired.mesh.n_vertices:,} vertices and {repaired.mesh.n_faces:,} faces"
    say(" ".join((f"{done} with {size} was written to {output}.", *notes)), quiet)
    if left:
        say("\n".join(["What is left:", *finding_lines(left)[1:]]), quiet)
    return EXIT_DONE
