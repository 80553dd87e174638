"""The predictive law: the wanted drive over the horizon as one small quadratic programme, solved anew at every frame.

    minimise   sum_i (y_i - r_i)^2 + rho sqrt(alpha) sum_b (w_b - w_(b-1))^2 + sigma sum xi^2
    with       y_i = A y_(i-1) + (1 - A) (sum_j h_j z_(i-d-j) + l_i),   z_i = e z_(i-1) + (1 - e) s_i
               s = F_x x + F_w E w
    subject to w_min <= w_b <= w_max,   |y_i - y_(i-1)| <= A_max T,   |y_i - 2 y_(i-1) + y_(i-2)| <= J_max T^2,
               -R_- T <= s_i - s_(i-1) <= R_+ T

Everything is in m/s of steady speed: w wanted drive, constant over the blocks that E spreads, x states of the shaper,
s the drive that is sent (so the 1 Hz limit is a part of what is optimised), z what a servo of its own (`rate_limit`)
makes of it by its lag, e = exp(-T / tau), R_+ and R_- the rates that it follows, h and d response and delay of the
drive, l loads and disturbance with the trend that they have, A pole of the vehicle and alpha the pace by which a gear
slows it (the same drive is sqrt(alpha) as much current in it), T frame, xi by how much acceleration and jerk exceed
their bound, as a share of the setting, and the rate its own, in m/s2 (soft: a disturbance may already have broken them,
and one frame can't mend it). In these units the matrices depend on pole and pace alone: they are made once for each,
and a frame moves vectors only.
Solver: DAQP (Arnstrom et al., IEEE TAC 67 (2022)), kept with its memory and started from the last active set.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final

import daqp
import msgspec
import numpy as np

from cruise.control.shaping import CommandShaper
from cruise.effects import low_pass
from cruise.settings import Positive

_FREE, _SOFT = 0, 8  # DAQP's "sense" of a constraint
GROWTH: Final = 1.45  # of the blocks over which the wanted drive is constant, from one to the next
ROWS_S: Final = 0.1  # s between two bounds on acceleration, jerk and rate
FELT: Final = 0.1  # share of the response from which on a bound is a row: with less the command would swing at its rate


class PredictiveSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The horizon and what it weighs."""

    # s, Coen et al. 2005, section II.B; a plan takes time by the square of it, and fourth gear has settled after 10 s
    horizon_s: Annotated[float, msgspec.Meta(gt=0, le=10)] = 3.0
    # rho, without unit, per frame of 0.05 s; less lets sensor noise into the command
    move_weight: Annotated[float, msgspec.Meta(ge=0.1)] = 3.0
    accel_max_mps2: Positive = 1.0  # m/s2, predicted
    jerk_max_mps3: Positive = 2.0  # m/s3, predicted
    engaging_share: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.5  # of both bounds, while it takes over
    excess_weight: Positive = 0.05  # sigma, (m/s)^2: all of a bound too much in a row costs as 0.2 m/s for a frame
    # The reference begins so gently that a machine which answers late can be there earlier than its dead time says.
    lead_s: Annotated[float, msgspec.Meta(ge=0)] = 0.1
    trend_s: Positive = 0.5  # s over which the trend of what is measured is seen
    believed_s: Positive = 0.8  # s for which it is believed to go on: dead time and lags


@dataclass(frozen=True, slots=True)
class Plan:
    """What the law wants, and whether the solver found it."""

    wanted_mps: float  # drive, in m/s of steady speed
    speeds_mps: np.ndarray  # (horizon,) predicted
    solved: bool


