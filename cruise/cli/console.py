"""Where a verb prints. Names of files and columns come from users, and brackets in them are brackets, not styles."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text


def printer(width: int | None = None) -> Console:
    """What is said, on the standard output."""
    return Console(highlight=False, markup=False, width=width)


def bold(text: str, rest: str = "") -> Text:
    """The text in bold, and the rest of the line as usual."""
    return Text.assemble((text, "bold"), rest)


@contextmanager
def working(first: str) -> Iterator[Callable[[str], None]]:
    """Says on the standard error what is under way, until the work is done; to be called with what is next."""
    with Console(stderr=True).status(Text(first)) as status:
        yield lambda text: status.update(Text(text))
