"""From a wanted drive to a current: the command effects inverted one by one, the hysteresis so that it can't chatter.

    u = v + k c (w / 2) sat((v - x) / max(e, (1 - c) w / 2)),   v = v_w + z,   |z| <= c w / 2
    dz/dt = dead(v_w - f(u)) / tau,   dead(m) = m - min(max(m, -b), b)

v_w wanted output in mA, f(u) the one that the model gives u, x where the play operator stands, w width of its band as
far as it is believed (`width.py`), c share of the current that it holds, b what is borne. The exact inverse, k = 1 and
e -> 0, jumps by w where c = 1 whenever the wish turns around, on noise too, and overshoots where the band of the
machine is narrower than the model's. Half way in between the play is narrowed from w / 2 to e w / (2 e + k w) and the
current stays continuous; k below 1 leaves a part of the band to the observer. Where springs close the band at no
current, u is no less than what can give v. What the narrowed play lacks of a wish that stays, 1 to 2 cm/s, is no
disturbance, so that the observer never mends it: z sums it up, all but b. Without b the loop would wander from one edge
to the other of a band that is not quite the model's. Source of the idea: G. Tao, P. Kokotovic, Adaptive Control of
Systems with Actuator and Sensor Nonlinearities, 1996, ch. 4 (soft inverse of backlash).
"""

import math
from typing import Annotated

import msgspec

from cruise.effects import Effect, Inverse
from cruise.effects.effect import State
from cruise.effects.hysteresis import Hysteresis
from cruise.model.model import Model, ModelState, exactly
from cruise.settings import Positive
from cruise.signals import Signals


class InversionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the hysteresis is undone."""

    hysteresis_share: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.9  # k; the rest is left to the observer
    turn_ma: Positive = 25.0  # e, mA: a wish that turns by less is noise
    lasting_s: Positive = 2.0  # tau, s: a wish that lacks something for longer is none
    borne_ma: Annotated[float, msgspec.Meta(ge=0)] = 4.0  # b, mA that it may lack


class Inversion:
    """The inverse for one who drives; `lacking_ma` is z, all its state."""

    def __init__(self, settings: InversionSettings, frame_s: float) -> None:
        self.settings = settings
        self.share = -math.expm1(-frame_s / settings.lasting_s)
        self.restart()

    def restart(self) -> None:
        """No wish lacks anything."""
        self.lacking_ma = 0.0

    def step(self, model: Model, drive_ma: float, state: ModelState, signals: Signals) -> Inverse:
        """The current in mA that gives a wanted drive, or why there is none; one frame later."""
        return model.current_for(drive_ma, state, signals, self._undo)

    def _undo(self, effect: Effect, wanted: Inverse, signals: Signals, state: State) -> Inverse:
        if not isinstance(effect, Hysteresis):
            return exactly(effect, wanted, signals, state)
        wanted_ma = wanted.nearest(0.5 * (wanted.low + wanted.high) if math.isnan(state) else state)
        current_ma = self._through(effect, wanted_ma, state)
        return Inverse(current_ma, current_ma)

    def _through(self, effect: Hysteresis, wanted_ma: float, stands_ma: float) -> float:
        if math.isnan(stands_ma):
            return wanted_ma
        half_ma = 0.5 * effect.width_ma
        soft_ma = max(self.settings.turn_ma, (1.0 - effect.share) * half_ma)
        meant_ma = wanted_ma + self.lacking_ma
        turned = min(max((meant_ma - stands_ma) / soft_ma, -1.0), 1.0)
        current_ma = meant_ma + self.settings.hysteresis_share * effect.share * half_ma * turned
        current_ma = effect.closing(meant_ma, Inverse(current_ma, current_ma)).low
        given_ma, _ = effect.step(current_ma, math.nan, {}, stands_ma, math.nan)
        lacks_ma = wanted_ma - given_ma
        lacks_ma -= min(max(lacks_ma, -self.settings.borne_ma), self.settings.borne_ma)
        most_ma = effect.share * half_ma
        self.lacking_ma = min(max(self.lacking_ma + self.share * lacks_ma, -most_ma), most_ma)
        return current_ma
