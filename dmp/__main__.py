"""``python -m dmp`` is the command line ``dmp``."""

import signal
import sys


def main() -> None:
    """Run the command line.

    While its modules are being loaded there is nothing to end in order, so Ctrl-C ends the process then without a traceback.
    """
    heard = signal.getsignal(signal.SIGINT)
    if heard is signal.default_int_handler:  # a signal that is ignored, as in the background of a shell, stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from dmp.cli import main as command_line
    except (ImportError, MemoryError) as error:
        # A library for which there is no room is told as one that cannot be imported.
        if isinstance(error, ImportError) and "failed to map segment" not in str(error):
            raise
        sys.stderr.write("dmp: There is not enough memory to start. Close other programs, or raise the limit (ulimit -v).\n")
        sys.exit(2)
    signal.signal(signal.SIGINT, heard)
    command_line()


if __name__ == "__main__":
    main()
