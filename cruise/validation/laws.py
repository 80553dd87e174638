"""Laws of one signal: a free curve says what the best law of a signal leaves, whatever its form.

Where any law of the speed leaves clearly less than any law of the current, what is missing is no law of the current,
and the other way round: neither in the place of such an effect nor beside one, whose own form may be wrong.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.signals import INPUT
from cruise.validation.background import DYNAMICS
from cruise.validation.candidates import UNNAMED
from cruise.validation.judged import sureness
from cruise.validation.tried import APART, LOOSE, Tried
from cruise.validation.unnamed import SPEED

SEED: Final = 0  # of the bootstrap


def law_of(name: str) -> str:
    """The current, or the model's speed, where that alone says at any moment how an effect acts; else nothing."""
    if name not in EFFECTS or EFFECTS[name].needs or name in DYNAMICS:
        return ""
    if EFFECTS[name].stage is Stage.COMMAND:
        return INPUT
    return SPEED if EFFECTS[name].reads_speed else ""


def ruled_out(name: str, by: str, tried: Sequence[Tried]) -> bool:
    """Whether an effect is a law of one signal, another effect one of the other, and that signal leaves clearly less.

    `tried` are all candidates beside one explanation, the free curves among them.
    """
    mine, other = law_of(name), law_of(by)
    free, better = (next((one for one in tried if one.name == f"{UNNAMED}{law}"), None) for law in (mine, other))
    if free is None or better is None or mine == other:
        return False
    best = min((one for one in tried if one is free or law_of(one.name) == mine), key=lambda one: one.judged.loss)
    clearly = sureness(best.judged, better.judged, np.random.default_rng(SEED)) >= APART
    return clearly and best.judged.loss > LOOSE * better.judged.loss
