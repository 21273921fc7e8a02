"""Arguments that several commands share, and what they say when they end."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from ..errors import InvalidParameter

# Exit status: 0 done, 1 internal error, 2 wrong usage or input, 3 not identical (verify); after a signal
# see `interrupt`; where nobody hears what is said, see `voice`.
INTERNAL = 1
WRONG = 2
DIFFERENT = 3

# Whole numbers beyond this are slips.
MOST = 1_000_000_000

Inputs = Annotated[list[Path], typer.Argument(metavar="IN...", help="LAS, LAZ, .npy or text; several are one stream.")]
Output = Annotated[Path, typer.Argument(metavar="OUT", help="The labelled cloud; LAS and LAZ get a SegmentID.")]
IdName = Annotated[str | None, typer.Option(help="What the column of segment ids is called. [default: SegmentID]")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what streamseg has written there.")]


class InToOut(TyperCommand):
    """A command on IN... OUT: of a single path it says that OUT is missing, where parsers take it for OUT."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words that were typed."""
        words = list(args)
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            given = self.make_parser(ctx).parse_args(words)[0]
            if error.param is None or error.param.name != "inputs" or given.get("output") is None:
                raise
            usage = " ".join(
                str(parameter.metavar) for parameter in self.params if parameter.param_type_name == "argument"
            )
            raise InvalidParameter(f"OUT is missing: streamseg {ctx.info_name} {usage}") from None


def say(sentence: str, quiet: bool = False) -> None:
    """Tell people something, unless they want it quiet."""
    if not quiet:
        typer.echo(sentence)
