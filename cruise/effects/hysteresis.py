"""Hysteresis: friction of the control spool lets the drive follow the current only at the edges of a band.

    f(u_k) = min(max((1 - c) u_k + c x_k, u_k - e_k), u_k + e_k),   e_k = |u_k| + (1 - z) c w/2
    x_k = clip(x_(k-1), u_k - w/2, u_k + w/2)

u solenoid current in mA, f what acts in mA, x the play operator, which depends on the path of the current and not on
its speed, w width of its band in mA, c share of the current that it holds back: 1 for slack, less for friction in
something elastic (the simplest Prandtl-Ishlinskii operator). e how far f may be from u at most, z share of the band
that is closed where no current flows: 0 where nothing closes it, 1 where springs hold the spool in its middle then,
wherever it came from. Source: M. Brokate, J. Sprekels, Hysteresis and Phase Transitions (1996), ch. 2; section I.A of
Coen et al. 2005 ("the hydrostatic pump shows a static hysteresis"); data sheets of proportional valves without position
feedback state 3 to 8 % of the range, 25 to 65 mA of 800 mA.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cruise.effects.drag import begins, dragged
from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value, clip, where
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class Hysteresis(Effect):
    """f(u_k) = (1 - share) u_k + share x_k, in mA, nearer to u_k where no current flows; the state is x in mA.

    x_k = clip(x_(k-1), u_k - width_ma / 2, u_k + width_ma / 2), NaN while not known.
    """

    name = "hysteresis"
    stage = Stage.COMMAND
    needs = ()
    spare = ("closed_share",)
    parameters: ClassVar = {
        "width_ma": Parameter("mA", 0.0, 400.0, 0.0, "current to turn back by before all of it moves"),
        "share": Parameter("-", 0.02, 1.0, 1.0, "share that is held back; the rest follows at once"),
        "closed_share": Parameter("-", 0.0, 1.0, 0.0, "of the band, that is closed where no current flows"),
    }
    about: ClassVar = About(
        physics="Dry friction of spool and swash plate, remanence of the solenoid's iron and slack in the linkage hold "
        "the servo where it is until the current has changed by more than the width of a band. Rising and falling, the "
        "same current then gives two speeds, and after every reversal of the current nothing happens at first. The "
        "loop depends on the path of the current and not on how fast it was driven. Slack holds all of a change back, "
        "friction against something elastic a share of it. Where springs centre the spool at no current, the loop "
        "closes there.",
        equation="f(u) = (1 - c) u + c x,  x_k = clip(x_(k-1), u_k - w/2, u_k + w/2),  |f - u| <= |u| + (1 - z) c w/2",
        source="Brokate and Sprekels 1996, ch. 2 (play, Prandtl-Ishlinskii); Coen et al. 2005, section I.A",
        signature="the residual takes the sign opposite to the last change of the current, +-gain times c w/2, and "
        "keeps it for as long as the current rests",
        look_alikes=("dead_zone", "transport_delay", "rate_limit", "active_braking", "coulomb_friction"),
        experiment="a triangle of current between 600 and 1000 mA, once at 10 mA/s and once at 40 mA/s: the loop of "
        "speed over current keeps its width if it is hysteresis, and grows with the rate if it is a delay or a lag",
    )

    width_ma: float = 0.0
    share: float = 1.0
    closed_share: float = 0.0

    def start(self, like: Value) -> State:
        """Not known: the first current is taken as it is."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The current, and what the edges of the band about it drag along."""
        low, high = value - 0.5 * self.width_ma, value + 0.5 * self.width_ma
        dragged = where(state > low, where(state < high, state, high), low)  # NaN where the current is
        held = where(state == state, dragged, value)
        return self._acts(value, held), held

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once: the shape is looked for in recordings of 10^5 samples."""
        currents_ma = np.array(np.broadcast_to(values, len(past_speeds)), float)
        half_ma = np.where(begins(np.isfinite(currents_ma)), 0.0, 0.5 * self.width_ma)
        held = dragged(currents_ma - half_ma, currents_ma + half_ma)
        return self._acts(currents_ma, held), held

    def _acts(self, value: Value, held: Value) -> Value:
        open_ma = abs(value) + self._open_ma
        return clip(value + self.share * (held - value), value - open_ma, value + open_ma)

    @property
    def _open_ma(self) -> Value:
        """How far it may lie from the current in mA where none flows."""
        return 0.5 * (1.0 - self.closed_share) * self.share * self.width_ma

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The current within the band, or beyond the edge that drags; the whole band where all is held back there."""
        half_ma = 0.5 * self.width_ma
        if math.isnan(state):
            return Inverse(value, value)
        if value == state and self.share == 1.0:
            return self.closing(value, Inverse(value - half_ma, value + half_ma))
        away_ma, free_ma = value - state, (1.0 - self.share) * half_ma
        if abs(away_ma) < free_ma:
            current_ma = state + away_ma / (1.0 - self.share)
        else:
            current_ma = value + math.copysign(self.share * half_ma, away_ma)
        return self.closing(value, Inverse(current_ma, current_ma))

    def closing(self, value: float, currents: Inverse) -> Inverse:
        """The currents that give `value`, of those that would do so if the band were as wide at no current."""
        beyond_ma = abs(value) - self._open_ma
        if beyond_ma <= 0.0:
            return currents
        least_ma = math.copysign(0.5 * beyond_ma, value)
        nearest = max if value > 0.0 else min
        return Inverse(nearest(currents.low, least_ma), nearest(currents.high, least_ma))
