"""What is sealed: one recording of the virtual combine, told by its tier, its seed and the effects that are in it.

Everything else (course, machine, shapes, noise) follows from tier and seed: another size is the same drive, and a trial
without effects is its twin.
"""

import math
from typing import Final, Literal

import msgspec
import numpy as np

PERIOD_S: Final = 0.05  # 20 Hz, the paper's rate
SECONDS: Final = {"clean": 900.0, "field": 600.0}  # s, of a recording
NOISE_MPS: Final = {"clean": 0.01, "field": 0.04}  # standard deviation of the shown ground speed

Tier = Literal["clean", "field"]
SIZES: Final = ("small", "medium", "large")


class Present(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One effect with its physical size, in the unit that its row of the table states."""

    effect: str
    size: float


class Trial(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One sealed recording."""

    tier: Tier
    seed: int
    effects: tuple[Present, ...] = ()  # none: nothing is missing
    unlisted: tuple[Present, ...] = ()  # effects that are in no table of the program
    background: float = 0.0  # share of its medium size in which every other effect is there as well

    @property
    def seconds(self) -> float:
        """Length of the recording."""
        return SECONDS[self.tier]

    def rng(self, stream: int) -> np.random.Generator:
        """Random numbers of one purpose: they stay as they are when another purpose draws more."""
        return np.random.default_rng([self.seed, stream])

    def resized(self, effect: str, size: float) -> "Trial":
        """The same drive of the same machine with another size of one effect that is in it.

        Raises ValueError for an effect that is not in it or an impossible size.
        """
        if not (math.isfinite(size) and size >= 0.0):
            raise ValueError(f"{effect}: a size of {size} is impossible")
        if effect not in {one.effect for one in (*self.effects, *self.unlisted)}:
            raise ValueError(f"{effect} is not in this trial")

        def other(present: tuple[Present, ...]) -> tuple[Present, ...]:
            return tuple(Present(effect=effect, size=size) if one.effect == effect else one for one in present)

        return msgspec.structs.replace(self, effects=other(self.effects), unlisted=other(self.unlisted))

    def without(self, *effects: str) -> "Trial":
        """The twin: the same drive of the same machine without these effects; without an argument, without any."""

        def left(present: tuple[Present, ...]) -> tuple[Present, ...]:
            return tuple(one for one in present if effects and one.effect not in effects)

        return msgspec.structs.replace(self, effects=left(self.effects), unlisted=left(self.unlisted))
