"""Transport delay: what is asked of the drive reaches the wheels later than the model thinks.

    y_k = ... + sum_j b_j f(u)_(k-d-D-j) ,   D = round(theta / T)

y speed in m/s, f(u) what acts of the current in mA and b_j its taps, d delay of the model without this effect in
samples, theta further delay in s and D in samples, T period in s. It is an effect of *structure*: it has no term of its
own, `restructured` gives the delay of the model that has it. Source: Table I of Coen et al. 2005, 0.5 s from current to
speed; section IV.B on what a wrong delay does.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class TransportDelay(Effect):
    """The delay of the model grows by delay_s; the drive signal passes unchanged."""

    name = "transport_delay"
    stage = Stage.DYNAMICS
    needs = ()
    parameters: ClassVar = {
        "delay_s": Parameter("s", 0.0, 2.0, 0.0, "delay beyond that of the model, in whole samples"),
    }
    about: ClassVar = About(
        physics="Bus and controller take their time, the servo's oil has to fill before the swash plate turns, and "
        "play has to be taken up: nothing happens at the wheels for some tenths of a second, and then everything "
        "happens as before. A lag begins at once and is slow; a delay begins late and is not slower. This is a matter "
        "of structure: adding it changes the model's delay and adds no term. A model with too short a delay needs "
        "more coefficients, and blames what is left on whatever moves with the current.",
        equation="y_k = ... + sum_j b_j f(u)_(k-d-D-j),  D = round(theta / T)",
        source="Coen et al. 2005, section IV.B, Table I, Fig. 3",
        signature="the residual correlates with the change of current at lags before the response and oscillates "
        "once after every step, up and down alike, at any speed",
        look_alikes=("rate_limit", "resonance", "hysteresis", "active_braking"),
        experiment="steps of current of 100, 200 and 400 mA up and down from 0.5 and 1.5 m/s, 6 s apart: a delay "
        "starts each response equally late; hysteresis delays reversals only, rate_limit large steps only",
    )

    delay_s: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The drive as it is: the delay is in the model's structure."""
        return value, state

    def restructured(self, na: int, nb: int, delay: int, period_s: float) -> tuple[int, int, int]:
        """The same orders, more delay."""
        return na, nb, delay + round(self.delay_s / period_s)
