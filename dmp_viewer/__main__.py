"""Entry point of ``dmp-viewer``: nothing heavy is imported before the arguments are understood."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from dmp.waiting import spin_only_briefly
from dmp_viewer.arguments import parse


def main(argv: Sequence[str] | None = None) -> int:
    """Run the application and return its exit code: 0 done, 1 our fault, 2 unusable input or surroundings."""
    arguments = parse(argv)
    spin_only_briefly()
    from dmp_viewer.app import run

    return run(arguments)


if __name__ == "__main__":
    sys.exit(main())
