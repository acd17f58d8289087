from __future__ import annotations

from dmp.experiments.catalogue import EXPERIMENTS
from dmp.experiments.conducting import jobs_for, plans_for
from dmp.experiments.family import family
from dmp.experiments.plan import Plan


def test_the_family_takes_kinds_and_levels_in_turn() -> None:
    cases = family()
    assert len(cases) == 30
    assert [(case.noise, case.level) for case in cases[:4]] == [
        ("gaussian", 0.1),
        ("normal", 0.2),
        ("uniform", 0.3),
        ("gaussian", 0.45),
    ]
    assert {(case.noise_seed, case.is_shape) for case in cases} == {(1, True)}
    # Each kind meets each level: 15 pairs, twice.
    assert len({(case.noise, case.level) for case in cases}) == 15


def test_development_has_the_best_preset_and_each_filter_for_each_mesh() -> None:
    jobs = jobs_for(plans_for(EXPERIMENTS["development"], Plan((), seeds=(1, 2), filters=("taubin", "laplacian"))))
    assert len(jobs) == 30 * (1 + 2 + 2)
    assert {job.settings.preset for job in jobs if job.settings is not None} == {"best"}
