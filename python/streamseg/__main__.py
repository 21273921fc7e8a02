"""Run the command line with ``python -m streamseg``."""

from .cli import main

main()
