"""The observer finds a constant disturbance, and the model it uses may change without a bump."""

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, expm, solve_discrete_are

from cruise.control.observer import CHANCE_STD, MOST_FILTERS, DisturbanceObserver, ObserverSettings

POLE, FRAME_S = 0.8, 0.05
HIGH_POLE, HIGH_PACE = 0.97, 0.15  # fourth gear


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


@pytest.mark.parametrize(("name", "exponent"), [("gain", 0.5), ("hill_gain", -0.5)])
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


def test_a_hill_in_a_fast_gear_is_followed_as_quickly_as_it_comes_and_little_as_slowly_as_before():
    little, much = (behind_a_hill(rate_mps2, 0.118) for rate_mps2 in (0.01, 0.4))
    assert little > 2.5
    assert much < 1.4
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
    assert seen[:100, 0].min() < 0.9
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
    assert max(poles) == pytest.approx(1.0 - (1.0 - HIGH_POLE) * HIGH_PACE**0.5)


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


BAND_MPS, TURN_S = 0.1, 6.0  # what the model's width is in steady speed; time from one turn to the next


def turned(observer, true_share, seconds=300.0, hill=None, rate_mps2=0.0, seed=5):
    """The share that it believes of a width (N,), of a drive whose current turns to and fro.

    The machine's width is `true_share` of the model's. `hill(time)` is what else moves it, in m/s.
    """
    rng, speed, shares = np.random.default_rng(seed), 1.0, []
    observer.reset(speed)
    for k in range(round(seconds / FRAME_S)):
        at = k * FRAME_S
        width_mps = BAND_MPS / 2.0 * (-1.0 if at // TURN_S % 2 else 1.0)
        moved = 1.0 + rate_mps2 * (at % TURN_S)
        load = hill(at) if hill else 0.0
        speed += (1.0 - POLE) * (moved + true_share * width_mps + load - speed)
        shown = speed + 0.005 * rng.standard_normal()
        observer.step(POLE, moved + observer.width_share * width_mps, shown, 1.0, width_mps)
        shares.append(observer.width_share)
    return np.array(shares)


@pytest.mark.parametrize("true_share", [0.0, 0.5, 0.8, 1.0])
def test_it_finds_the_width_from_what_the_turns_leave(true_share):
    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), true_share)
    assert shares[-1] == pytest.approx(true_share, abs=0.15)
    assert abs(shares[round(5.0 * TURN_S / FRAME_S)] - 1.0) >= 0.4 * abs(true_share - 1.0), "within four turns"


@pytest.mark.parametrize("true_share", [-1.0, 1.3, 3.0])
def test_no_width_is_taken_for_wider_than_the_models_or_for_less_than_none(true_share):
    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), true_share)
    assert shares.max() <= 1.0
    assert shares.min() >= 0.0
    assert shares[-1] == pytest.approx(min(max(true_share, 0.0), 1.0), abs=0.02)


def test_where_the_current_does_not_turn_nothing_is_learned_of_the_width():
    observer, speed = DisturbanceObserver(FRAME_S, ObserverSettings()), 1.0
    observer.reset(speed)
    for k in range(1200):
        speed += (1.0 - POLE) * (1.0 + 0.2 * math.sin(0.5 * k * FRAME_S) - speed)
        observer.step(POLE, 1.0, speed, 1.0, 0.0)
        assert observer.width_share == 1.0


def test_a_hill_that_makes_the_current_turn_is_not_its_width():
    """It comes in the 6 s about the turn: of what is learned by it, what has lasted would be as much again."""

    def hill(at):
        towards = 1.0 if math.floor(at / TURN_S + 0.5) % 2 else -1.0
        return 0.05 * towards * min((at / TURN_S + 0.5) % 1.0 * TURN_S - 3.0, 3.0)

    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.7, hill=hill)
    assert shares[-200:].mean() == pytest.approx(0.7, abs=0.3)


def test_what_comes_while_the_drive_moves_tells_less_of_the_width():
    slow, fast = (
        turned(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.5, TURN_S * 4.0, rate_mps2=rate)
        for rate in (0.0, 1.0)
    )
    assert abs(fast[-1] - 1.0) < 0.5 * abs(slow[-1] - 1.0)


