"""The observer finds a constant disturbance, and the model it uses may change without a bump."""

import math

import numpy as np
import pytest
from scipy.linalg import block_diag, expm, solve_discrete_are

from cruise.control.observer import (
    CHANCE_STD,
    FILTER_STEPS,
    MOST_FILTERS,
    DisturbanceObserver,
    ObserverSettings,
    rounded,
)
from tests.control.observing import FRAME_S, HIGH_PACE, HIGH_POLE, POLE


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


def noises(settings, pace, exponent=0.5):
    """Transition and covariance of the noise of all four states, written out; the ripple's from how it is sampled."""
    omega, damping = 2.0 * math.pi * settings.ripple_hz, settings.ripple_damping
    swing = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])
    moves = block_diag([[POLE, 1.0 - POLE], [0.0, 1.0]], expm(FRAME_S * swing))
    fine = FRAME_S / 1000
    flow, power = expm(fine * swing), 4.0 * damping * omega * settings.ripple_mps**2
    ripple, kept = np.zeros((2, 2)), np.eye(2)
    for _ in range(1000):
        ripple += kept @ np.diag([0.0, power * fine]) @ kept.T
        kept = kept @ flow
    speed, disturbance = settings.model_noise_mps, pace**exponent * settings.disturbance_mps
    return moves, block_diag(FRAME_S * np.diag([speed, disturbance]) ** 2, ripple)


@pytest.mark.parametrize(("name", "exponent"), [("gain", 0.5), ("hill_gain", 0.0)])
def test_its_gains_are_those_of_the_riccati_equation(name, exponent):
    settings = ObserverSettings()
    pace = 0.5
    gain = getattr(DisturbanceObserver(FRAME_S, settings).filter(POLE, pace), name)
    moves, spread = noises(settings, pace, exponent)
    noise = settings.speed_noise_mps**2
    expected = solve_discrete_are(moves.T, np.array([[1.0], [0.0], [0.0], [1.0]]), spread, [[noise]])
    column = expected[:, 0] + expected[:, 3]
    np.testing.assert_allclose(gain, column / (column[0] + column[3] + noise), rtol=0.01, atol=1e-4)


def behind_a_hill(rate_mps2, pace):
    """How far the disturbance is behind, in s, after 4 s of a hill that moves the steady speed at this rate."""
    observer, pole = DisturbanceObserver(FRAME_S, ObserverSettings()), 1.0 - pace * (1.0 - POLE)
    speed = 3.0
    observer.reset(speed)
    for k in range(80):
        speed += (1.0 - pole) * (3.0 - rate_mps2 * FRAME_S * k - speed)
        observer.step(pole, 3.0, speed, pace)
    return 4.0 + observer.disturbance_mps / rate_mps2


def test_in_a_fast_gear_a_hill_is_followed_sooner_than_a_little_of_a_slope():
    little, much = (behind_a_hill(rate_mps2, 0.118) for rate_mps2 in (0.01, 0.4))
    assert little > 3.0
    assert much < 2.6
    assert behind_a_hill(0.4, 1.0) == pytest.approx(behind_a_hill(0.01, 1.0)), "a slow gear has one gain"


def test_what_lasts_of_the_innovations_is_a_hill_as_far_as_it_is_more_than_chance():
    rng = np.random.default_rng(3)
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(3.0)
    found, shares = observer.filter(HIGH_POLE, HIGH_PACE), []
    for k in range(400):
        before = observer.disturbance_mps
        lasting = 0.05 if k >= 200 else 0.0
        expected = observer.speed_mps + (1.0 - HIGH_POLE) * (3.0 + before - observer.speed_mps)
        shown = expected + float((found.moves[2:, 2:] @ observer.ripple)[1]) + lasting + 0.01 * rng.standard_normal()
        innovation = observer.step(HIGH_POLE, 3.0, shown, HIGH_PACE)
        rises = (observer.disturbance_mps - before) / (observer.calm * innovation)
        shares.append((rises - found.gain[1]) / (found.hill_gain[1] - found.gain[1]))
        if k == 399:
            share = -math.expm1(-FRAME_S / 0.5)
            chance = CHANCE_STD**2 * found.variance * share / (2.0 - share)
            assert shares[-1] == pytest.approx(1.0 - chance / observer.hill_mps**2)
    assert np.median(shares[50:200]) == pytest.approx(0.0, abs=1e-6)
    assert np.mean(shares[300:]) > 0.9


