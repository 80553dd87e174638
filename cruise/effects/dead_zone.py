"""Dead zone: below a threshold current the pump's servo does not move and no oil flows.

    f(u) = (1 - j) g(u) + j h(u)
    g(u) = sign(u) [ s ln(1 + exp((|u| - u_0) / s)) - s ln(1 + exp(-u_0 / s)) ],   s -> 0: sign(u) max(|u| - u_0, 0)
    h(u) = u / (1 + exp((u_0 - |u|) / r)),   r = max(s, 8 mA),                     r -> 0: u beyond the threshold

u solenoid current in mA, u_0 threshold in mA, s width of its edge in mA, u_0 / 4 at most: spools have notches that
open gradually, and where the edge is as wide as the zone there is no zone left but a curved gain. j share of what the
zone takes that comes back at its edge: 0 for overlap, 1 for a detent, or a valve driver that ignores small commands.
Source: section IV.C and Fig. 4 of Coen et al. 2005 ("a dead zone visible for small and large currents"); proportional
pump controls of this class start at about a third of full current.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import (
    About,
    Effect,
    Inverse,
    Parameter,
    Stage,
    State,
    Value,
    clip,
    sign,
    softplus,
    tanh,
    where,
)
from cruise.signals import Signals

SHARP_MA: Final = 0.5  # mA, an edge below which it is a corner
JUMP_MA: Final = 8.0  # mA, least width of a jump: a fit by differences sees a slope on both sides
BEYOND: Final = 20.0  # widths beyond the threshold, where everything is through
EXACT_MA: Final = 1e-8  # mA, of the inverse
WIDEST: Final = 0.25  # of the threshold: with a wider edge no current is left at which nothing moves


@dataclass(frozen=True, slots=True)
class DeadZone(Effect):
    """f(u) = sign(u) max(|u| - threshold_ma, 0) in mA, with an edge edge_ma wide; with jump_share 1 u itself there."""

    name = "dead_zone"
    stage = Stage.COMMAND
    needs = ()
    kind = "jump_share"
    parameters: ClassVar = {
        "threshold_ma": Parameter("mA", 0.0, 800.0, 0.0, "current at which the servo begins to move"),
        "edge_ma": Parameter("mA", 0.0, 150.0, 0.0, "width over which it begins, a quarter of the threshold at most"),
        "jump_share": Parameter("-", 0.0, 1.0, 0.0, "of the threshold, that is there at once beyond it"),
    }
    about: ClassVar = About(
        physics="The spool's overlap and the centring springs of the servo must be overcome before the swash plate "
        "leaves its middle. Below the threshold the machine stands, whatever the current. Beyond it overlap opens from "
        "nothing; a detent, or a valve driver that ignores small commands, gives all that was asked for at once.",
        equation="f(u) = sign(u) max(|u| - u_0, 0) + j u_0 sign(u) beyond u_0, rounded over s, u_0 / 4 at most",
        source="Coen et al. 2005, section IV.C, Fig. 4",
        signature="the residual depends on |u| with a kink, and vanishes at high current once the gain is refitted",
        look_alikes=("coulomb_friction", "quadratic_gain", "hysteresis"),
        experiment="a slow ramp from zero through the threshold and back, in both directions of travel",
    )

    threshold_ma: float = 0.0
    edge_ma: float = 0.0
    jump_share: float = 0.0

    @property
    def width_ma(self) -> Value:
        """Width of the edge in mA: that of the parameter, as far as the threshold leaves room for it."""
        widest_ma = WIDEST * self.threshold_ma
        return where(self.edge_ma < widest_ma, self.edge_ma, widest_ma)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What is left of the current beyond the threshold."""
        sharp = value - clip(value, -self.threshold_ma, self.threshold_ma)
        edge_ma = self.width_ma
        width_ma = clip(edge_ma, SHARP_MA, math.inf)
        rest_ma = softplus(-self.threshold_ma, width_ma)  # nothing comes at no current
        soft = sign(value) * (softplus(abs(value) - self.threshold_ma, width_ma) - rest_ma)
        open_ma = where(edge_ma < SHARP_MA, sharp, soft)
        return open_ma + self.jump_share * (self._at_once(value) - open_ma), state

    def _at_once(self, value: Value) -> Value:
        """h(u), what a detent lets through."""
        width_ma = clip(self.width_ma, JUMP_MA, math.inf)
        return 0.5 * value * (1.0 + tanh(0.5 * (abs(value) - self.threshold_ma) / width_ma))

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The threshold on top of the value; the whole dead zone for zero; where it jumps, the current by halving."""
        edge_ma = self.width_ma
        if self.jump_share > 0.0:
            return self._by_halving(value, signals, state)
        if edge_ma >= SHARP_MA:
            open_ma = (abs(value) + softplus(-self.threshold_ma, edge_ma)) / edge_ma
            over_ma = edge_ma * (open_ma + math.log(-math.expm1(-open_ma)))
            current_ma = math.copysign(max(self.threshold_ma + over_ma, 0.0), value)
            return Inverse(current_ma, current_ma)
        if value == 0.0:
            return Inverse(-self.threshold_ma, self.threshold_ma)
        current_ma = value + (self.threshold_ma if value > 0 else -self.threshold_ma)
        return Inverse(current_ma, current_ma)

    def _by_halving(self, value: float, signals: Signals, state: State) -> Inverse:
        """The least current that gives the value: f rises with the current, and lies below it."""
        low_ma, high_ma = 0.0, abs(value) + self.threshold_ma + BEYOND * max(self.width_ma, JUMP_MA)
        while high_ma - low_ma > EXACT_MA:
            middle_ma = 0.5 * (low_ma + high_ma)
            if self.step(middle_ma, 0.0, signals, state, 0.0)[0] < abs(value):
                low_ma = middle_ma
            else:
                high_ma = middle_ma
        current_ma = math.copysign(high_ma if value else 0.0, value)
        return Inverse(current_ma, current_ma)
