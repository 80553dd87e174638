"""The blind trial: recordings of the virtual combine with one effect, several or none, and the sealed answers."""

from .draw import draw
from .effects import CANNOT, EFFECTS, UNLISTED
from .simulate import simulate
from .trial import SIZES, Present, Tier, Trial

__all__ = ["CANNOT", "EFFECTS", "SIZES", "UNLISTED", "Present", "Tier", "Trial", "draw", "simulate"]
