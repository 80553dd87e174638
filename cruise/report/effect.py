"""An effect in words: its module says what it is."""

import inspect
import re
from typing import Final

from cruise.effects import Effect

SENTENCES: Final = 2  # of the physics, in short
SPLIT: Final = re.compile(r"(?<=[a-z)][.]) +(?=[A-Z])")


def headline(effect: Effect) -> str:
    """What the effect is in one sentence: the first of its module."""
    return " ".join(paragraphs(effect)[0].split())


def what(effect: Effect) -> str:
    """The same without the effect's name."""
    said = headline(effect).partition(": ")[2]
    return said[:1].upper() + said[1:]


def physics(effect: Effect) -> str:
    """Its physics in two sentences."""
    return " ".join(SPLIT.split(effect.about.physics)[:SENTENCES])


def paragraphs(effect: Effect) -> list[str]:
    """The text of the effect's module."""
    return (inspect.getdoc(inspect.getmodule(effect)) or effect.name).split("\n\n")
