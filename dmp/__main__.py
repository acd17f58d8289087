"""``python -m dmp`` is the command line ``dmp``."""

from dmp.cli import main

main()
