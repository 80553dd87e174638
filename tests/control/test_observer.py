"""The observer finds a constant disturbance, and the model it uses may change without a bump."""

import numpy as np
import pytest

from cruise.control.observer import DisturbanceObserver, ObserverSettings
from cruise.model.model import DriveResponse

RESPONSE = DriveResponse((0.6, 0.1), (1e-3,), 2, 0.0)


def test_it_finds_a_step_of_the_disturbance_within_two_seconds():
    rng = np.random.default_rng(0)
    observer = DisturbanceObserver(2, 0.2, ObserverSettings())
    y, before = 1.0, 1.0
    observer.reset(1.0)
    found = []
    for k in range(60):
        disturbance = -0.05 if k >= 30 else 0.0
        y, before = 0.6 * y + 0.1 * before + 0.3 + disturbance, y
        observer.step(RESPONSE, 0.3, y + 0.005 * rng.standard_normal())
        found.append(observer.disturbance_mps)
    assert abs(np.mean(found[20:30])) < 0.01
    assert np.mean(found[40:]) == pytest.approx(-0.05, abs=0.01)
    assert observer.speeds_mps[0] == pytest.approx(y, abs=0.02)


def test_a_shift_moves_the_disturbance_only():
    observer = DisturbanceObserver(1, 0.2, ObserverSettings())
    observer.reset(1.5)
    observer.shift(0.03)
    assert observer.disturbance_mps == pytest.approx(0.03)
    assert observer.speeds_mps == (1.5,)
