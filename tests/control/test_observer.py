"""The observer finds a constant disturbance, and the model it uses may change without a bump."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from cruise.control.observer import DisturbanceObserver, ObserverSettings

POLE, FRAME_S = 0.8, 0.05


def test_it_finds_a_step_of_the_disturbance_within_two_seconds():
    rng = np.random.default_rng(0)
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    speed = 1.0
    observer.reset(1.0)
    found = []
    for k in range(200):
        disturbance = -0.05 if k >= 100 else 0.0
        speed = POLE * speed + (1.0 - POLE) * (1.0 + disturbance)
        observer.step(POLE, 1.0, speed + 0.005 * rng.standard_normal())
        found.append(observer.disturbance_mps)
    assert abs(np.mean(found[60:100])) < 0.01
    assert np.mean(found[140:]) == pytest.approx(-0.05, abs=0.01)
    assert observer.speed_mps == pytest.approx(speed, abs=0.01)


def test_its_gain_is_that_of_the_riccati_equation():
    settings = ObserverSettings()
    pace = 0.5
    gain = np.array(DisturbanceObserver(FRAME_S, settings).gains(POLE, pace))
    moves = np.array([[POLE, 1.0 - POLE], [0.0, 1.0]])
    spread = FRAME_S * np.diag([settings.model_noise_mps, np.sqrt(pace) * settings.disturbance_mps]) ** 2
    noise = settings.speed_noise_mps**2
    expected = solve_discrete_are(moves.T, np.array([[1.0], [0.0]]), spread, [[noise]])
    np.testing.assert_allclose(gain, expected[:, 0] / (expected[0, 0] + noise), rtol=1e-4)


@pytest.mark.parametrize(("rate_mps2", "share"), [(0.0, 1.0), (0.4, 0.5), (-1.2, 0.1)])
def test_while_the_drive_changes_less_of_an_innovation_is_a_disturbance(rate_mps2, share):
    """Half of it at brisk_mps2, a tenth at three times that, whichever way; the speed is corrected all the same."""
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(1.0)
    steady = 1.0
    for _ in range(200):
        observer.step(POLE, steady, POLE * observer.speed_mps + (1.0 - POLE) * (steady + observer.disturbance_mps))
        steady += rate_mps2 * FRAME_S
    expected = POLE * observer.speed_mps + (1.0 - POLE) * steady
    observer.step(POLE, steady, expected + 0.01)
    speed_gain, disturbance_gain = observer.gains(POLE)
    assert observer.disturbance_mps == pytest.approx(share * disturbance_gain * 0.01, rel=0.12)
    assert observer.speed_mps == pytest.approx(expected + speed_gain * 0.01)


def test_a_shift_is_no_change_of_the_drive():
    observer, still = (DisturbanceObserver(FRAME_S, ObserverSettings()) for _ in range(2))
    for one in (observer, still):
        one.reset(1.0)
        one.step(POLE, 1.0, 1.0)
    observer.shift(-0.2)  # the model explains 0.2 m/s more
    observer.step(POLE, 1.2, 1.01)
    still.step(POLE, 1.0, 1.01)
    assert observer.disturbance_mps + 0.2 == pytest.approx(still.disturbance_mps)


def test_a_shift_moves_the_disturbance_only():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(1.5)
    observer.shift(0.03)
    assert observer.disturbance_mps == pytest.approx(0.03)
    assert observer.speed_mps == 1.5


def test_a_state_that_changed_by_itself_is_noticed_and_stays_so():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(1.5)
    observer.shift(0.1)
    observer.step(POLE, 1.4, 1.5)
    assert not observer.upset
    observer.disturbance_mps += 1e-9
    assert observer.upset
    observer.step(POLE, 1.4, 1.5)
    observer.shift(0.1)
    assert observer.upset
    observer.reset(1.5)
    assert not observer.upset
