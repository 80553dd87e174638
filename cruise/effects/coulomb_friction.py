"""Coulomb friction: dry friction of the drive line, of one size against whatever direction it moves in.

    phi = -tanh(v / v_c)

v speed one sample ago in m/s, v_c speed in m/s at which the friction has built up. Source: Armstrong-Helouvry, Dupont
and Canudas de Wit, "A survey of models, analysis tools and compensation methods for the control of machines with
friction", Automatica 30 (1994); the tanh in place of the sign is a common regularisation.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, tanh
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class CoulombFriction(Effect):
    """phi = -tanh(v / crossover_mps), without unit: the friction's size is the fitted coefficient."""

    name = "coulomb_friction"
    stage = Stage.LOAD
    needs = ()
    reads_speed = True
    parameters: ClassVar = {
        "crossover_mps": Parameter("m/s", 0.02, 1.0, 0.2, "speed at which three quarters of the friction are there"),
    }
    about: ClassVar = About(
        physics="Gears, seals and bearings that slide on each other resist with a force that depends on the direction "
        "of the motion and hardly on its speed. The machine loses the same speed at any current, starts only once the "
        "drive exceeds the friction, and stops sooner than it would by inertia alone. While it never stops or "
        "reverses, this is a constant: no recording can tell it from an offset then.",
        equation="phi = -tanh(v / v_c)",
        source="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)",
        signature="the residual jumps by one amount where the speed changes its sign, and is flat elsewhere",
        look_alikes=("dead_zone", "rolling_resistance", "sensor_bias", "hysteresis"),
        experiment="slow ramps of current through zero in both directions, then the current set to zero at 1 m/s and "
        "the machine left to stop: friction shortens the stop and a dead zone doesn't; sensor_bias keeps its sign in "
        "reverse",
    )

    crossover_mps: float = 0.2

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The direction of the friction, built up with the past speed."""
        return -tanh(past_speed / self.crossover_mps), state
