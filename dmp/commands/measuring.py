"""``dmp benchmark``."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from dmp.commands.common import EXIT_DONE, load
from dmp.commands.options import AsJson
from dmp.errors import SettingsError

_PRESETS = ("compact", "paper", "best")


def benchmark(
    mesh: Annotated[Path | None, Parameter(help="Mesh file to time on, in place of made meshes.")] = None,
    /,
    *,
    sizes: Annotated[
        list[int] | None,
        Parameter(help="Vertices of the meshes that are made; 5000 and 20000 by default.", consume_multiple=True),
    ] = None,
    presets: Annotated[
        list[str] | None, Parameter(help="Presets to time: compact, paper, best.", consume_multiple=True)
    ] = None,
    rounds: Annotated[int, Parameter(help="Steps of each contestant that count; they take turns.")] = 5,
    threads: Annotated[int, Parameter(help="Processor threads; 0 for all.")] = 0,
    device: Annotated[str, Parameter(help="Where to compute: cpu, cuda or cuda:N.")] = "cpu",
    rivals: Annotated[bool, Parameter(help="Let torch_geometric take part.", negative="--no-rivals")] = True,
    memory: Annotated[bool, Parameter(help="Measure the peak memory of each preset too, in processes of their own.")] = False,
    profile: Annotated[bool, Parameter(help="Say where a step's time goes, part by part.")] = False,
    preparation: Annotated[bool, Parameter(help="Time import, reading, smoothing, operators and writing too.")] = False,
    json: AsJson = False,
) -> int:
    """Time training steps beside torch_geometric's GCNConv, and beside what this machine could do at best.

    All contestants take turns in one process, so that other work on the machine meets all of them.
    """
    from dmp.benchmark.meshes import noisy_torus
    from dmp.benchmark.preparing import measure_memory, time_preparation
    from dmp.benchmark.profiling import profile_step, profile_text
    from dmp.benchmark.steps import steps_text, time_steps
    from dmp.memory import gigabytes

    for preset in presets or ():
        if preset not in _PRESETS:
            raise SettingsError(f"--presets is '{preset}', but must be one or more of: {', '.join(_PRESETS)}.")
    if rounds < 1 or min(sizes or (100,)) < 100:
        raise SettingsError("--rounds must be at least 1, and each of --sizes at least 100 vertices.")
    if device != "cpu" and (memory or profile):
        raise SettingsError("--memory and --profile look at the processor. Leave them out, or leave out --device.")
    meshes = [load(mesh, quiet=json)] if mesh else [noisy_torus(size) for size in sizes or (5_000, 20_000)]
    found: list[dict[str, Any]] = []
    for timed in meshes:
        for preset in presets or ("compact", "paper"):
            values = time_steps(timed, preset, rounds=rounds, threads=threads, rivals=rivals, device=device)
            if profile:
                values["profile"] = profile_step(timed, preset, rounds=rounds, threads=threads)
            if memory:
                values["memory"] = measure_memory(timed.n_vertices, preset, threads=threads)
            if preparation:
                values["preparation_seconds"] = time_preparation(timed, preset)
            found.append(values)
            if json:
                continue
            print(steps_text(values))
            if profile:
                print(profile_text(values["profile"]))
            if memory:
                taken = values["memory"]
                print(f"  peak memory {gigabytes(taken['peak'])}, {taken['per_vertex'] / 1e3:.1f} kB a vertex")
            if preparation:
                print("  " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in values["preparation_seconds"].items()))
    if json:
        print(json_module.dumps(found, indent=2))
    return EXIT_DONE
