"""Clicks, types and drags in the window at random, thousands of times, seeded; nothing may fail, hang or crash.

A process of its own does some hundred actions: those of the menus that are possible just then, clicks, double clicks, drags
and the wheel anywhere, keys, files that are opened or dropped (good, odd and broken ones), trainings, resizing, closing. Each
dialog and menu that opens is answered by chance. What is meant by chance repeats with the seed; how far a training has come
when something is clicked does not.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from tests.soak import Result
from tests.soak.windows import WITHOUT_DISPLAY, has_display, told_by_child

if TYPE_CHECKING:
    import numpy as np

FULL_SIZE = 5000
_OF_A_PROCESS = 500
_LAST = 12


def run(size: int, seed: int) -> Result:
    """Do ``size`` actions, some hundred in each process."""
    name = "random actions in the window without an error, a hang or a crash"
    if not has_display():
        return Result(name, 0, 0, (WITHOUT_DISPLAY,))
    failures: list[str] = []
    held = 0
    for part, start in enumerate(range(0, size, _OF_A_PROCESS)):
        n_actions = min(_OF_A_PROCESS, size - start)
        with tempfile.TemporaryDirectory(prefix="dmp-clicking-") as folder:
            told, wrong = told_by_child(
                "clicking", n_actions, seed, part, folder, folder=Path(folder), seconds=300 + 10 * n_actions
            )
        before: list[str] = []
        done = 0
        for line in told:
            if "begun" in line:
                before = [*before, line["begun"]][-_LAST:]
            if "done" in line:
                done += not line["faults"]
                failures += [f"seed {seed}, process {part}, action {line['done']}: {text}; {before}" for text in line["faults"]]
        if wrong:
            failures.append(f"seed {seed}, process {part}, after {before}: {wrong}")
        held += done
    return Result(name, held, size, tuple(failures))


def main(n_actions: int, seed: int, part: int, folder: Path) -> None:
    """In the child: do the actions, and tell each."""
    import numpy as np

    from tests.soak import window_child as child
    from tests.soak.random_hands import Hands

    generator: np.random.Generator = np.random.default_rng([seed, part])
    samples = child.write_samples(folder)
    _, faults = child.begin()
    hands = Hands(generator, samples, folder)
    controller = child.new_window(folder, faults, child.quick())
    for number in range(n_actions):
        what = hands.choose()
        child.watch(what)
        hands.act(controller, what)
        child.pump(float(generator.choice([0.0, 0.02, 0.1])))
        if not controller.window.isVisible():
            child.end_window(controller)
            controller = child.new_window(folder, faults, child.quick())
        child.tell(done=number, faults=faults.found)
        faults.found.clear()
    child.watch("the end")
    child.end_window(controller)
    child.tell(done=-1, faults=faults.found) if faults.found else None
    child.finish()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
