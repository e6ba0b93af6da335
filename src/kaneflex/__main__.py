"""``python -m kaneflex``: the command line."""

from kaneflex.cli import main

main()
