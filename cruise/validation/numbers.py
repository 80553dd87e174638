"""Fitted numbers in physical terms, with their standard errors, what is plausible, and what to think of each."""

import math
from dataclasses import dataclass
from typing import Final

from cruise.validation.explanation import CORE, RESONANCE
from cruise.validation.judged import Judged
from cruise.validation.study import Study

AT_BOUND: Final = 1e-3  # of the range between the bounds: a solver that stays inside comes no closer
NOTHING: Final = 1e-6  # in m/s per unit of phi, and of a shape that may lie on both sides of neutral: no sign of it
UNTOLD: Final = 0.5  # of that range: a standard error above it says that nothing was learned
NO_SIGN: Final = "no sign of it"  # remark on what was fitted to nothing
NOT_TOLD: Final = "not told by the data"
BOUND: Final = "at its bound"
IMPLAUSIBLE: Final = "implausible"
PLAUSIBLE: Final = "plausible"


@dataclass(frozen=True)
class Number:
    """A fitted number with its standard error, and what is plausible."""

    owner: str  # core, resonance, or an effect
    name: str
    unit: str
    value: float
    std: float  # infinite: the data can't separate it from others
    low: float
    high: float
    neutral: float  # NaN: none removes it
    meaning: str

    @property
    def told(self) -> bool:
        """Whether the recordings say anything about it."""
        span = self.high - self.low
        return math.isfinite(self.std) and not self.std > UNTOLD * span and (self.std > 0.0 or math.isinf(span))

    @property
    def absent(self) -> bool:
        """Whether it has the value at which it does nothing."""
        span = self.high - self.low
        from_inside = math.isfinite(span) and self.neutral in (self.low, self.high)
        return abs(self.value - self.neutral) <= (AT_BOUND * min(span, 1.0) if from_inside else NOTHING)

    @property
    def plausible(self) -> bool:
        """Strictly between the bounds; or without effect, or not told, which contradicts nothing."""
        return self.remark not in (BOUND, IMPLAUSIBLE)

    @property
    def remark(self) -> str:
        """What an engineer should think of it."""
        if not self.low <= self.value <= self.high:
            return IMPLAUSIBLE
        if not self.told:
            return NOT_TOLD
        if self.absent:
            return NO_SIGN
        span = self.high - self.low
        room = AT_BOUND * span if math.isfinite(span) else 0.0
        return PLAUSIBLE if self.low + room < self.value < self.high - room else BOUND


def numbers(study: Study, judged: Judged) -> list[Number]:
    """All that was fitted, with standard errors from blocks of time."""
    stds = study.search.standard_errors(judged.fit)
    effects = {effect.name: effect for effect in judged.explanation.effects}
    result = []
    for slot, value, std in zip(judged.fit.layout.slots, judged.fit.vector.tolist(), stds.tolist(), strict=True):
        place, name, unit, low, high, neutral = slot.owner, slot.name, "m/s", slot.low, slot.high, math.nan
        if place == "core":
            bound = {**CORE, **RESONANCE}[name]
            place = "resonance" if name in RESONANCE else place
            unit, meaning = bound.unit, bound.meaning
            if name == "gain_mps_per_ma":  # its fit may turn its sign
                low, high = 0.0, math.inf
        elif place == "offset":
            place, meaning = "core", "speed without current"
        elif name == "load":
            low, high = -math.inf if effects[place].either_sign else 0.0, math.inf
            unit, neutral, meaning = "m/s per phi", 0.0, "steady speed that one unit of phi brings"
        else:
            bound = effects[place].parameters[name]
            unit, neutral, meaning = bound.unit, bound.neutral, bound.meaning
        result.append(Number(place, name, unit, value, std, low, high, neutral, meaning))
    return result
