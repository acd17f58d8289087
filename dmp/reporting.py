"""The report of a run in one dictionary, for ``--report`` and for people who script."""

from __future__ import annotations

import sys
from typing import Any

from dmp.runs import Run

# Metrics that compare with a ground truth.
TRUTH_MEASURES = ("mad", "vertex_error", "hole_distance", "hole_normal_error")


def peak_memory_mb() -> float | None:
    """Return the largest resident memory of this process so far in MB, or None where the system does not tell."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


def run_report(run: Run, result_step: int) -> dict[str, Any]:
    """Return what is known of a run: mesh, settings, timing, curve, and measures of input and result.

    Args:
        run: the run, after its training.
        result_step: the step whose mesh was saved.
    """
    from dataclasses import asdict

    problem = run.problem()
    curve = run.curve()
    suggestion = run.suggestion()
    seconds = curve[-1]["seconds"] if curve else 0.0
    steps = int(curve[-1]["step"]) if curve else 0
    result = {name: value for name, value in run.snapshot(result_step).metrics.items() if name in TRUTH_MEASURES}
    return {
        "mesh": str(run.input_path) if run.input_path else None,
        "run": str(run.folder),
        "vertices": problem.mesh.n_vertices,
        "faces": problem.mesh.n_faces,
        "task": run.settings.task,
        "settings": asdict(run.settings),
        "device": run.device,
        "steps": steps,
        "kept_step": result_step,
        "suggested_step": suggestion.step if suggestion else None,
        "suggestion": suggestion.reason if suggestion else None,
        "seconds": seconds,
        "seconds_per_step": seconds / steps if steps else None,
        "peak_memory_mb": peak_memory_mb(),
        "curve": curve,
        "input": problem.ground_truth.measures(problem.target) if problem.ground_truth else {},
        "result": result,
    }
