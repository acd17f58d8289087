"""The command line, ``dmp …``. Heavy modules are imported by the command that needs them, so that ``--help`` is quick.

Exit codes: 0 done, 1 a fault of this program, 2 wrong usage or unusable input (one line on stderr), 130 interrupted.
"""

from __future__ import annotations

import os
import sys

import cyclopts
from cyclopts import App, Parameter

from dmp import __version__
from dmp.commands import batching, experimenting, exporting, filtering, kept_runs, measuring, meshes, repairing, restoring
from dmp.commands.common import EXIT_DONE, EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USAGE, say
from dmp.commands.refusals import check_working_folder, of_the_system, say_plainly
from dmp.commands.streams import OutputError, forgiving_streams
from dmp.errors import DmpError
from dmp.waiting import spin_only_briefly

app = App(
    name="dmp",
    help="Restore one damaged triangle mesh with nothing but that mesh (Deep Mesh Prior).",
    version=f"dmp {__version__}",
    default_parameter=Parameter(negative=()),
)
for _command in (
    restoring.denoise,
    restoring.complete,
    kept_runs.resume,
    kept_runs.export,
    exporting.picture,
    exporting.animate,
    exporting.curve,
    exporting.report,
    kept_runs.runs_app,
    meshes.metrics,
    meshes.info,
    meshes.noise,
    meshes.smooth,
    repairing.repair,
    filtering.filter_,
    batching.batch,
    batching.serve,
    experimenting.experiment,
    measuring.benchmark,
):
    app.command(_command)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code."""
    spin_only_briefly()
    try:
        with forgiving_streams():
            code = _run(arguments)
    except OutputError as error:
        say(f"dmp: {error}")
        code = EXIT_USAGE
    sys.exit(code)


def _run(arguments: list[str] | None) -> int:
    """Run the command line and return its exit code."""
    try:
        check_working_folder()
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        return code if isinstance(code, int) else EXIT_DONE
    except cyclopts.CycloptsError as error:
        chain = " ".join(["dmp", *(error.command_chain or ())])
        say(f"dmp: {' '.join(str(error).split())} Try '{chain} --help'.")
        return EXIT_USAGE
    except DmpError as error:
        say(f"dmp: {error}")
        return EXIT_USAGE
    except KeyboardInterrupt:
        say("dmp: interrupted.")
        return EXIT_INTERRUPTED
    except Exception as error:
        if os.environ.get("DMP_DEBUG"):
            raise
        if refusal := of_the_system(error):
            say_plainly(f"dmp: {refusal}")
            return EXIT_USAGE
        say(
            f"dmp: this is a fault of the program: {type(error).__name__}: {error}. "
            "Set DMP_DEBUG=1 and run it again for details to report."
        )
        return EXIT_FAULT