def test_a_width_is_kept_when_it_begins_anew_and_slowly_forgotten():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings(width_s=100.0))
    turned(observer, 0.5)
    found, known = observer.width_share, observer.width_variance
    observer.reset(2.0)
    assert observer.width_share == found
    assert not observer.upset
    for _ in range(2000):
        observer.step(POLE, 2.0, 2.0)
    assert 1.0 - observer.width_share == pytest.approx((1.0 - found) / math.e, rel=1e-6)
    assert known < observer.width_variance < 0.25


def test_what_shows_the_width_is_the_derivative_of_the_state():
    """By two observers more, to which a width a little more and a little less is known for good."""
    settings, small, rng = ObserverSettings(width_share=1e-9, brisk_mps2=1e9), 1e-3, np.random.default_rng(1)
    observers, speed = {by: DisturbanceObserver(FRAME_S, settings) for by in (0.0, small, -small)}, 1.0
    for one in observers.values():
        one.reset(speed)
    for k in range(66):
        width_mps = 0.05 if k < 60 else -0.05
        speed += (1.0 - POLE) * (1.0 + 0.6 * width_mps - speed)
        shown = speed + 0.005 * rng.standard_normal()
        for by, one in observers.items():
            one.step(POLE, 1.0 + (0.9 + by) * width_mps, shown, 1.0, width_mps)
    more, less = ([one.speed_mps, one.disturbance_mps, *one.ripple] for one in list(observers.values())[1:])
    np.testing.assert_allclose(observers[0.0].turned, (np.array(more) - less) / (2.0 * small), rtol=0.02, atol=5e-5)


def test_the_state_moves_along_with_the_width():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    turned(observer, 1.0, TURN_S + 0.3)
    certain = deepcopy(observer)
    certain.width_variance = 0.0
    for one in (observer, certain):
        one.step(POLE, 1.0, 1.1, 1.0, -BAND_MPS / 2.0)
    more = observer.width_share - certain.width_share
    assert abs(more) > 0.01
    found, expected = (np.array([one.speed_mps, one.disturbance_mps, *one.ripple]) for one in (observer, certain))
    np.testing.assert_allclose(found, expected + more * observer.turned)


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
        observer.step(0.9 + 1e-4 * k, 1.0, 1.0)
    assert len(observer._filters) == MOST_FILTERS
    assert (0.9 + 1e-4 * (5 * MOST_FILTERS - 1), 1.0) in observer._filters, "the oldest go first"


def test_a_slowed_drive_is_slower_with_more_stroke():
    """i^2 (a + b stroke), half and half: as learned at that stroke, a half slower at twice of it."""
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    assert observer.pole(HIGH_POLE, HIGH_PACE, 1.0) == pytest.approx(HIGH_POLE)
    assert 1.0 - observer.pole(HIGH_POLE, HIGH_PACE, 2.0) == pytest.approx((1.0 - HIGH_POLE) / 1.5)
    assert 1.0 - observer.pole(HIGH_POLE, HIGH_PACE, 0.0) == pytest.approx(2.0 * (1.0 - HIGH_POLE))
    assert observer.pole(POLE, 1.0, 2.0) == pytest.approx(POLE), "where it was learned nothing is added"
    leaks = DisturbanceObserver(FRAME_S, ObserverSettings(stroke_share=0.0))
    assert leaks.pole(HIGH_POLE, HIGH_PACE, 2.0) == pytest.approx(HIGH_POLE)


def test_a_drive_of_more_stroke_is_followed_without_a_disturbance():
    """A step of a drive with twice the stroke, exactly as slow as that makes it: nothing is left to explain."""
    observer, steady, speed = DisturbanceObserver(FRAME_S, ObserverSettings()), 3.0, 3.0
    observer.reset(speed)
    for k in range(200):
        steady = 3.5 if k > 20 else 3.0
        speed += (1.0 - HIGH_POLE) / 1.5 * (steady - speed)
        observer.step(HIGH_POLE, steady, speed, HIGH_PACE, stroke=2.0)
        assert abs(observer.innovation_mps) < 1e-9
    assert observer.log_pace == pytest.approx(0.0, abs=1e-9)
    assert observer.disturbance_mps == pytest.approx(0.0, abs=1e-9)
