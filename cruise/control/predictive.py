"""The predictive law: the wanted drive signal over the horizon as one small quadratic programme.

    minimise   sum_i (y_i - r_i)^2 + rho sum_i (K (w_i - w_(i-1)))^2 + rho_e sum_i s_i^2
    with       y = free + G (F_x x + F_w w)
    subject to w_min <= w_i <= w_max,   |y_i - y_(i-1)| <= A T + s_i

w wanted drive in mA (one per period of the horizon), x states of the shaper in mA of drive, F its response, G the
model's forced response in m/s per mA, r reference in m/s, K DC gain, A largest acceleration, T period. The
acceleration is a soft bound (a disturbance may already have broken it). Solver: DAQP (Arnstrom et al., IEEE TAC 67
(2022)), which takes the soft bounds itself.
"""

from dataclasses import dataclass
from typing import Annotated

import daqp
import msgspec
import numpy as np

from cruise.settings import Positive

_FREE, _SOFT = 0, 8  # DAQP's "sense" of a constraint


class PredictiveSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The horizon and what it weighs."""

    horizon_s: Positive = 3.0  # s, Coen et al. 2005, section II.B
    # rho, without unit; less lets the current overshoot into the hysteresis' other branch
    move_weight: Annotated[float, msgspec.Meta(ge=0)] = 4.0
    accel_max_mps2: Positive = 1.0  # m/s2, predicted


@dataclass(frozen=True, slots=True)
class Plan:
    """What the law wants, and whether the solver found it."""

    wanted_ma: float  # drive signal
    speeds_mps: np.ndarray  # (horizon,) predicted
    solved: bool


def solve(
    free_mps: np.ndarray,
    response_mps_per_ma: np.ndarray,
    reference_mps: np.ndarray,
    speed_mps: float,
    last_wanted_ma: float,
    bounds_ma: tuple[float, float],
    dc_gain_mps_per_ma: float,
    period_s: float,
    settings: PredictiveSettings,
) -> Plan:
    """One programme. All arrays (horizon,), the response (horizon, horizon); `speed_mps` is y_0."""
    count = len(free_mps)
    # In units of m/s of steady speed the programme is well scaled whatever the gear.
    response = response_mps_per_ma / dc_gain_mps_per_ma
    last = last_wanted_ma * dc_gain_mps_per_ma
    difference = np.eye(count) - np.eye(count, k=-1)
    start = np.zeros(count)
    start[0] = last
    hessian = response.T @ response + settings.move_weight * difference.T @ difference
    gradient = response.T @ (free_mps - reference_mps) - settings.move_weight * difference.T @ start
    before = np.zeros(count)
    before[0] = speed_mps
    steps = difference @ free_mps - before
    reach = settings.accel_max_mps2 * period_s
    lower, upper = (bound * dc_gain_mps_per_ma for bound in bounds_ma)
    wanted, _, flag, _ = daqp.solve(
        hessian,
        gradient,
        np.ascontiguousarray(difference @ response),
        np.concatenate([np.full(count, upper), reach - steps]),
        np.concatenate([np.full(count, lower), -reach - steps]),
        np.concatenate([np.full(count, _FREE), np.full(count, _SOFT)]).astype(np.int32),
    )
    if flag < 1 or not np.isfinite(wanted).all():
        return Plan(last_wanted_ma, free_mps, False)
    return Plan(float(wanted[0]) / dc_gain_mps_per_ma, free_mps + response @ wanted, True)
