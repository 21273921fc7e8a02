"""Arguments that several commands share, and what they say when they end."""

from pathlib import Path
from typing import Annotated

import typer

# Exit status: 0 done, 1 internal error, 2 wrong usage or input, 3 not identical (verify); after a signal
# see `interrupt`.
INTERNAL = 1
WRONG = 2
DIFFERENT = 3

# Whole numbers beyond this are slips.
MOST = 1_000_000_000

Inputs = Annotated[list[Path], typer.Argument(metavar="IN...", help="LAS, LAZ, .npy or text; several are one stream.")]
Output = Annotated[Path, typer.Argument(metavar="OUT", help="The labelled cloud; LAS and LAZ get a SegmentID.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")]


def say(sentence: str, quiet: bool = False) -> None:
    """Tell people something, unless they want it quiet."""
    if not quiet:
        typer.echo(sentence)
