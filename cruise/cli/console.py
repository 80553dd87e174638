"""Where a verb prints. Names of files and columns come from users, and brackets in them are brackets, not styles."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.text import Text

FIGURES: Final = 80  # columns that a table of figures needs: a narrower one loses digits, where a terminal only wraps


def printer(width: int | None = None, least: int = 0) -> Console:
    """What is said, on the standard output: as wide as the terminal, or `width`, and never narrower than `least`."""
    console = Console(highlight=False, markup=False, width=width)
    if console.width < least:
        console.width = least
    return console


def bold(text: str, rest: str = "") -> Text:
    """The text in bold, and the rest of the line as usual."""
    return Text.assemble((text, "bold"), rest)


@contextmanager
def working(first: str) -> Iterator[Callable[[str], None]]:
    """Says on the standard error what is under way, until the work is done; to be called with what is next."""
    with Console(stderr=True).status(Text(first)) as status:
        yield lambda text: status.update(Text(text))
