"""Active braking: the machine slows down with another time constant than it speeds up with.

    alpha = min(1 + w (p - 1), r T / ((1 - q) B)),   w = 3 t^2 - 2 t^3,   t = clip(B / band, 0, 1)
    B = sign(V_(k-1)) (V_(k-1) - D_k),   D = v through three lags of tau_d / 3
    V_k = V_(k-1) + (1 - q^alpha) (D_k - V_(k-1)),   q = exp(-T / tau_v)

y speed in m/s, alpha factor on the poles (y_k = alpha f + (1 - alpha) y_(k-1), equation 12 of the paper), p braking
pace without unit, w share of braking, which t brings in smoothly, v drive signal in mA, D what of it has arrived after
the delay and lags tau_d, V a copy of the vehicle, in mA, that follows with tau_v (q of it is left after T) and brakes
as the machine does, B how much faster it still is than the drive, along its motion, so that a machine that is reversed
brakes until it stands; band = 20 mA, T period in s, r greatest fall in mA/s: a machine that nothing brakes loses no
more speed than rolling takes, however far the pump is brought back. Source: section I of Coen et al. 2005 ("the machine
is able to brake actively"), equation 12; the form of w is an assumption of this program.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, sign, where
from cruise.effects.low_pass import followed_over
from cruise.signals import Signals

UNLIMITED_MA_PER_S: Final = 10000.0  # mA/s: a tenth of a second from full current, quicker than any machine
LAGS: Final = 3  # in series: nearer to a dead time than one
BAND_MA: Final = 20.0  # mA of falling drive at which all of it is braking; above the ripple of a steady current


@dataclass(frozen=True, slots=True)
class ActiveBraking(Effect):
    """alpha = 1 + w (braking_pace - 1); w goes from 0, rising or steady, to 1 where the drive falls.

    It is less where the drive would fall by more than fall_ma_per_s, in mA/s.
    """

    name = "active_braking"
    stage = Stage.DYNAMICS
    needs = ()
    instead = ("fall_ma_per_s",)
    parameters: ClassVar = {
        "braking_pace": Parameter(
            "-", 0.2, 4.0, 1.0, "pace while the drive falls; below 1 the machine coasts, above it brakes harder"
        ),
        "fall_ma_per_s": Parameter(
            "mA/s", 20.0, UNLIMITED_MA_PER_S, UNLIMITED_MA_PER_S, "greatest fall that it follows; 10000 is no limit"
        ),
        "lag_s": Parameter("s", 0.05, 1.5, 0.4, "delay and lag after which the vehicle feels the drive"),
        "time_constant_s": Parameter("s", 0.1, 3.0, 0.5, "of the vehicle while it speeds up"),
    }
    about: ClassVar = About(
        physics="When the pump is brought back, the wheels drive the motor and the motor drives the pump: the drive "
        "brakes against the engine's drag. Relief valves, replenishing valves and the little that a diesel can absorb "
        "make this path another one than that of acceleration, so that the machine coasts, or brakes harder than it "
        "accelerates; and however far the pump is brought back, it slows down no faster than rolling and a braking "
        "pressure allow. One linear model can only have the mean of both ways.",
        equation="y_k = alpha f + (1 - alpha) y_(k-1),  alpha = 1 + w (p - 1),  w = 1 while |v| falls, 0 otherwise; "
        "alpha less where the drive would fall by more than r",
        source="Coen et al. 2005, section I and equation 12; the smooth switch is an assumption",
        signature="after each step down the residual has one sign for a second or two, and the opposite one after "
        "each step up if the linear part was fitted to both; nothing in steady driving",
        look_alikes=("hysteresis", "rate_limit", "coulomb_friction", "power_limit"),
        experiment="equal steps up and down between the same two currents (say 300 mA apart), 8 s each, on level "
        "ground: the time to 63 % differs and the steady speeds do not; with hysteresis the steady speeds differ, "
        "with rate_limit larger steps take longer",
    )

    braking_pace: float = 1.0
    fall_ma_per_s: float = UNLIMITED_MA_PER_S
    lag_s: float = 0.4
    time_constant_s: float = 0.5

    @property
    def idle(self) -> frozenset[str]:
        """The greatest fall where there is none."""
        return frozenset({"fall_ma_per_s"} if self.fall_ma_per_s >= UNLIMITED_MA_PER_S else ())

    def start(self, like: Value) -> State:
        """The three lags and the vehicle's copy, in mA, unknown before the first sample; the pace."""
        return like * math.nan, like * math.nan, like * math.nan, like * math.nan, like * 0.0 + 1.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The drive as it is, which the state follows."""
        first_ma, second_ma, arrived_ma, copy_ma, _ = state
        lag = 1.0 - np.exp(-LAGS * dt_s / self.lag_s)
        first_ma = where(first_ma == first_ma, first_ma, value)
        second_ma = where(second_ma == second_ma, second_ma, value)
        arrived_ma = where(arrived_ma == arrived_ma, arrived_ma, value)
        first_ma = first_ma + lag * (value - first_ma)
        second_ma = second_ma + lag * (first_ma - second_ma)
        arrived_ma = arrived_ma + lag * (second_ma - arrived_ma)
        copy_ma = where(copy_ma == copy_ma, copy_ma, arrived_ma)
        behind_ma = sign(copy_ma) * (copy_ma - arrived_ma)
        falling = clip(behind_ma / BAND_MA, 0.0, 1.0)
        pace = 1.0 + falling * falling * (3.0 - 2.0 * falling) * (self.braking_pace - 1.0)
        whole_ma = (1.0 - np.exp(-dt_s / self.time_constant_s)) * behind_ma
        reach_ma = where(self.fall_ma_per_s < UNLIMITED_MA_PER_S, self.fall_ma_per_s * dt_s, math.inf)
        pace = where(pace * whole_ma > reach_ma, reach_ma / where(whole_ma > 0.0, whole_ma, 1.0), pace)
        copy_ma = copy_ma + (1.0 - np.exp(-dt_s * pace / self.time_constant_s)) * (arrived_ma - copy_ma)
        return value, (first_ma, second_ma, arrived_ma, copy_ma, pace)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The lags by filters, the copy in one narrow loop: the shape is looked for in recordings of 10^5 samples."""
        values = np.array(np.broadcast_to(values, len(past_speeds)), float)
        passed_ma = [values]
        for _ in range(LAGS):
            passed_ma.append(followed_over(passed_ma[-1], self.lag_s / LAGS, dt_s))
        copy, along = math.nan, -dt_s / self.time_constant_s
        plain, full = 1.0 - math.exp(along), 1.0 - math.exp(along * self.braking_pace)
        reach = self.fall_ma_per_s * dt_s if self.fall_ma_per_s < UNLIMITED_MA_PER_S else math.inf
        copies, paces = [], []
        for arrived in passed_ma[-1].tolist():
            copy = copy if copy == copy else arrived
            way = 1.0 if copy > 0.0 else -1.0 if copy < 0.0 else copy  # 0 at rest, NaN where nothing is known
            behind = way * (copy - arrived)
            if behind <= 0.0:
                pace, share = 1.0, plain
            elif behind >= BAND_MA:
                pace, share = self.braking_pace, full
            else:
                falling = behind / BAND_MA
                pace = 1.0 + falling * falling * (3.0 - 2.0 * falling) * (self.braking_pace - 1.0)
                share = 1.0 - math.exp(along * pace)
            if pace * plain * behind > reach:
                pace = reach / (plain * behind)
                share = 1.0 - math.exp(along * pace)
            copy += share * (arrived - copy)
            copies.append(copy)
            paces.append(pace)
        return values, (*passed_ma[1:], np.array(copies), np.array(paces))

    def pace(self, signals: Signals, state: State) -> Value:
        """More or less than 1 while the drive falls."""
        return state[4]
