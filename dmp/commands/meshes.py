"""``dmp metrics``, ``info``, ``noise`` and ``smooth``: what is done with a mesh without any training."""

from __future__ import annotations

import json as json_module
from typing import Annotated, Literal

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, check_output, load, say
from dmp.commands.options import AsJson, MeshPath, OutPath, Quiet
from dmp.mesh import TriangleMesh


def metrics(mesh: MeshPath, reference: MeshPath, /, *, json: AsJson = False) -> int:
    """Compare a mesh with its ground truth: angle between the normals, distance of the vertices.

    The reference is brought to the scale and place of the mesh first, without rotation; the angles don't depend on that.
    Where the two have other faces, as after a completion, the distance between their surfaces is measured as they lie.
    """
    from dmp.geometry import face_areas
    from dmp.metrics import GroundTruth, angular_differences

    left, right = load(mesh, quiet=json), load(reference, quiet=json)
    if not left.same_connectivity(right):
        return _surface_metrics(left, right, as_json=json)
    truth = GroundTruth.for_input(right, left)
    angles = angular_differences(left.vertices, truth.normals, left.faces)
    areas = face_areas(truth.mesh.vertices, truth.mesh.faces)
    values = {
        **truth.measures(left.vertices),
        "mad_area_weighted": float((angles * areas).sum() / areas.sum()),
        "mean_edge_length": truth.edge_length,
        "alignment_scale": truth.alignment.scale,
        "alignment_shift": truth.alignment.shift.tolist(),
    }
    if json:
        print(json_module.dumps(values, indent=2))
    else:
        print(f"mean angular difference  {values['mad']:.3f} degrees ({values['mad_area_weighted']:.3f} weighted by area)")
        print(f"mean vertex distance     {values['vertex_error']:.4f} mean edge lengths (of {truth.edge_length:.6g})")
        print(f"after bringing the reference to scale {truth.alignment.scale:.6g} and moving it")
    return EXIT_DONE


def _surface_metrics(mesh: TriangleMesh, reference: TriangleMesh, *, as_json: bool) -> int:
    from dmp.geometry import mean_edge_length
    from dmp.surface_distance import distance_to_surface
    from dmp.topology import unique_edges

    edge_length = mean_edge_length(reference.vertices, unique_edges(reference.faces))
    there = distance_to_surface(mesh.vertices, reference) / edge_length
    back = distance_to_surface(reference.vertices, mesh) / edge_length
    values = {
        "surface_distance": float(there.mean()),
        "surface_distance_max": float(there.max()),
        "surface_distance_back": float(back.mean()),
        "surface_distance_back_max": float(back.max()),
        "mean_edge_length": edge_length,
    }
    if as_json:
        print(json_module.dumps(values, indent=2))
        return EXIT_DONE
    print("the meshes have other faces, so the distances of vertices to the other surface are measured, as the meshes lie:")
    for name, distances in (("mesh to reference", there), ("reference to mesh", back)):
        print(
            f"{name}  {distances.mean():.4f} mean edge lengths (at most {distances.max():.3f}; edge length {edge_length:.6g})"
        )
    return EXIT_DONE


def info(mesh: MeshPath, /, *, json: AsJson = False) -> int:
    """Describe a mesh: size, connectivity, and whether it can be trained on."""
    from dmp.mesh_info import describe_mesh, description_text
    from dmp.meshio import read_mesh_with_notes

    loaded, notes = read_mesh_with_notes(mesh)
    values = {"file": str(mesh), **describe_mesh(loaded), "notes": list(notes)}
    print(json_module.dumps(values, indent=2) if json else description_text(values))
    return EXIT_DONE


def noise(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    level: Annotated[float, Parameter(help="Standard deviation in mean edge lengths.")] = 0.2,
    kind: Annotated[
        Literal["normal", "gaussian", "uniform", "impulsive", "scanner"], Parameter(help="Kind of noise.")
    ] = "gaussian",
    seed: Annotated[int, Parameter(help="Seed of the random numbers.")] = 0,
    quiet: Quiet = False,
) -> int:
    """Add synthetic noise to a mesh, for experiments."""
    from dmp.meshio import write_mesh
    from dmp.noise import add_noise

    check_output(output)
    write_mesh(output, add_noise(load(mesh, quiet), level, kind=kind, seed=seed))
    say(f"Noise '{kind}' of {level:g} mean edge lengths written to {output}.", quiet)
    return EXIT_DONE


def smooth(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    smoothing_steps: Annotated[int, Parameter(help="Number of smoothing steps.")] = 30,
    quiet: Quiet = False,
) -> int:
    """Write the smoothed mesh from which displacements are predicted."""
    from dmp.meshio import write_mesh
    from dmp.settings import check
    from dmp.smoothing import laplacian_smoothing

    steps = check("smoothing_steps", smoothing_steps)
    check_output(output)
    loaded = load(mesh, quiet)
    write_mesh(output, loaded.with_vertices(laplacian_smoothing(loaded, steps)))
    say(f"{steps} smoothing steps written to {output}.", quiet)
    return EXIT_DONE
