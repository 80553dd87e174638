"""A known truth: an ARX drive with effects, simulated by hand, independent of the model's code."""

from dataclasses import dataclass

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model
from cruise.signals import Sample

EFFECTS = (DeadZone(380.0), QuadraticGain(0.6), EngineSpeed(1.0), GearRatio(1.4, 2.5, 4.4, 7.8))
TRUE = (0.75, 3e-4, 2.5e-4, 1e-4, -0.03)


@dataclass(frozen=True)
class Machine:
    """y_k = a y_(k-1) + n/2100 sum_j b_j v_(k-2-j) + c, v = x (1 + 0.6 x / 1000), x = max(u - 380, 0); second gear."""

    theta: tuple[float, ...] = TRUE
    noise_mps: float = 0.01

    def drive(
        self,
        current_ma,
        seed,
        start=0,
        disturbance_mps: float | np.ndarray = 0.0,
        engaged=False,
        reference_mps=None,
        later=None,
        at=0,
    ):
        rng = np.random.default_rng(seed)
        beyond = np.maximum(current_ma - 380.0, 0.0)
        v = beyond * (1 + 0.6 * beyond / 1000.0)
        rpm = 2000.0 + 60.0 * np.sin(np.arange(len(v)) / 30.0)
        disturbance = np.broadcast_to(disturbance_mps, len(v))
        y = np.zeros(len(v))
        a, b0, b1, b2, c = self.theta
        y[:5] = (b0 + b1 + b2) * v[0] / (1 - a)
        for k in range(5, len(v)):
            a, b0, b1, b2, c = later.theta if later and k >= at else self.theta
            y[k] = a * y[k - 1] + rpm[k] / 2100 * (b0 * v[k - 2] + b1 * v[k - 3] + b2 * v[k - 4]) + c + disturbance[k]
        shown = y + self.noise_mps * rng.standard_normal(len(y))
        reference = y if reference_mps is None else reference_mps
        return [
            Sample(
                0.2 * (start + k + 1),
                float(current_ma[k]),
                float(shown[k]),
                {"engine_speed_rpm": float(rpm[k]), "gear": 2.0},
                reference_mps=float(reference[k]),
                engaged=engaged,
            )
            for k in range(len(v))
        ]


def steps(seconds, seed, low=500.0, high=1000.0, hold=10):
    """Random steps of current, one sample every 0.2 s."""
    count = round(seconds / 0.2)
    levels = np.random.default_rng(seed).uniform(low, high, count // hold + 1)
    return np.repeat(levels, hold)[:count]


def columns(samples):
    """The samples as arrays: currents, speeds, signals."""
    names = samples[0].signals
    return (
        np.array([sample.current_ma for sample in samples]),
        np.array([sample.speed_mps for sample in samples]),
        {name: np.array([sample.signals[name] for sample in samples]) for name in names},
    )


@pytest.fixture
def factory():
    std = (0.15, 2e-4, 2e-4, 2e-4, 0.1)
    return Model(0.2, 1, 3, 2, EFFECTS, (0.65, 3.5e-4, 3.5e-4, 3.5e-4, 0.0), std, 0.02)


@pytest.fixture
def machine():
    return Machine()