@pytest.mark.parametrize(("hz", "least", "most"), [(0.2, 0.9, 1.1), (1.5, 0.0, 0.3), (5.0, 0.0, 0.4)])
def test_a_ripple_is_no_speed(hz, least, most):
    """How much of a ripple of 3 cm/s comes through to the speed that the law sees, over its frequency."""
    observer, seen = DisturbanceObserver(FRAME_S, ObserverSettings()), []
    observer.reset(1.0)
    at = 2.0 * math.pi * hz * FRAME_S * np.arange(2000)
    for value in 0.03 * np.sin(at):
        observer.step(POLE, 1.0, 1.0 + value)
        seen.append(observer.speed_mps - 1.0)
    through = 2.0 * abs(np.mean(np.array(seen)[1000:] * np.exp(-1j * at[1000:]))) / 0.03
    assert least <= through <= most


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
    speed_gain, disturbance_gain, *_ = observer.filter(POLE).gain
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
    observer.log_pace = 1e-9
    assert observer.upset
    observer.reset(1.5)
    observer.width_share -= 1e-9
    assert observer.upset


def test_what_was_not_expected_is_seen_when_it_comes_and_not_again():
    """A jump of the speed, and a drive that gathers way without reason: innovations go on, as the filter is slow."""
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(3.0)
    seen = []
    for shown in (3.0, 3.3, 3.3, 3.3, 3.3):
        observer.step(HIGH_POLE, 3.0, shown, HIGH_PACE)
        seen.append((observer.unexpected_mps, observer.innovation_mps))
    assert seen[0] == (0.0, 0.0)
    assert seen[1] == pytest.approx((0.3, 0.3))
    assert abs(np.array(seen)[2:, 0]).max() < 0.02
    observer.reset(3.0)
    gathered = []
    for k in range(12):
        observer.step(HIGH_POLE, 3.0, 3.0 + 0.05 * k, HIGH_PACE)  # 1 m/s2
        gathered.append((observer.unexpected_mps, observer.innovation_mps))
    unexpected, innovations = np.array(gathered[-4:]).sum(axis=0)
    assert unexpected == pytest.approx(0.2, abs=0.06), "within 0.2 s"
    assert innovations > 0.3


def test_models_that_drove_before_leave_no_memory_behind():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    observer.reset(1.0)
    for k in range(5 * MOST_FILTERS):
        observer.step(0.1 + 0.01 * k, 1.0, 1.0)
    assert len(observer._filters) == MOST_FILTERS
    assert rounded(0.1 + 0.01 * (5 * MOST_FILTERS - 1), 1.0) in observer._filters, "the oldest go first"


def test_a_pole_that_drifts_asks_for_few_filters(monkeypatch):
    observer, solved = DisturbanceObserver(FRAME_S, ObserverSettings()), []
    observer.reset(1.0)
    solve = observer.filter
    monkeypatch.setattr(observer, "filter", lambda pole, pace: solved.append((pole, pace)) or solve(pole, pace))
    for k in range(400):
        pace = math.exp(-1e-3 * k)  # warm oil, by a third
        observer.step(1.0 - pace * (1.0 - POLE), 1.0, 1.0, pace)
    assert len(solved) <= 2 * 0.4 * FILTER_STEPS + 2
    for pole, pace in solved:
        assert abs(math.log((1.0 - pole) / (pace * (1.0 - POLE)))) <= 1.0 / FILTER_STEPS
