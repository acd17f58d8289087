"""Standard streams that cannot be written to, or are closed: what a command has to say never ends what it has to do."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

from dmp.errors import DmpError
from dmp.files import in_words


class OutputError(DmpError):
    """What a command printed did not arrive."""


class ForgivingStream:
    """A text stream whose faults are noted and not raised; after the first one everything goes nowhere.

    Characters that the encoding of the stream does not have are written as escape sequences, as Python would.

    Attributes:
        fault: the first fault, or None. A reader that has gone, as in ``dmp runs | head``, is none.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.fault: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, and return its length in any case."""
        try:
            try:
                self._stream.write(text)
            except UnicodeEncodeError:
                encoding = self._stream.encoding or "ascii"
                self._stream.write(text.encode(encoding, errors="backslashreplace").decode(encoding))
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Hand over to the system what was written."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        if self.fault is None and error.errno not in (errno.EPIPE, errno.ESHUTDOWN):
            self.fault = error
        # What still waits in the stream must not fail once more when the process ends.
        with suppress(OSError, ValueError), _nowhere() as nowhere:
            os.dup2(nowhere.fileno(), self._stream.fileno())

    def __getattr__(self, name: str) -> Any:
        """Everything else is that of the stream."""
        return getattr(self._stream, name)


@contextmanager
def forgiving_streams() -> Iterator[None]:
    """Let faults of stdout and stderr not end what is under way.

    Raises:
        OutputError: at the end, when what was printed on stdout could not be written; nothing else has suffered.
    """
    _open_standard_descriptors()
    before = sys.stdout, sys.stderr
    with ExitStack() as opened:
        printed, said = (ForgivingStream(stream or opened.enter_context(_nowhere())) for stream in before)
        sys.stdout, sys.stderr = printed, said
        try:
            yield
            printed.flush()
        finally:
            said.flush()
            sys.stdout, sys.stderr = before
    if printed.fault is not None:
        raise OutputError(
            f"What this command prints cannot be written, because {in_words(printed.fault)}. Everything else was done."
        )


def _open_standard_descriptors() -> None:
    """Open those of the descriptors 0, 1 and 2 that are closed, so that no file of ours takes their place."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            with suppress(OSError):
                os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _nowhere() -> TextIO:
    return Path(os.devnull).open("w", encoding="utf-8")