@dataclass(frozen=True, slots=True)
class Now:
    """What a plan begins from, in m/s of steady speed."""

    speed_mps: float
    drives_mps: np.ndarray  # (depth,) as sent, newest first
    shaper_mps: np.ndarray  # states of the shaper
    load_mps: float  # loads, offset and disturbance
    trend_mps2: float  # at which load and gain move the speed
    wanted_mps: float  # of the last plan


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the plan has to keep."""

    low_mps: float
    high_mps: float
    rise_mps2: float  # of the drive that is sent
    fall_mps2: float
    share: float = 1.0  # of the bounds on acceleration and jerk; less while engaging
    accel_share: float = 1.0  # of that on acceleration, beside it; less where the drive may be quicker than its model


class Programme:
    """The law for one pole."""

    def __init__(
        self,
        pole: float,
        response: np.ndarray,
        delay: int,
        shaper: CommandShaper,
        frame_s: float,
        settings: PredictiveSettings,
        pace: float = 1.0,
        servo_s: float = 0.0,
    ) -> None:
        """`response` (nb,) are the h_j, which sum to 1; `delay` in frames, `pace` alpha, `servo_s` tau."""
        depth = delay + len(response)
        count = max(round(settings.horizon_s / frame_s), depth + 4)
        self.count, self.frame_s = count, frame_s
        steps = np.arange(1, count + 1)
        decay = pole ** (steps - 1.0)
        lag = np.subtract.outer(np.arange(count), np.arange(count))
        vehicle = np.where(lag >= 0, (1.0 - pole) * pole ** np.maximum(lag, 0), 0.0)  # from l and s to y
        taps = np.concatenate([np.zeros(delay), response])  # what of s_k is felt j frames later
        felt = np.where((lag >= 0) & (lag < depth), taps[np.clip(lag, 0, depth - 1)], 0.0)
        kept = 1.0 - low_pass.share(servo_s, frame_s)
        servo = np.where(lag >= 0, (1.0 - kept) * kept ** np.maximum(lag, 0), 0.0)  # from s to z
        drive = vehicle @ felt @ servo
        reach = np.add.outer(np.arange(1, count + 1), np.arange(depth))  # age of past drives at every step
        past = vehicle @ np.where(reach < depth, taps[np.minimum(reach, depth - 1)], 0.0)
        past[:, 0] += vehicle @ felt @ kept**steps
        from_states, from_wanted = shaper.response(count)
        lasts_s = settings.believed_s
        trend = vehicle @ (lasts_s * -np.expm1(-steps * frame_s / lasts_s))
        self.lengths = lengths = _blocks(count - delay)
        spread = np.repeat(np.eye(len(lengths)), lengths, axis=0)
        spread = np.vstack([spread, np.tile(spread[-1], (count - len(spread), 1))])
        self._known = np.column_stack(
            [pole * decay, past, drive @ from_states, vehicle.sum(axis=1), trend]
        )  # of y0, past drives, shaper, load, trend
        self._forced = drive @ from_wanted @ spread
        blocks = len(lengths)
        moves = np.eye(blocks) - np.eye(blocks, k=-1)
        weight = settings.move_weight * math.sqrt(pace) * (0.05 / frame_s)
        self._hessian = np.ascontiguousarray(self._forced.T @ self._forced + weight * moves.T @ moves)
        self._weight, self._blocks, self._excess_weight = weight, blocks, settings.excess_weight
        every = max(round(ROWS_S / frame_s), 1)
        felt_at = int(np.argmax(np.cumsum((felt @ servo)[:, 0]) >= FELT))
        rows = np.arange(max(felt_at, 2), count, every)  # before, nothing can be done
        first = np.eye(count) - np.eye(count, k=-1)
        second = first @ first
        accel = first[rows] / (settings.accel_max_mps2 * frame_s)
        jerk = second[rows] / (settings.jerk_max_mps3 * frame_s**2)
        motion, rate = np.vstack([accel, jerk]), first[1 : count // 2 : every] / frame_s
        self._motion_known, self._rate_states = motion @ self._known, rate @ from_states
        constraints = np.vstack([motion @ self._forced, rate @ from_wanted @ spread])
        self._constraints = np.ascontiguousarray(constraints)
        self._counts = len(rows), len(rows), len(rate)
        self._sense = np.concatenate([np.full(blocks, _FREE), np.full(len(constraints), _SOFT)]).astype(np.int32)
        self._gradient_reference = np.ascontiguousarray(self._forced.T)
        self._solver: daqp.Model | None = None

    def solve(self, now: Now, reference_mps: np.ndarray, bounds: Bounds) -> Plan:
        """One programme; `reference_mps` (count,) from the next frame on."""
        known = np.concatenate([(now.speed_mps,), now.drives_mps, now.shaper_mps, (now.load_mps, now.trend_mps2)])
        free = self._known @ known
        gradient = self._gradient_reference @ (free - reference_mps)
        gradient[0] -= self._weight * now.wanted_mps
        accels, jerks, rates = self._counts
        reach = np.concatenate(
            [
                np.full(accels, bounds.share * bounds.accel_share),
                np.full(jerks, bounds.share),
                np.full(rates, bounds.rise_mps2),
            ]
        )
        back = np.concatenate([reach[: accels + jerks], np.full(rates, bounds.fall_mps2)])
        middle = np.concatenate([self._motion_known @ known, self._rate_states @ now.shaper_mps])
        upper = np.concatenate([np.full(self._blocks, bounds.high_mps), reach - middle])
        lower = np.concatenate([np.full(self._blocks, bounds.low_mps), -back - middle])
        wanted = self._solved(gradient, upper, lower)
        if wanted is None:
            return Plan(now.wanted_mps, free, False)
        return Plan(float(wanted[0]), free + self._forced @ wanted, True)

    def _solved(self, gradient: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> np.ndarray | None:
        solver = self._solver
        if solver is None:
            solver = self._solver = daqp.Model()
            solver.settings = {"rho_soft": 1.0 / self._excess_weight}
            solver.setup(self._hessian, gradient, self._constraints, upper, lower, self._sense)
        else:
            solver.update(f=gradient, bupper=upper, blower=lower)
        wanted, _, flag, _ = solver.solve()
        if flag < 1 or not np.isfinite(wanted).all():
            self._solver = None
            return None
        return wanted


def _blocks(count: int) -> list[int]:
    """Lengths in frames that grow and sum to `count`."""
    lengths, exact = [], 1.0
    while sum(lengths) < count:
        lengths.append(min(round(exact), count - sum(lengths)))
        exact *= GROWTH
    return lengths
