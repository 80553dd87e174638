"""The observer finds how fast the drive is, from what comes while it moves, and keeps it apart from a disturbance."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cruise.control.observer import DisturbanceObserver, ObserverSettings
from tests.control.observing import FRAME_S, HIGH_PACE, HIGH_POLE, POLE


def driven(observer, pace_share, seconds=4.0, pole=HIGH_POLE, pace=HIGH_PACE):
    """What it sees, pace and disturbance, of a drive that is `pace_share` times as fast as its gear says.

    It is led up by 1 m/s within 2 s and kept there.
    """
    rng = np.random.default_rng(3)
    speed, seen = 3.0, []
    observer.reset(speed)
    for k in range(round(seconds / FRAME_S)):
        steady = 3.0 + min(k * FRAME_S / 2.0, 1.0)
        speed += pace_share * (1.0 - pole) * (steady - speed)
        observer.step(pole, steady, speed + 0.005 * rng.standard_normal(), pace)
        seen.append((math.exp(observer.log_pace), observer.disturbance_mps))
    return np.array(seen)


@pytest.mark.parametrize("pace_share", [0.6, 0.8, 1.3])
def test_it_finds_how_fast_the_drive_is_while_it_moves(pace_share):
    """A fifth of it within one change of the speed; less of it is taken for a disturbance."""
    seen = driven(DisturbanceObserver(FRAME_S, ObserverSettings()), pace_share)
    assert 0.2 < math.log(seen[50, 0]) / math.log(pace_share) < 1.0
    alone = driven(DisturbanceObserver(FRAME_S, ObserverSettings(pace_share=1e-9)), pace_share)
    assert abs(seen[:, 1]).max() < 0.9 * abs(alone[:, 1]).max()


def test_a_drive_that_is_as_fast_as_the_model_says_is_left_so():
    seen = driven(DisturbanceObserver(FRAME_S, ObserverSettings()), 1.0)
    assert abs(seen[:, 0] - 1.0).max() < 0.03


def test_a_pace_that_nothing_shows_goes_back_to_the_models():
    seen = driven(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.6, 60.0)
    assert seen[:100, 0].min() < 0.92
    assert seen[-1, 0] == pytest.approx(1.0, abs=0.02)


def test_where_the_gear_does_not_slow_the_drive_its_pace_is_the_models():
    seen = driven(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.6, pace=1.0)
    assert (seen[:, 0] == 1.0).all()


def test_no_drive_is_taken_for_slower_than_the_uncertainty_of_its_gear():
    """One that is led to and fro and does not follow at all."""
    observer, poles = DisturbanceObserver(FRAME_S, ObserverSettings()), []
    observer.reset(3.0)
    for k in range(1200):
        observer.step(HIGH_POLE, 3.0 + 2.0 * math.sin(k * FRAME_S), 3.0, HIGH_PACE)
        poles.append(observer.pole(HIGH_POLE))
    slowest = HIGH_PACE ** (2.0 * observer.settings.pace_share)
    assert max(poles) == pytest.approx(HIGH_POLE**slowest)


def test_what_shows_the_pace_is_the_derivative_of_the_state():
    """By two observers more, to which a drive a little faster and a little slower is known for good."""
    settings, small = ObserverSettings(pace_s=1e12), 1e-3
    observers = {by: DisturbanceObserver(FRAME_S, settings) for by in (0.0, small, -small)}
    for by, one in observers.items():
        one.reset(3.0)
        one.log_pace = by
        usual = one.filter(HIGH_POLE, HIGH_PACE)
        one.filter = lambda pole, pace=1.0, usual=usual: replace(usual, hill_gain=usual.gain)  # of given gain
    rng, speed = np.random.default_rng(1), 3.0
    for k in range(160):
        steady = 3.0 + np.clip((k - 40) / 40.0, 0.0, 1.0)
        speed += 0.7 * (1.0 - HIGH_POLE) * (steady - 0.1 - speed)
        shown = speed + 0.005 * rng.standard_normal()
        for one in observers.values():
            one.step(HIGH_POLE, steady, shown, HIGH_PACE)
    faster, slower = ([one.speed_mps, one.disturbance_mps, *one.ripple] for one in list(observers.values())[1:])
    expected = (np.array(faster) - slower) / (2.0 * small)
    assert abs(expected).min() > 1e-4
    np.testing.assert_allclose(observers[0.0].moved, expected, rtol=0.01, atol=1e-5)


def test_what_comes_while_the_drive_rests_is_a_disturbance_and_no_pace():
    """However large it is: pace and disturbance explain the same of a speed that comes slowly."""
    observer, speed = DisturbanceObserver(FRAME_S, ObserverSettings()), 3.0
    observer.reset(speed)
    for _ in range(1200):
        speed += (1.0 - HIGH_POLE) * (2.0 - speed)
        observer.step(HIGH_POLE, 3.0, speed, HIGH_PACE)
        assert observer.log_pace == 0.0
    assert observer.disturbance_mps == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("gain", [0.5, 0.7, 1.4, 2.0])
def test_a_drive_that_gives_more_or_less_than_the_model_says_does_not_wind_up(gain):
    """Pace and disturbance, while the drive goes to and fro for a minute: they end where they were found at rest."""
    observer, speed = DisturbanceObserver(FRAME_S, ObserverSettings(speed_noise_mps=0.001)), 3.0 * gain
    observer.reset(speed)
    for k in range(3600):
        steady = 3.0 + (1.0 * math.sin(k * FRAME_S) if k < 1200 else 0.0)
        speed += (1.0 - HIGH_POLE) * (gain * steady - speed)
        observer.step(HIGH_POLE, steady, speed, HIGH_PACE)
        assert abs(observer.disturbance_mps) < 2.0 * 3.0 * abs(gain - 1.0)
    assert observer.disturbance_mps == pytest.approx(3.0 * (gain - 1.0), abs=0.02)
    assert observer.log_pace == pytest.approx(0.0, abs=0.01)


def test_a_drive_that_yields_more_is_slower_by_so_many_time_constants():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    for yielding in (0.4, 1.0, 2.0):
        assert math.log(observer.pole(POLE, yielding)) == pytest.approx(math.log(POLE) / yielding)
    observer.log_pace = math.log(1.2)
    assert math.log(observer.pole(POLE, 2.0)) == pytest.approx(math.log(POLE) * 1.2 / 2.0)


def test_a_drive_that_yields_more_is_followed_without_a_disturbance():
    """A step of a drive that yields half as much again, exactly as slow as that makes it: nothing is left."""
    observer, steady, speed = DisturbanceObserver(FRAME_S, ObserverSettings()), 3.0, 3.0
    observer.reset(speed)
    for k in range(200):
        steady = 3.5 if k > 20 else 3.0
        speed += (1.0 - HIGH_POLE ** (1.0 / 1.5)) * (steady - speed)
        observer.step(HIGH_POLE, steady, speed, HIGH_PACE, yielding=1.5)
        assert abs(observer.innovation_mps) < 1e-9
    assert observer.log_pace == pytest.approx(0.0, abs=1e-9)
    assert observer.disturbance_mps == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("log_pace", "deviations", "quicker"), [(0.3, 1.0, 0.4), (-0.3, 1.0, 0.4), (-1.0, 1.0, 1.0), (-1.0, 3.0, 1.2)]
)
def test_what_is_believed_slow_may_always_be_as_quick_as_its_gear(log_pace, deviations, quicker):
    observer = DisturbanceObserver(0.05, ObserverSettings())
    observer.log_pace, observer.log_pace_variance = log_pace, 0.4**2
    assert math.log(observer.quicker(deviations)) == pytest.approx(quicker)
