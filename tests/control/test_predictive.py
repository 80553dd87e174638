"""The programme against a general solver, and its bounds."""

import numpy as np
import pytest
from scipy import optimize

from cruise.control.predictive import PredictiveSettings, solve
from cruise.model.model import DriveResponse

RESPONSE = DriveResponse((0.7,), (3e-4, 3e-4, 2e-4), 2, 0.0)
COUNT = 15
SETTINGS = PredictiveSettings()


def plan(reference, bounds=(0.0, 800.0), speed=1.0, settings=SETTINGS, last=375.0):
    free = RESPONSE.free((speed,), [last] * 5, 0.0, COUNT)
    return free, solve(free, RESPONSE.forced(COUNT), reference, speed, last, bounds, RESPONSE.dc_gain, 0.2, settings)


def test_it_is_the_optimum():
    reference = np.linspace(1.0, 1.2, COUNT)
    free, found = plan(reference)
    gain = RESPONSE.dc_gain

    def cost(wanted):
        moves = gain * np.diff(np.concatenate([[375.0], wanted]))
        error = free + RESPONSE.forced(COUNT) @ wanted - reference
        return error @ error + SETTINGS.move_weight * moves @ moves

    best = optimize.minimize(cost, np.full(COUNT, 375.0), method="L-BFGS-B", options={"maxiter": 5000, "ftol": 1e-15})
    assert found.wanted_ma == pytest.approx(best.x[0], rel=2e-3)


def test_at_rest_on_the_setpoint_it_stays():
    _, found = plan(np.ones(COUNT), last=1.0 / RESPONSE.dc_gain)
    assert found.wanted_ma == pytest.approx(1.0 / RESPONSE.dc_gain, rel=1e-6)
    np.testing.assert_allclose(found.speeds_mps, 1.0, rtol=1e-6)


def test_it_keeps_the_bounds_of_the_drive():
    _, found = plan(np.full(COUNT, 5.0), bounds=(0.0, 500.0), settings=PredictiveSettings(accel_max_mps2=100.0))
    assert found.wanted_ma == pytest.approx(500.0)


def test_it_keeps_the_predicted_acceleration():
    _, found = plan(np.full(COUNT, 4.0), bounds=(0.0, 5000.0), settings=PredictiveSettings(move_weight=1e-4))
    accel = np.diff(np.concatenate([[1.0], found.speeds_mps])) / 0.2
    assert accel.max() <= 1.0 + 0.02
    _, free_plan = plan(
        np.full(COUNT, 4.0),
        bounds=(0.0, 5000.0),
        settings=PredictiveSettings(move_weight=1e-4, accel_max_mps2=100.0),
    )
    assert (np.diff(free_plan.speeds_mps) / 0.2).max() > 2.0


def test_a_broken_acceleration_is_no_dead_end():
    _, found = plan(np.ones(COUNT), speed=3.0, bounds=(374.0, 376.0))
    assert found.solved
