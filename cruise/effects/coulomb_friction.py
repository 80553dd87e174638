"""Coulomb friction: dry friction of the drive line, of one size against whatever direction it moves in.

    phi_k = -x_k (1 + s exp(-(v / v_s)^2)),   x_k = clip(h x_(k-1) + v / v_c, -1, 1)

v speed one sample ago in m/s, v_c speed in m/s at which all of it is there within a sample, x share of the friction
that acts: at rest whatever balances the drive, by the memory h = exp(-T / 0.9 s) of the samples before; s by how much
more of it there is at rest, where no film of oil carries, and v_s speed in m/s at which a film does (Stribeck). Source:
Armstrong-Helouvry, Dupont and Canudas de Wit, "A survey of models, analysis tools and compensation methods for the
control of machines with friction", Automatica 30 (1994), section 2; P. Dahl, AIAA Journal 14 (1976) 1675-1682 (friction
that is held before it slides).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, dry, dry_over, where
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class CoulombFriction(Effect):
    """phi = -x (1 + breakaway_share exp(-(v / stribeck_mps)^2)), x the share that acts; its size is the coefficient."""

    name = "coulomb_friction"
    stage = Stage.LOAD
    needs = ()
    reads_speed = True
    spare = ("breakaway_share", "stribeck_mps")
    parameters: ClassVar = {
        "crossover_mps": Parameter("m/s", 0.01, 0.5, 0.5, "speed at which the friction is there within a sample"),
        "breakaway_share": Parameter("-", 0.0, 4.0, 0.0, "how much more of it there is at rest than sliding"),
        "stribeck_mps": Parameter("m/s", 0.05, 2.0, 0.1, "speed at which a film of oil carries, and it is less"),
    }
    about: ClassVar = About(
        physics="Gears, seals and bearings that slide on each other resist with a force that depends on the direction "
        "of the motion and hardly on its speed. The machine loses the same speed at any current, starts only once the "
        "drive exceeds the friction, and stops sooner than it would by inertia alone. While it never stops or "
        "reverses, this is a constant: no recording can tell it from an offset then. At rest and at a creep, where no "
        "film of oil carries yet, there may be more of it, up to a few times as much.",
        equation="phi = -x (1 + s exp(-(v / v_s)^2)),  x_k = clip(h x_(k-1) + v / v_c, -1, 1)",
        source="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994); Dahl, AIAA Journal 14 (1976)",
        signature="the residual jumps by one amount where the speed changes its sign, and is flat elsewhere",
        look_alikes=("dead_zone", "rolling_resistance", "sensor_bias", "hysteresis"),
        experiment="slow ramps of current through zero in both directions; then half a dozen stops from half a metre a "
        "second, forward and in reverse, the current set to zero at once, with an empty bin and again with a full one: "
        "friction ends each of them sooner and a dead zone doesn't, a full bin leaves it as it is and "
        "rolling_resistance not; sensor_bias keeps its sign in reverse",
    )

    crossover_mps: float = 0.2
    breakaway_share: float = 0.0
    stribeck_mps: float = 0.1

    @property
    def idle(self) -> frozenset[str]:
        """What there is more of at rest, and its speed, where there is none."""
        return frozenset({"breakaway_share", "stribeck_mps"} if self.breakaway_share == 0.0 else ())

    def start(self, like: Value) -> State:
        """Share that acts: none so far."""
        return like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The friction against the past speed, or what of it holds the machine."""
        share = dry(past_speed, self.crossover_mps, state, dt_s)
        return -share * self._more(past_speed), where(share == share, share, 0.0)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once, but for the share that acts."""
        shares, held = dry_over(past_speeds, self.crossover_mps, dt_s)
        return -shares * self._more(past_speeds), held

    def _more(self, past_speed: Value) -> Value:
        """1 while it slides, up to 1 + s at rest."""
        film = -((past_speed / self.stribeck_mps) ** 2)
        return 1.0 + self.breakaway_share * (np.exp(film) if isinstance(film, np.ndarray) else math.exp(film))
