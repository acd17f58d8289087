"""``dmp filter``: the classical filters, to compare with."""

from __future__ import annotations

from dataclasses import field, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, check_output, load, refuse_as_output, say
from dmp.commands.options import MeshPath, OutPath, Quiet, given
from dmp.errors import SettingsError
from dmp.filters import FILTERS, FilterParameter, filter_named

if TYPE_CHECKING:
    from dmp.metrics import GroundTruth


def _filter_options() -> Any:
    """Return a dataclass with one optional option for each parameter of any filter; None stands for the default."""
    users: dict[str, list[str]] = {}
    parameters: dict[str, FilterParameter] = {}
    for chosen in FILTERS.values():
        for parameter in chosen.parameters:
            parameters.setdefault(parameter.name, parameter)
            users.setdefault(parameter.name, []).append(f"{chosen.name}: {parameter.default}")
    options = []
    for name, parameter in parameters.items():
        kind = Literal[parameter.choices] if parameter.choices else type(parameter.default)
        text = f"{parameter.help[0].upper()}{parameter.help[1:]} [{', '.join(users[name])}]."
        options.append((name, Optional[kind], field(default=None, metadata={"help": text})))  # noqa: UP045
    made = make_dataclass("FilterOptions", options, kw_only=True, namespace={"__module__": __name__})
    made.__doc__ = "Parameters of the filter; each with the filters that have it and their defaults."
    return made


FilterOptions: Any = _filter_options()
FilterMethod: Any = Literal[tuple(FILTERS)]


def filter_(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    method: Annotated[FilterMethod, Parameter(help="Which filter.")],
    ground_truth: Annotated[Path | None, Parameter(help="Clean version of the mesh, to measure by.")] = None,
    tune: Annotated[
        bool, Parameter(help="Try many parameters and keep those whose normals come closest to the ground truth.")
    ] = False,
    parameters: Annotated[FilterOptions | None, Parameter(name="*", group="Parameters")] = None,
    quiet: Quiet = False,
) -> int:
    """Remove noise with a classical filter, to compare with what `dmp denoise` gives."""
    from dmp.filters import filtered, tuned
    from dmp.meshio import write_mesh

    chosen, named = filter_named(method), given(parameters)
    values = chosen.checked(named)
    if tune and ground_truth is None:
        raise SettingsError("--tune compares with a ground truth. Name it with --ground-truth.")
    if tune and named:
        options = " and ".join("--" + name.replace("_", "-") for name in named)
        raise SettingsError(f"--tune chooses the parameters itself. Leave out {options}.")
    check_output(output)
    refuse_as_output(output, mesh, ground_truth)
    noisy = load(mesh, quiet)
    truth = None if ground_truth is None else _truth(ground_truth, noisy, quiet)
    if tune and truth is not None:
        say(f"Trying the parameters of {chosen.name} …", quiet)
        found = tuned(noisy, truth, chosen.name)
        vertices, values = found.vertices, dict(found.parameters)
        is_input = values[chosen.count.name] == 0
        say(f"Best of {found.n_tried} results{': the mesh as it is' if is_input else ''}.", quiet)
    else:
        vertices = filtered(noisy, chosen.name, **values)
    write_mesh(output, noisy.with_vertices(vertices))
    if tune:
        print(" ".join(f"--{name.replace('_', '-')} {value}" for name, value in values.items()))
    if truth is not None:
        before, after = truth.measures(noisy.vertices), truth.measures(vertices)
        print(f"mean angular difference  {after['mad']:.3f} degrees (before {before['mad']:.3f})")
        print(f"mean vertex distance     {after['vertex_error']:.4f} mean edge lengths (before {before['vertex_error']:.4f})")
    used = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())
    say(f"{chosen.title} ({used}) written to {output}.", quiet)
    return EXIT_DONE


filter_.__doc__ = "\n".join(
    [f"{filter_.__doc__}\n", *(f"- **{chosen.name}**: {chosen.description}" for chosen in FILTERS.values())]
)


def _truth(path: Path, noisy: Any, quiet: bool) -> GroundTruth:
    from dmp.metrics import GroundTruth

    return GroundTruth.for_input(load(path, quiet), noisy)
