"""By what ground speed and wheel speed differ throughout: an offset of one sensor, and a share of the speed.

    v_g - v_w = b_0 + b_1 v_w + b_2 dv_w/dt,   over means of 1 s

v_g ground and v_w wheel speed in m/s, b_0 offset in m/s, b_1 what ground speed reads more per m/s: slip, or wheels
that are smaller or larger than assumed; b_2 the time by which one is later than the other. Standard errors by blocks of
20 s, as slip and noise last. A model has a constant of its own, which takes an offset that never changes: `diagnose`
then says that nothing is missing, and this is where it shows.

Source: additive and multiplicative sensor faults, R. Isermann, Fault-Diagnosis Systems, Springer 2006; sandwich of
clustered errors, any textbook of econometrics.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.identification.explore.pieces import CONSTANT, Estimate
from cruise.recording import Recording

WHEEL: Final = "wheel_speed_mps"
MEAN_S: Final = 1.0  # s
BLOCK_S: Final = 20.0  # s
FEWEST_BLOCKS: Final = 6
SURE: Final = 5.0  # standard errors: few blocks know their own only roughly
LEAST_MPS: Final = 0.01  # m/s, what no model of a drive leaves less than


@dataclass(frozen=True, slots=True)
class TwoSpeeds:
    """What ground speed reads more than wheel speed: at any speed, and per m/s."""

    offset_mps: Estimate
    share: Estimate

    @property
    def offset(self) -> bool:
        """Whether the two have an offset."""
        return abs(self.offset_mps.value) > max(LEAST_MPS, SURE * self.offset_mps.std)

    def words(self) -> list[str]:
        """Return the offset as a sentence, if there is one."""
        if not self.offset:
            return []
        more = "more" if self.offset_mps.value > 0.0 else "less"
        return [
            f"ground speed reads {abs(self.offset_mps.value):.3g} +- {self.offset_mps.std:.1g} m/s {more} than wheel "
            "speed, at any speed: one of the sensors has an offset. A model takes a constant one into its own, so that "
            "nothing is missing by it; mend the sensor"
        ]


@dataclass(frozen=True, eq=False)
class Compared:
    """Means of a recording in which both speeds were measured throughout, M of `size` samples each."""

    size: int
    place: np.ndarray  # (M,) which of all means
    columns: np.ndarray  # (M, 3) 1, v_w in m/s, and what v_w gains within the mean
    more_mps: np.ndarray  # (M, size) what ground speed reads more than wheel speed


def compared(one: Recording, mean_s: float) -> Compared | None:
    """The two speeds of a recording in means of so many seconds; None where the wheels' is not recorded."""
    if WHEEL not in one.columns:
        return None
    size = max(round(mean_s / one.dt_s), 2)
    count = len(one) // size
    wheel, more = (
        values[: count * size].reshape(count, size) for values in (one.columns[WHEEL], one.output - one.columns[WHEEL])
    )
    place = np.flatnonzero(np.isfinite(more).all(axis=1))
    wheel = wheel[place]
    columns = np.column_stack([np.ones(len(place)), wheel.mean(axis=1), wheel[:, -1] - wheel[:, 0]])
    return Compared(size, place, columns, more[place])


def two_speeds(recordings: Sequence[Recording]) -> TwoSpeeds | None:
    """Compare the two speeds where both were measured; None where they were not, hardly moved, or not for long."""
    rows, differences, blocks, begun = [], [], [], 0
    for one in recordings:
        both = compared(one, MEAN_S)
        if both is None:
            return None
        rows.append(both.columns)
        differences.append(both.more_mps.mean(axis=1))
        blocks.append(begun + (both.place * both.size * one.dt_s // BLOCK_S).astype(int))
        begun += math.ceil(len(one) * one.dt_s / BLOCK_S)
    x, difference, block = np.concatenate(rows), np.concatenate(differences), np.concatenate(blocks)
    if len(np.unique(block)) < FEWEST_BLOCKS or np.ptp(x[:, 1]) <= CONSTANT * np.abs(x[:, 1]).max():
        return None
    inverse = np.linalg.pinv(x.T @ x)
    found = inverse @ x.T @ difference
    pulls = x * (difference - x @ found)[:, None]
    summed = np.array([pulls[block == one].sum(axis=0) for one in np.unique(block)])
    std = np.sqrt(np.diag(inverse @ summed.T @ summed @ inverse))
    offset, share = (Estimate(float(found[i]), float(std[i])) for i in (0, 1))
    return TwoSpeeds(offset, share)
