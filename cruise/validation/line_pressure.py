"""What a bar of line pressure means on this machine: the force that it is, and the load of the engine that it makes.

    dp = p_0 + F / kappa,   F = m (g_n sin(slope) + dv/dt)          load = l_0 + k (dp v - p_1 |v|)

dp line pressure in bar, p_0 and p_1 in bar while nothing holds the machine, F force in kN, kappa in kN per bar, m mass
in kg (15 000 kg where not measured), k in % per bar m/s, v speed in m/s. By regression of what shows more upon what
causes a part of it: forces that nobody recorded are in the pressure, crop is in the load. Left to a fit of the speed,
the pressure would explain anything. Source: power of a hydrostat, pressure times flow, any textbook; D. Cochrane, G. H.
Orcutt, J. American Statistical Association 44 (1949) 32-61, of a regression with a rest that wanders.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cruise.effects.effect import EMPTY_KG
from cruise.recording import Recording
from cruise.validation.slope import PITCH, accel_and_pull, pitch_share

PRESSURE: Final = "line_pressure_bar"
LOAD: Final = "engine_load_pct"
MASS: Final = "machine_mass_kg"
MEAN_S: Final = 2.0  # s: an engine's load follows its cause by less
FEWEST: Final = 20  # means, below which nothing is said
ROUNDS: Final = 4  # of the regression: with each, what wanders is known better
TINY: Final = 1e-12
LEAST_SHOWN: Final = 0.03  # R^2 below which the pressure shows no force, and the load no pressure


class Force(NamedTuple):
    """Force in kN per bar, and bar while the ground is level and nothing accelerates."""

    kn_per_bar: float
    rest_bar: float


class Traction(NamedTuple):
    """Load of the engine in % per bar and m/s, and bar at which the drive makes none."""

    traction_pct_per_bar_mps: float
    rest_bar: float


def force_of_a_bar(recordings: Sequence[Recording]) -> Force | None:
    """kappa and p_0; None where pressure or pitch are not recorded, or the one shows next to nothing of the other."""
    if not _recorded(recordings, PRESSURE, PITCH):
        return None
    share, forces = pitch_share(recordings), []
    for one in recordings:
        accel, pull = accel_and_pull(one)
        mass_kg = one.columns.get(MASS, np.full(len(accel), EMPTY_KG))
        forces.append(1e-3 * mass_kg * (pull + (1.0 - share) * accel))
    found = _regression(recordings[0].dt_s, _joined(recordings, PRESSURE), np.concatenate(forces))
    return None if found is None or found[1] <= 0.0 else Force(1.0 / found[1], found[0])


def load_of_a_bar(recordings: Sequence[Recording]) -> Traction | None:
    """k and p_1; None where pressure or load are not recorded, or the load shows next to nothing of the drive."""
    if not _recorded(recordings, PRESSURE, LOAD):
        return None
    speed = np.concatenate([one.output for one in recordings])
    powers = np.abs(speed), _joined(recordings, PRESSURE) * speed
    found = _regression(recordings[0].dt_s, _joined(recordings, LOAD), *powers)
    return None if found is None or found[2] <= 0.0 else Traction(found[2], -found[1] / found[2])


def _recorded(recordings: Sequence[Recording], *names: str) -> bool:
    return all(name in one.columns for one in recordings for name in names)


def _joined(recordings: Sequence[Recording], name: str) -> np.ndarray:
    return np.concatenate([one.columns[name] for one in recordings])


def _regression(dt_s: float, shown: np.ndarray, *causes: np.ndarray) -> list[float] | None:
    """Offset and slopes of what is shown upon its causes; None where they tell next to nothing of it.

    Over means of 2 s, less the share of the mean before that soil and crop, which wander slowly, have in common.
    """
    each = max(round(MEAN_S / dt_s), 1)
    rows = np.array([shown, np.ones(len(shown)), *causes])
    means = rows[:, : rows.shape[1] // each * each].reshape(len(rows), -1, each).mean(axis=2)
    pairs = np.isfinite(means[:, 1:]).all(axis=0) & np.isfinite(means[:, :-1]).all(axis=0)
    now, before = means[:, 1:][:, pairs], means[:, :-1][:, pairs]
    if now.shape[1] < FEWEST or np.ptp(now[0]) == 0.0:
        return None
    share, left, found = 0.0, 1.0, np.zeros(len(now) - 1)
    for _ in range(ROUNDS):
        seen, *columns = now - share * before
        found = np.linalg.lstsq(np.array(columns).T, seen, rcond=None)[0]
        rest, rest_before = (side[0] - found @ side[1:] for side in (now, before))
        left = float(np.var(rest - share * rest_before)) / max(float(np.var(seen)), TINY)
        share = float(rest @ rest_before) / max(float(rest_before @ rest_before), TINY)
    return found.tolist() if 1.0 - left >= LEAST_SHOWN else None
