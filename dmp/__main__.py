"""``python -m dmp`` is the command line ``dmp``."""

import signal


def main() -> None:
    """Run the command line.

    While its modules are being loaded there is nothing to end in order, so Ctrl-C ends the process then without a traceback.
    """
    heard = signal.getsignal(signal.SIGINT)
    if heard is signal.default_int_handler:  # a signal that is ignored, as in the background of a shell, stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from dmp.cli import main as command_line

    signal.signal(signal.SIGINT, heard)
    command_line()


if __name__ == "__main__":
    main()
