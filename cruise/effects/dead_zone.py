"""Dead zone: below a threshold current the pump's servo does not move and no oil flows.

    f(u) = (1 - j) g(u) + j h(u)
    g(u) = sign(u) [ s ln(1 + exp((|u| - u_0) / s)) - s ln(1 + exp(-u_0 / s)) ],   s -> 0: sign(u) max(|u| - u_0, 0)
    h(u_k) = u_k x_k,   x_k = min(max(x_(k-1), q(u_0)), q(b u_0))                  r -> 0: u beyond the threshold
    q(v) = 1 / (1 + exp((v - |u_k|) / r)),   r = max(s, 2 mA)

u solenoid current in mA, f what acts in mA: g what overlap lets through and h what a detent does; u_0 threshold in mA,
s width of its edge in mA, u_0 / 4 at most: spools have notches that open gradually, and where the edge is as wide as
the zone there is no zone left but a curved gain. j share of what the zone takes that comes back at its edge: 0 for
overlap, 1 for a detent, or a valve driver that ignores small commands. x how far a detent is open, q(v) how far |u| is
beyond v, 0 to 1 over a width of r; b of the threshold, at which it closes again: less than 1 for what sticks until it
breaks away, all at once (r is u_0 / 16 at most there), and for a driver with two limits. Source: section IV.C and Fig.
4 of Coen et al. 2005 ("a dead zone visible for small and large currents"); proportional pump controls of this class
start at about a third of full current.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.drag import begins, dragged
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
JUMP_MA: Final = 2.0  # mA, least width of a jump: a fit by differences sees a slope on both sides
BEYOND: Final = 20.0  # widths beyond the threshold, where everything is through
EXACT_MA: Final = 1e-8  # mA, of the inverse
STICKS: Final = 0.0625  # of the threshold, the widest edge of what sticks: it breaks away all at once
WIDEST: Final = 0.25  # of the threshold: with a wider edge no current is left at which nothing moves


@dataclass(frozen=True, slots=True)
class DeadZone(Effect):
    """f(u) = sign(u) max(|u| - threshold_ma, 0) in mA, with an edge edge_ma wide; with jump_share 1 u itself there."""

    name = "dead_zone"
    stage = Stage.COMMAND
    needs = ()
    instead = ("release_share",)
    kind = "jump_share"
    kinds = (
        {"jump_share": 0.0, "release_share": 1.0},
        {"jump_share": 1.0, "release_share": 1.0},
        {"jump_share": 1.0, "release_share": 0.6},
    )
    parameters: ClassVar = {
        "threshold_ma": Parameter("mA", 0.0, 800.0, 0.0, "current at which the servo begins to move"),
        "edge_ma": Parameter("mA", 0.0, 150.0, 0.0, "width over which it begins, a quarter of the threshold at most"),
        "jump_share": Parameter("-", 0.0, 1.0, 0.0, "of the threshold, that is there at once beyond it"),
        "release_share": Parameter("-", 0.2, 1.0, 1.0, "of the threshold, at which a detent closes again"),
    }
    about: ClassVar = About(
        physics="The spool's overlap and the centring springs of the servo must be overcome before the swash plate "
        "leaves its middle. Below the threshold the machine stands, whatever the current. Beyond it overlap opens from "
        "nothing; a detent, or a valve driver that ignores small commands, gives all that was asked for at once; what "
        "sticks until it breaks away closes at less than it opened at.",
        equation="f(u) = sign(u) max(|u| - u_0, 0) + j u_0 sign(u) beyond u_0, until |u| < b u_0, rounded over s",
        source="Coen et al. 2005, section IV.C, Fig. 4",
        signature="the residual depends on |u| with a kink, and vanishes at high current once the gain is refitted",
        look_alikes=("coulomb_friction", "quadratic_gain", "hysteresis"),
        experiment="a slow ramp from zero through the threshold and back, in both directions of travel",
    )

    threshold_ma: float = 0.0
    edge_ma: float = 0.0
    jump_share: float = 0.0
    release_share: float = 1.0

    @property
    def idle(self) -> frozenset[str]:
        """Where it closes, if it does where it opened, or opens from nothing."""
        detent = self.jump_share > 0.0 and self.release_share < 1.0
        return frozenset() if detent else frozenset({"release_share"})

    @property
    def width_ma(self) -> Value:
        """Width of the edge in mA: that of the parameter, as far as the threshold leaves room for it."""
        widest_ma = WIDEST * self.threshold_ma
        return where(self.edge_ma < widest_ma, self.edge_ma, widest_ma)

    def start(self, like: Value) -> State:
        """How far a detent is open: not known, and taken as closed."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What is left of the current beyond the threshold, and how far a detent is open."""
        closed = self._opening(value, self.threshold_ma)
        opened = self._opening(value, self.release_share * self.threshold_ma)
        through = where(state > closed, where(state < opened, state, opened), closed)  # NaN where the current is
        return self._passed(value, through), through

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once: the shape is looked for in recordings of 10^5 samples."""
        currents_ma = np.array(np.broadcast_to(values, len(past_speeds)), float)
        through = self._opening(currents_ma, self.threshold_ma)
        if not self.idle:
            opened = self._opening(currents_ma, self.release_share * self.threshold_ma)
            through = dragged(through, np.where(begins(np.isfinite(through)), through, opened))
        return self._passed(currents_ma, through), through

    def _passed(self, value: Value, through: Value) -> Value:
        """What passes, with the detent open so far."""
        sharp = value - clip(value, -self.threshold_ma, self.threshold_ma)
        edge_ma = self.width_ma
        width_ma = clip(edge_ma, SHARP_MA, math.inf)
        rest_ma = softplus(-self.threshold_ma, width_ma)  # nothing comes at no current
        soft = sign(value) * (softplus(abs(value) - self.threshold_ma, width_ma) - rest_ma)
        open_ma = where(edge_ma < SHARP_MA, sharp, soft)
        return open_ma + self.jump_share * (value * through - open_ma)

    def _opening(self, value: Value, threshold_ma: Value) -> Value:
        """q, how far a detent with this threshold would be open."""
        sticks_ma = STICKS * self.threshold_ma
        widest_ma = where((self.release_share < 1.0) & (sticks_ma < self.width_ma), sticks_ma, self.width_ma)
        width_ma = clip(widest_ma, JUMP_MA, math.inf)
        return 0.5 * (1.0 + tanh(0.5 * (abs(value) - threshold_ma) / width_ma))

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
