"""An explanation of a recording: the physical core with the effects that act beside it, and its discrete model.

The core's parameters, the coefficients of the loads and the shapes of the effects stand in one vector, so that they
are fitted jointly: a core that is held fixed gets its error blamed on the wrong effect.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from cruise.effects import Effect, Parameter, Stage
from cruise.model.core import Core, discretised
from cruise.model.model import Model

LONGEST_LAG_S: Final = 2.0  # s, of the actuator; slower belongs to the vehicle
RINGS: Final = 0.5  # damping of a pair of poles, from which it overshoots by less than a sixth: a resonance has less
START: Final = Core(0.0, 0.3, 0.15, 0.6, 0.05)  # a machine of this class; the gain comes from the recordings
CORE: Final[Mapping[str, Parameter]] = {
    "gain_mps_per_ma": Parameter("m/s per mA", -1.0, 1.0, 0.0, "steady speed per mA of drive"),
    "delay_s": Parameter("s", 0.0, 2.0, 0.3, "dead time between current and drive"),
    "lag_s": Parameter("s", 0.02, LONGEST_LAG_S, 0.15, "lag of the actuator"),
    "second_lag_s": Parameter("s", 0.005, LONGEST_LAG_S, 0.05, "second lag of the actuator"),
    "time_constant_s": Parameter("s", 0.03, 10.0, 0.6, "time constant of the vehicle"),
    "servo_hz": Parameter("Hz", 0.4, 4.0, 1.5, "frequency of the servo, where two lags are too few for it"),
    "servo_damping": Parameter("-", RINGS, 0.99, 0.8, "its damping: with less it is a resonance"),
    # Not zero, where gears would slow the drive by another equation: a fit walks through no such edge.
    "stroke_share": Parameter("-", 0.01, 0.9, 0.01, "share of how far the drive yields that rises with the stroke"),
}
PUSHED_S: Final = 300.0  # s, the longest time constant of a vehicle that a torque pushes: its drag alone slows it
RESONANCE: Final[Mapping[str, Parameter]] = {
    "resonance_share": Parameter(
        "-", -2.0, 1.0, 0.0, "share of the drive that passes through the resonance; below 0 what swings is beside it"
    ),
    "resonance_hz": Parameter("Hz", 0.25, 2.4, 1.0, "frequency of the resonance, undamped"),
    "damping": Parameter("-", 0.03, 0.6, 0.2, "damping of the resonance"),
}
"""Shape parameters of the core and where they may lie."""


@dataclass(frozen=True)
class Explanation:
    """Core, effects and coefficients. `loads` in m/s of steady speed per unit of phi, in the order of the effects."""

    core: Core
    effects: tuple[Effect, ...] = ()
    loads: tuple[float, ...] = ()
    offset_mps: float = 0.0
    structural: frozenset[str] = field(default_factory=frozenset)  # effects that live in the core: resonance ...

    @property
    def names(self) -> tuple[str, ...]:
        """The effects that it holds, those of the core's structure too."""
        return (*(effect.name for effect in self.effects), *sorted(self.structural))

    def at(self, stage: Stage) -> tuple[int, ...]:
        """Places of the effects that act at a stage."""
        return tuple(i for i, effect in enumerate(self.effects) if effect.acts_as is stage)

    def model(self, period_s: float, like: Model | None = None) -> Model:
        """The discrete model that estimator and controller run: equal to this one up to the last taps' tail.

        `like` fixes its delay and number of taps, to compare parameters of explanations that differ by little.
        """
        return discretised(self.core, self.effects, self.loads, self.offset_mps, period_s, like)
