"""``dmp benchmark``."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, load
from dmp.commands.options import AsJson


def benchmark(
    mesh: Annotated[Path | None, Parameter(help="Mesh file; by default a sample.")] = None,
    /,
    *,
    width_divisor: Annotated[int, Parameter(help="1 for the full width of the published network.")] = 1,
    rounds: Annotated[int, Parameter(help="Steps of each rival; they take turns.")] = 5,
    threads: Annotated[int, Parameter(help="Processor threads; 0 for all.")] = 0,
    json: AsJson = False,
) -> int:
    """Measure the time of a training step beside torch_geometric's GCNConv, in turns in one process."""
    from dmp.benchmark import compare_steps, comparison_text
    from dmp.samples import sample

    loaded = load(mesh or sample("bumpy-sphere").mesh_path, quiet=json)
    values = compare_steps(loaded, width_divisor=width_divisor, rounds=rounds, threads=threads)
    print(json_module.dumps(values, indent=2) if json else comparison_text(values))
    return EXIT_DONE
