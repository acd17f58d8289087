"""From what a person named to jobs, and from finished jobs to reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dmp.errors import MeshFileError, SettingsError
from dmp.experiments.cases import Case, clean_file, clean_shape, pair, sample_case
from dmp.experiments.catalogue import EXPERIMENTS, Experiment
from dmp.experiments.jobs import Job, distinct
from dmp.experiments.plan import Plan
from dmp.experiments.plots import save
from dmp.experiments.reports import REPORT, Results
from dmp.experiments.store import JobRecord, Store
from dmp.noise import NoiseKind

# Names of files that tell nothing of their mesh: then the folder does.
_PLAIN_NAMES = ("noisy", "input", "mesh", "damaged", "filled", "original", "ground_truth", "truth", "clean")
_SUFFIXES = (".obj", ".ply", ".off", ".stl")


def experiment_named(name: str) -> Experiment:
    """Return the experiment of that name (raises :class:`SettingsError`)."""
    if name not in EXPERIMENTS:
        raise SettingsError(f"There is no experiment '{name}'. There are {', '.join(EXPERIMENTS)}.")
    return EXPERIMENTS[name]


def parts_of(experiment: Experiment) -> list[Experiment]:
    """Return the single experiments that one consists of."""
    return [EXPERIMENTS[name] for name in experiment.parts] or [experiment]


def default_cases(experiment: Experiment) -> tuple[Case, ...]:
    """Return what an experiment works on when no mesh is named: samples of this program.

    The experiments on the generated family choose it themselves.
    """
    if experiment.name in ("development", "suggested-step"):
        return ()
    if experiment.name == "completion":
        return (sample_case("holed-bumpy-sphere"),)
    if experiment.name == "learning-curves":
        return (sample_case("bumpy-sphere"),)
    return tuple(map(sample_case, ("bumpy-sphere", "fan-block", "dinosaur")))


def cases_from(
    meshes: Sequence[Path], truths: Sequence[Path], noise: NoiseKind, level: float, noise_seed: int
) -> tuple[Case, ...]:
    """Return the cases that a person named.

    Args:
        meshes: files; folders with a damaged mesh and its ``ground_truth``; names of samples or of generated shapes.
        truths: the ground truths of the files, in the same order; without any, the files are clean and get noise.
        noise: kind of noise for clean meshes.
        level: of that noise.
        noise_seed: of that noise.

    Raises:
        SettingsError: when the numbers of meshes and truths differ.
        MeshError: when something named is not there or cannot be read.
    """
    files = [mesh for mesh in meshes if mesh.is_file()]
    if truths and len(truths) != len(files):
        raise SettingsError(
            f"{len(truths)} ground truths were named for {len(files)} mesh files. Name one for each, in the same order, or "
            "none for clean meshes, which get noise."
        )
    by_file = dict(zip(files, truths, strict=bool(truths)))
    cases: list[Case] = []
    for mesh in meshes:
        if mesh.is_dir():
            case = _in_folder(mesh)
        elif mesh in by_file:
            case = pair(_name_of(mesh), mesh, by_file[mesh])
        elif mesh.is_file():
            case = clean_file(_name_of(mesh), mesh).noisy(noise, level, noise_seed)
        else:
            case = _made_here(str(mesh), noise, level, noise_seed)
        taken = sum(case.name == other.name or other.name.startswith(f"{case.name}-") for other in cases)
        cases.append(replace(case, name=f"{case.name}-{taken + 1}") if taken else case)
    return tuple(cases)


def _made_here(name: str, noise: NoiseKind, level: float, noise_seed: int) -> Case:
    from dmp.samples import SAMPLES
    from dmp.shapes.development import DEVELOPMENT_SHAPES

    if name in [entry.name for entry in SAMPLES]:
        return sample_case(name)
    if name in DEVELOPMENT_SHAPES:
        return clean_shape(name).noisy(noise, level, noise_seed)
    raise MeshFileError(
        name,
        "there is no such file, folder, sample or shape",
        f"Samples are {', '.join(entry.name for entry in SAMPLES)}; shapes are {', '.join(DEVELOPMENT_SHAPES)}.",
    )


def _in_folder(folder: Path) -> Case:
    def found(*names: str) -> Path | None:
        paths = [folder / f"{name}{suffix}" for name in names for suffix in _SUFFIXES]
        return next((path for path in paths if path.is_file()), None)

    damaged, truth = found("noisy", "damaged", "input", "holes"), found("ground_truth", "truth", "clean", "original")
    if damaged is None or truth is None:
        raise MeshFileError(
            folder,
            "the folder has no pair of meshes",
            "It needs a 'noisy' (or 'damaged') and a 'ground_truth' mesh, each as OBJ, PLY, OFF or STL.",
        )
    return pair(folder.resolve().name, damaged, truth)


def _name_of(path: Path) -> str:
    return path.resolve().parent.name if path.stem in _PLAIN_NAMES else path.stem


def plans_for(experiment: Experiment, plan: Plan) -> list[tuple[Experiment, Plan]]:
    """Return the single experiments with their plans; one without cases gets the default ones.

    Raises:
        SettingsError: when meshes were named and none of them is of use.
    """
    holed = [case.name for case in plan.cases if case.task == "complete"]
    if holed and len(holed) == len(plan.cases) and experiment.name not in ("completion", "all"):
        raise SettingsError(
            f"{', '.join(holed)}: the ground truth has other faces than the mesh, so holes are to be filled here, and the "
            f"experiment {experiment.name} is about noise. Its ground truth must be the clean version of the very same mesh."
        )
    return [(part, plan if plan.cases else replace(plan, cases=default_cases(part))) for part in parts_of(experiment)]


def jobs_for(plans: Sequence[tuple[Experiment, Plan]]) -> list[Job]:
    """Return all jobs of some experiments; what several need is there once."""
    return distinct([job for part, plan in plans for job in part.module.jobs(plan)])


def write_reports(plans: Sequence[tuple[Experiment, Plan]], store: Store, command: str = "") -> Path:
    """Write the report of each experiment from what is done, and one page that leads to them.

    Args:
        plans: the experiments.
        store: what is done.
        command: what was typed, for the record.

    Returns:
        The page.

    Raises:
        RunError: when a file cannot be written.
    """
    results = Results(store)
    for part, plan in plans:
        report = part.module.report(plan, results, store.folder / part.name)
        report.remarks.append(_circumstances(results.of(part.module.jobs(plan)), command))
        report.write()
    # Those of earlier commands are still there.
    written = [item for item in EXPERIMENTS.values() if (store.folder / item.name / REPORT).is_file()]
    lines = ["# Experiments", "", *(f"- [{item.name}]({item.name}/{REPORT}): {item.sentence}" for item in written)]
    page = store.folder / REPORT
    save(page, ("\n".join(lines) + "\n").encode())
    return page


def _circumstances(records: Sequence[JobRecord | None], command: str) -> str:
    """Return when, where and how the results were made, in a sentence or two."""
    facts = [record.facts for record in records if record is not None]
    named = {
        name: sorted({str(item[name]) for item in facts if item.get(name) is not None})
        for name in ("date", "machine", "device", "threads", "program")
    }
    made = "; ".join(f"{name} {', '.join(values)}" for name, values in named.items() if values)
    return f"Measured: {made}." + (f" Command: `{command}`" if command else "")
