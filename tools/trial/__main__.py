"""`tools/blind_trial make`: recordings with sealed answers."""

from pathlib import Path
from typing import Annotated

import typer

from . import files
from .draw import draw, mixture
from .trial import SIZES, Tier

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def blind_trial() -> None:
    """Recordings of the virtual combine with a hidden effect, and what the program makes of them."""


@app.command()
def make(
    out: Annotated[Path, typer.Option(help="New or empty folder for the CSV files and answers.json.")],
    tier: Annotated[Tier, typer.Option(help="clean or field.")] = "clean",
    count: Annotated[int, typer.Option(min=1, max=9999, help="How many recordings.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recordings.")] = 0,
    effect: Annotated[str, typer.Option(help="One effect, some joined by +, nothing; default: a mixture.")] = "",
    size: Annotated[str, typer.Option(help=f"Of the effect: {', '.join(SIZES)}.")] = "medium",
) -> None:
    """Write recordings and their sealed answers."""
    try:
        trials = [draw(tier, effect, size, seed + k) for k in range(count)] if effect else mixture(tier, count, seed)
        files.make(out, trials)
    except (ValueError, FileExistsError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{count} recordings and {files.ANSWERS} in {out}")


if __name__ == "__main__":
    app()
