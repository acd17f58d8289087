"""``dmp metrics``, ``info``, ``noise`` and ``smooth``: what is done with a mesh without any training."""

from __future__ import annotations

import json as json_module
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, check_output, load, refuse_as_output, say
from dmp.commands.options import AsJson, MeshPath, OutPath, Quiet
from dmp.errors import SettingsError


def metrics(mesh: MeshPath, reference: MeshPath, /, *, json: AsJson = False) -> int:
    """Compare a mesh with its ground truth: angles between the normals, distances of the vertices and of the surfaces.

    The reference is brought to the scale and place of the mesh first, without rotation; the angles don't depend on that.
    Where the two have other faces, as after a completion, only their surfaces are compared, as they lie. Distances are in
    mean edge lengths of the reference; the Hausdorff distance is the largest from a vertex of one to the other's surface.
    """
    from dmp.metrics import GroundTruth, reference_edge_length, surface_measures

    left, right = load(mesh, quiet=json), load(reference, quiet=json)
    if left.same_connectivity(right):
        truth = GroundTruth.for_input(right, left)
        values: dict[str, Any] = {
            **truth.full_measures(left.vertices),
            "mean_edge_length": truth.edge_length,
            "alignment_scale": truth.alignment.scale,
            "alignment_shift": truth.alignment.shift.tolist(),
        }
    else:
        values = {**surface_measures(left, right), "mean_edge_length": reference_edge_length(right)}
    print(json_module.dumps(values, indent=2) if json else _metrics_text(values))
    return EXIT_DONE


def _metrics_text(values: dict[str, Any]) -> str:
    def three(name: str) -> str:
        return f"{values[name]:.4f} (root mean square {values[f'{name}_rms']:.4f}, at most {values[f'{name}_max']:.3f})"

    lines = []
    if "mad" in values:
        lines += [
            f"mean angular difference  {values['mad']:.3f} degrees ({values['mad_area_weighted']:.3f} weighted by area)",
            f"flipped faces            {100 * values['flipped_faces']:.2f} % (normal more than 90 degrees off)",
            f"mean vertex distance     {three('vertex_error')}",
            "mean distance of the vertices to the other surface",
        ]
    else:
        lines.append("the meshes have other faces, so the distances of vertices to the other surface are measured, as they lie")
    lines += [
        f"  mesh to reference      {three('surface_distance')}",
        f"  reference to mesh      {three('surface_distance_back')}",
        f"Hausdorff distance       {values['hausdorff']:.3f}",
        f"all distances in mean edge lengths of the reference ({values['mean_edge_length']:.6g})",
    ]
    if "alignment_scale" in values:
        lines.append(f"after bringing the reference to scale {values['alignment_scale']:.6g} and moving it")
    return "\n".join(lines)


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
    share: Annotated[float | None, Parameter(help="Impulsive noise: part of the vertices that it hits [0.1].")] = None,
    correlation_steps: Annotated[
        int | None, Parameter(help="Scanner noise: how often it is averaged over neighbours, so that it waves [4].")
    ] = None,
    view: Annotated[
        tuple[float, float, float] | None,
        Parameter(help="Scanner noise: direction X Y Z in which vertices move; along the normals without it."),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Add synthetic noise to a mesh, for experiments."""
    from dmp.meshio import write_mesh
    from dmp.noise import add_noise

    named: dict[str, Any] = {}
    for option, value, owner in (
        ("share", share, "impulsive"),
        ("correlation_steps", correlation_steps, "scanner"),
        ("view", view, "scanner"),
    ):
        if value is None:
            continue
        if kind != owner:
            raise SettingsError(
                f"--{option.replace('_', '-')} belongs to --kind {owner}, and means nothing for {kind} noise. "
                f"Leave it out or choose --kind {owner}."
            )
        named[option] = value
    check_output(output)
    refuse_as_output(output, mesh)
    write_mesh(output, add_noise(load(mesh, quiet), level, kind=kind, seed=seed, **named))
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
    refuse_as_output(output, mesh)
    loaded = load(mesh, quiet)
    write_mesh(output, loaded.with_vertices(laplacian_smoothing(loaded, steps)))
    say(f"{steps} smoothing steps written to {output}.", quiet)
    return EXIT_DONE
