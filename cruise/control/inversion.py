"""From a wanted drive to a current: the command effects inverted one by one, the hysteresis so that it can't chatter.

    u = v + k c (w / 2) sat((v - x) / max(e, (1 - c) w / 2))

v wanted output in mA, x where the play operator stands, w width of its band, c share of the current that it holds. The
exact inverse, k = 1 and e -> 0, jumps by w where c = 1 whenever the wish turns around, on noise too, and overshoots
where the band of the machine is narrower than the model's. Half way in between the play is narrowed from w / 2 to
e w / (2 e + k w) and the current stays continuous; k below 1 leaves a part of the band to the observer, for a width
that is wrong. Source of the idea: G. Tao, P. Kokotovic, Adaptive Control of Systems with Actuator and Sensor
Nonlinearities, 1996, ch. 4 (soft inverse of backlash).
"""

import math
from typing import Annotated

import msgspec

from cruise.effects import Inverse, Stage
from cruise.effects.hysteresis import Hysteresis
from cruise.model.model import Model, ModelState
from cruise.settings import Positive
from cruise.signals import Signals


class InversionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the hysteresis is undone."""

    hysteresis_share: Annotated[float, msgspec.Meta(ge=0, le=1)] = 1.0  # k; the rest is left to the observer
    turn_ma: Positive = 25.0  # e, mA: a wish that turns by less is noise


def current_for(
    model: Model, drive_ma: float, state: ModelState, signals: Signals, settings: InversionSettings
) -> Inverse:
    """The current in mA that gives a wanted drive, or why there is none."""
    low = high = drive_ma
    for i, effect in reversed(model.command_effects):
        if effect.acts_as is not Stage.COMMAND:
            continue
        if isinstance(effect, Hysteresis):
            low = high = _through(effect, 0.5 * (low + high), state.effects[i], settings)
            continue
        below, above = effect.inverse(low, signals, state.effects[i]), effect.inverse(high, signals, state.effects[i])
        if below.refused or above.refused:
            return Inverse(math.nan, math.nan, refused=below.refused or above.refused)
        low, high = below.low, above.high
    return Inverse(low, high)


def _through(effect: Hysteresis, wanted_ma: float, stands_ma: float, settings: InversionSettings) -> float:
    if math.isnan(stands_ma):
        return wanted_ma
    half_ma = 0.5 * effect.width_ma
    soft_ma = max(settings.turn_ma, (1.0 - effect.share) * half_ma)
    turned = min(max((wanted_ma - stands_ma) / soft_ma, -1.0), 1.0)
    return wanted_ma + settings.hysteresis_share * effect.share * half_ma * turned
