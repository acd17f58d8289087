"""Runs the endurance checks at full size: ``make soak``, or ``python -m tests.soak --only reading --share 0.1``."""

from __future__ import annotations

import argparse
import datetime
import importlib
import sys
import time
from pathlib import Path

from tests.soak import PARTS, Result


def main(arguments: list[str] | None = None) -> int:
    """Run the parts that the command line names, print a table, and return 1 when anything failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description="Run the endurance checks.")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to run")
    parser.add_argument("--share", type=float, default=1.0, help="share of the full size, such as 0.1")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report", type=Path, help="write a Markdown table here, for docs/reliability.md")
    chosen = parser.parse_args(arguments)
    date = datetime.date.today().isoformat()
    lines = ["| check | held | seed | date | minutes |", "|---|---|---|---|---|"]
    failures: list[str] = []
    for name in chosen.only:
        part = importlib.import_module(f"tests.soak.{name}")
        start = time.perf_counter()
        result: Result = part.run(max(1, round(part.FULL_SIZE * chosen.share)), chosen.seed)
        minutes = (time.perf_counter() - start) / 60
        lines.append(f"| {result.name} | {result.passed:,} of {result.total:,} | {chosen.seed} | {date} | {minutes:.1f} |")
        failures += [f"{name}: {detail}" for detail in result.details] if result.passed < result.total else []
        print(f"{result.passed:>7,} of {result.total:<7,} {result.name} ({minutes:.1f} min)", flush=True)
        print(*(f"        {detail}" for detail in result.details), sep="\n", end="\n" if result.details else "", flush=True)
        if chosen.report:  # after each part, so that what was measured is kept when a later one is ended
            content = "\n".join([*lines, "", *(f"- {failure}" for failure in failures)]).rstrip() + "\n"
            chosen.report.write_text(content, encoding="utf-8")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
