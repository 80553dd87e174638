"""The slip that wheel and ground speed show without any model: how much of the speed it takes, and if it is slip.

    v_g = c_0 + c_1 v_w + c_2 dv_w/dt + slip,   over means of 2 s, less what noise leaves in them

c_0, c_1 tyre radius and offset of the sensors, c_2 the time by which one is later than the other. Only slip and a
biased sensor make the two differ otherwise, so that an explanation without either has to call all of it a little.

    d = v_g - v_w,   d^ = mean of d within 20 s, or v_w sum(v_w d) / sum(v_w^2) within 20 s, but for the 0.6 s beside it

A bias is the same at any speed, slip is a share of it: whichever foretells d better, by standard errors over blocks of
20 s, is what it is. Source: regression through the origin or on a constant, any textbook.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.identification.explore.two_speeds import WHEEL, compared
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.means import sums_beside

MEAN_S: Final = 2.0  # s
FEWEST: Final = 20  # means, below which nothing is said
FINE_S: Final = 0.2  # s of the means in which a bias and slip are told apart,
AROUND_S: Final = 20.0  # s before and after that foretell one of them, and of a block,
BESIDE_S: Final = 0.6  # but for so many beside it
TURNING_MPS: Final = 0.3  # m/s, below which the wheels say nothing
FEWEST_BLOCKS: Final = 6


def slip_mps(recordings: Sequence[Recording]) -> float:
    """RMS in m/s; 0 where the wheels' speed is not recorded, or where the sensors' noise may be all of it."""
    rows, ground, scatter, size = [], [], [], 1
    for one in recordings:
        both = compared(one, MEAN_S)
        if both is None:
            return 0.0
        size = both.size
        rows.append(both.columns)
        ground.append(both.more_mps.mean(axis=1))
        scatter.append(np.diff(both.more_mps, axis=1).ravel())
    columns, lost = np.concatenate(rows), np.concatenate(ground)
    if len(lost) < FEWEST:
        return 0.0
    rest = lost - columns @ np.linalg.lstsq(columns, lost, rcond=None)[0]
    noise = 0.5 * float(np.mean(np.concatenate(scatter) ** 2)) / size
    return math.sqrt(max(float(np.mean(rest**2)) - noise, 0.0))


def sure_of_slip(recordings: Sequence[Recording]) -> float:
    """Standard errors by which the difference of the two speeds is a share of the speed; negative: it is a bias.

    0 where the wheels' speed is not recorded, or the drive is too short to tell.
    """
    won: list[float] = []
    for one in recordings:
        if WHEEL not in one.columns:
            return 0.0
        size = max(round(FINE_S / one.dt_s), 1)
        count = len(one) // size
        ground, wheel = (
            one.columns[name][: count * size].reshape(count, size).mean(axis=1) for name in (OUTPUT, WHEEL)
        )
        turning = np.isfinite(ground) & np.isfinite(wheel) & (np.abs(np.nan_to_num(wheel)) > TURNING_MPS)
        won += _won_by_slip(
            np.where(turning, ground - wheel, 0.0), np.where(turning, wheel, 0.0), turning, size * one.dt_s
        )
    if len(won) < FEWEST_BLOCKS or not np.ptp(won):
        return 0.0
    return float(np.sum(won) / (np.std(won) * math.sqrt(len(won))))


def _won_by_slip(lost_mps: np.ndarray, wheel_mps: np.ndarray, turning: np.ndarray, dt_s: float) -> list[float]:
    """By how much the squared error (m2/s2) of a bias is more than that of slip, in every block while wheels turn."""
    half, gap = round(AROUND_S / dt_s), round(BESIDE_S / dt_s)
    known, lost, product, square = (
        sums_beside(one, half, gap) for one in (turning.astype(float), lost_mps, wheel_mps * lost_mps, wheel_mps**2)
    )
    bias_mps, slip = lost / np.maximum(known, 1.0), product / np.maximum(square, 1e-9)
    more = (lost_mps - bias_mps) ** 2 - (lost_mps - slip * wheel_mps) ** 2
    judged = turning & (known >= FEWEST)
    blocks = [slice(start, start + half) for start in range(0, len(more), half)]
    return [float(more[one][judged[one]].sum()) for one in blocks if judged[one].sum() >= FEWEST]
