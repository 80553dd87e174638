"""The NARX models of Table IV, their polynomials of the current as it was applied, before it is slowed and filtered.

    y_k = sum_i a_i y_(k-i) + sum_n sum_j b_(n,j) w_(n,k-d-j) + c_0 + e_k
    w_n = F(H_n(z)) ,    z = (u - centre) / scale
    theta = (A' A / N + gamma I)^-1 A' B / N

u current in mA at 20 Hz, H_n physicists' Hermite polynomial of degree n, F what slows a signal to the model's rate and
filters it, A the columns scaled to unit RMS, B the target in m/s, both without their mean; gamma per sample, chosen 3 s
ahead on the last quarter. Why before F: current that changes every 0.05 s is nearly Gaussian noise about its mean below
1 Hz, and a polynomial of it no longer knows of the dead zone that the current itself crossed. It is the order in which
the transformation B of Table III is applied. Section IV.D, equations 6 and 7 of Coen et al. 2005.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import hermite

from cruise.identification.families import why_unstable
from cruise.identification.narx import GAMMAS, HELD_OUT, LEAST_PIVOT
from cruise.identification.structures import Structure
from cruise.model.prediction import Driven, ahead_driven, lagged
from cruise.recording import Recording
from cruise.signals import INPUT

Ready = Callable[[Recording], Recording]
"""What slows a recording of 20 Hz to a model's rate and filters it."""


@dataclass(frozen=True)
class Hermite:
    """A NARX model of the paper; `structure` holds its orders, delay and degree."""

    structure: Structure
    period_s: float
    centre_ma: float
    scale_ma: float
    theta: tuple[float, ...] = ()  # a_1.., b of degree 1, of degree 2.., c_0
    gamma: float = math.nan

    @property
    def unstable(self) -> str:
        """Which poles make predictions run away; empty where none does."""
        return why_unstable(np.roots([1.0, *(-value for value in self.theta[: self.structure.na])]))

    def drives(self, recording: Recording, ready: Ready) -> tuple[np.ndarray, ...]:
        """The polynomials w_n (N,) of the current of a recording of 20 Hz."""
        scaled = (recording.input - self.centre_ma) / self.scale_ma
        polynomials = (hermite.hermval(scaled, [*(0.0,) * n, 1.0]) for n in range(1, self.structure.degree + 1))
        return tuple(ready(replace(recording, columns={**recording.columns, INPUT: one})).input for one in polynomials)

    def ahead(self, drives: tuple[np.ndarray, ...], speed_mps: np.ndarray, horizon: int) -> np.ndarray:
        """The speed (N,) in m/s at every sample as predicted `horizon` samples before."""
        na = self.structure.na
        forced = self._past(drives) @ np.array(self.theta[na:-1]) + self.theta[-1]
        with np.errstate(over="ignore", invalid="ignore"):
            return ahead_driven(Driven(self.theta[:na], forced), speed_mps, horizon)

    def columns(self, drives: tuple[np.ndarray, ...], speed_mps: np.ndarray) -> np.ndarray:
        """The columns (N, n) that theta weighs, but for the constant; NaN where the record doesn't reach back."""
        fed_back = [lagged(speed_mps, i + 1) for i in range(self.structure.na)]
        return np.column_stack([*fed_back, self._past(drives)])

    def _past(self, drives: tuple[np.ndarray, ...]) -> np.ndarray:
        delay = self.structure.delay(self.period_s)
        return np.column_stack([lagged(drive, delay + j) for drive in drives for j in range(self.structure.nb)])


def fit_hermite(structure: Structure, recording: Recording, ready: Ready, period_s: float, horizon: int) -> Hermite:
    """The model of `structure` fitted to a recording of 20 Hz; `ready` filters the speed as well."""
    centre_ma, scale_ma = float(recording.input.mean()), math.sqrt(2.0) * float(recording.input.std())
    empty = Hermite(structure, period_s, centre_ma, scale_ma)
    drives, speed = empty.drives(recording, ready), ready(recording).output
    columns, cut = empty.columns(drives, speed), round((1.0 - HELD_OUT) * len(speed))
    unseen = tuple(drive[cut:] for drive in drives)

    def power(gamma: float) -> float:
        candidate = _ridge(empty, columns[:cut], speed[:cut], gamma)
        if candidate.unstable:
            return math.inf
        return float(np.nanmean((candidate.ahead(unseen, speed[cut:], horizon) - speed[cut:]) ** 2))

    return _ridge(empty, columns, speed, min(GAMMAS[::-1], key=power))


def _ridge(empty: Hermite, columns: np.ndarray, speed_mps: np.ndarray, gamma: float) -> Hermite:
    """Equation 7, the constant not penalised."""
    usable = np.isfinite(columns).all(axis=1)
    columns, target = columns[usable], speed_mps[usable]
    about, mean_mps = columns.mean(axis=0), target.mean()
    scale = columns.std(axis=0)
    scaled = (columns - about) / scale
    values, vectors = np.linalg.eigh(scaled.T @ scaled / len(target))
    kept = np.maximum(values + gamma, LEAST_PIVOT * values[-1])
    inner = vectors @ (vectors.T @ (scaled.T @ (target - mean_mps)) / len(target) / kept) / scale
    return replace(empty, theta=(*inner.tolist(), float(mean_mps - about @ inner)), gamma=gamma)
