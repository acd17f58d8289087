"""The process that draws: ``python -m dmp.exports.worker FOLDER``, started by :mod:`dmp.exports.drawing` only.

It reads a :class:`dmp.exports.scenes.Sheet` and then frames from its standard input, as its parent writes them, until there
are no more; after each it prints ``drawn``, and in the end the names of the files that it wrote into FOLDER. An error made
for people is printed as ``error`` and its sentence. VTK may end a whole process on a machine that cannot draw, which is
why this is one of its own.
"""

from __future__ import annotations

import os
import pickle
import sys
from pathlib import Path

from dmp.errors import DmpError
from dmp.exports.composing import Composer
from dmp.exports.encoding import encoder
from dmp.exports.scenes import Frame, Sheet


def main(folder: Path) -> int:
    """Draw everything that comes, and return the exit code."""
    # What libraries print must not be taken for an answer.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def answer(text: str) -> None:
        answers.write(text + "\n")
        answers.flush()

    source = sys.stdin.buffer
    try:
        sheet = pickle.load(source)
        assert isinstance(sheet, Sheet)
        files, composer = encoder(folder, sheet), Composer(sheet)
        while (frame := pickle.load(source)) is not None:
            assert isinstance(frame, Frame)
            files.add(composer.compose(frame))
            answer("drawn")
        answer("encoding")
        written = files.finish()
        composer.close()
    except DmpError as error:
        answer(f"error {error}")
        return 2
    except MemoryError:
        answer("error There is not enough memory for a picture of this size. Choose a smaller one.")
        return 2
    for path in written:
        answer(f"file {path.name}")
    answer("done")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
