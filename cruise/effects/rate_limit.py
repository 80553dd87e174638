"""Rate limit: small orifices feed the pump's servo, so that it follows a fast current only at its own pace.

    x_k = x_(k-1) + clip((1 - exp(-dt / tau)) (u_k - x_(k-1)), -q r dt, r dt),   tau -> 0: clip(u_k, x_(k-1) -+ r dt)

u current in mA, x what acts in mA, r greatest rate in mA/s away from neutral and q times as much back to it (for x < 0
with the other signs), tau lag of the servo in s with which small changes are followed, dt period in s. Source: M.
Jelali, A. Kroll, Hydraulic Servo-systems (2003), ch. 4 (flow-limited servo stage); data sheets of axial piston pumps
with control orifices, one for each way: neutral to full stroke, some 800 mA, in 0.4 to 3 s, which is 270 to 2000 mA/s.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value, where
from cruise.effects.low_pass import AT_ONCE_S, followed_over, share
from cruise.signals import Signals

UNLIMITED_MA_PER_S: Final = 10000.0  # mA/s: a tenth of a second to full current, within every servo's lag


@dataclass(frozen=True, slots=True)
class RateLimit(Effect):
    """|dx/dt| <= rate_ma_per_s, in mA/s, none from 10000 mA/s up; the state is x in mA, NaN while not known."""

    name = "rate_limit"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "rate_ma_per_s": Parameter(
            "mA/s", 20.0, UNLIMITED_MA_PER_S, UNLIMITED_MA_PER_S, "greatest rate of what acts; 10000 is no limit"
        ),
        "lag_s": Parameter("s", 0.0, 1.0, 0.0, "lag with which it follows within that rate"),
        "return_share": Parameter("-", 0.5, 5.0, 1.0, "rate back to neutral over that away from it"),
    }
    about: ClassVar = About(
        physics="The servo piston that tilts the swash plate is filled through orifices, which makers choose on "
        "purpose to keep the machine from jerking, often one for each way, as springs help it back to neutral. Their "
        "flow sets a greatest rate: a small step is followed at once, a great one by a ramp whose duration grows with "
        "the step. A lag, in contrast, takes as long for a great step as for a small one.",
        equation="x_k = x_(k-1) + clip((1 - exp(-dt / tau)) (u_k - x_(k-1)), -q r dt, r dt)",
        source="Jelali and Kroll 2003, ch. 4; data sheets of pumps with control orifices (0.4 to 3 s to full stroke)",
        signature="after great steps the residual opposes the step and lasts the longer the greater it was; after "
        "small steps and slow ramps there is none",
        look_alikes=("transport_delay", "resonance", "power_limit", "hysteresis"),
        experiment="steps of current of 50, 150 and 450 mA up and down from the same level, 8 s apart: with a rate "
        "limit the time to 63 % grows with the step, with a lag it does not",
    )

    rate_ma_per_s: float = UNLIMITED_MA_PER_S
    lag_s: float = 0.0
    return_share: float = 1.0

    def start(self, like: Value) -> State:
        """Not known: the first current is taken as it is."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The last output, moved towards the current as far as lag and rate allow."""
        reach_ma = where(self.rate_ma_per_s < UNLIMITED_MA_PER_S, self.rate_ma_per_s * dt_s, math.inf)
        wanted = value - (1.0 - share(self.lag_s, dt_s)) * (
            value - state
        )  # the current itself, to the bit, where there is no lag
        back_ma = self.return_share * reach_ma
        low = state - where(state > 0.0, back_ma, reach_ma)
        high = state + where(state < 0.0, back_ma, reach_ma)
        moved = where(wanted < low, low, where(wanted > high, high, wanted))
        result = where(state == state, moved, value)
        return result, result

    def settled(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> Value:
        """The current itself, wherever the servo still is."""
        return value

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The lag alone where the rate allows all of it; else one narrow loop over 10^5 samples."""
        reach_ma = self.rate_ma_per_s * dt_s if self.rate_ma_per_s < UNLIMITED_MA_PER_S else math.inf
        rest = math.exp(-dt_s / max(self.lag_s, AT_ONCE_S))
        current = np.broadcast_to(np.asarray(values, float), len(past_speeds))
        if not np.isinf(current).any():
            lagged = followed_over(current, self.lag_s, dt_s)
            most_ma = np.fmax.reduce(np.abs(np.diff(lagged)), initial=0.0)  # holes aside
            if most_ma <= min(reach_ma, self.return_share * reach_ma):
                return lagged, lagged
        back_ma = self.return_share * reach_ma
        result, results = math.nan, []
        for value in current.tolist():
            if result == result:
                wanted = value - rest * (value - result)
                low_ma = back_ma if result > 0.0 else reach_ma
                high_ma = back_ma if result < 0.0 else reach_ma
                low_ma, high_ma = result - low_ma, result + high_ma
                result = low_ma if wanted < low_ma else high_ma if wanted > high_ma else wanted
            else:
                result = value
            results.append(result)
        outputs = np.array(results)
        return outputs, outputs

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The value itself: within reach it is given at once, beyond it the output moves there as fast as it can.

        How far the reach is depends on the time step, which an inverse does not know. At its very end, where any
        further current would serve as well, the value itself still does.
        """
        return Inverse(value, value)
