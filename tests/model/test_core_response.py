"""The core's response is that of its differential equations: sum, mean delay, steady start, every sample of a step."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from cruise.model.core import TAIL, Core, discretised
from cruise.model.prediction import free_run

PLAIN = Core(2.5e-3, 0.3, 0.15, 0.6)
TWO_LAGS = replace(PLAIN, delay_s=0.33, second_lag_s=0.08)
RINGING = replace(TWO_LAGS, resonance_share=0.5, resonance_hz=0.8, damping=0.2)
CORES = {"plain": PLAIN, "no delay": replace(PLAIN, delay_s=0.0), "two lags": TWO_LAGS, "ringing": RINGING}
EACH = pytest.mark.parametrize("core", CORES.values(), ids=CORES)
PERIODS_S = (0.02, 0.1, 0.2)

lags = st.builds(
    Core,
    gain_mps_per_ma=st.just(1.0),
    delay_s=st.floats(0.0, 2.0),
    lag_s=st.floats(0.02, 2.0),
    time_constant_s=st.just(1.0),
    second_lag_s=st.one_of(st.just(0.0), st.floats(0.005, 2.0)),
)


def steps_ma(count: int, seed: int = 1) -> np.ndarray:
    """Random levels of ten samples each."""
    return np.repeat(np.random.default_rng(seed).uniform(200.0, 900.0, count // 10 + 1), 10)[:count]


@EACH
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_the_response_sums_to_one(core, period_s):
    assert core.response(period_s, round(40.0 / period_s)).sum() == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=40)
@given(core=lags, period_s=st.sampled_from(PERIODS_S))
def test_its_mean_delay_is_the_dead_time_and_those_of_the_lags(core, period_s):
    """At any period: a model that is learned at one and driven with at another comes no sooner."""
    response = core.response(period_s, round(45.0 / period_s))
    found_s = period_s * float(np.arange(len(response)) @ response)
    assert found_s == pytest.approx(core.delay_s + core.lag_s + core.second_lag_s, abs=1e-5)


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("name", ["servo", "resonance"])
def test_a_pair_comes_as_late_as_its_differential_equation(name, period_s):
    """By 2 zeta / omega, in whichever place it stands."""
    pairs = {
        "servo": Core(1.0, 0.3, 0.0, 1.0, servo_hz=0.9, servo_damping=0.7),
        "resonance": Core(1.0, 0.3, 0.0, 1.0, resonance_share=1.0, resonance_hz=0.9, damping=0.7),
    }
    response = pairs[name].response(period_s, round(20.0 / period_s))
    found_s = period_s * float(np.arange(len(response)) @ response)
    assert found_s == pytest.approx(0.3 + 2.0 * 0.7 / (2.0 * math.pi * 0.9), abs=1e-5)


@settings(max_examples=40)
@given(core=lags, period_s=st.sampled_from(PERIODS_S))
def test_the_taps_leave_out_no_more_than_the_tail(core, period_s):
    delay, taps = core.taps(period_s)
    response = core.response(period_s, delay + len(taps))
    assert delay * period_s <= core.delay_s + 1e-9
    assert np.all(response[:delay] == 0.0)
    assert 1.0 - TAIL <= response.sum() <= 1.0 + 1e-9
    assert taps.sum() == pytest.approx(1.0, abs=1e-12)
    assert taps * response.sum() == pytest.approx(response[delay:], abs=1e-12)


@EACH
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_what_is_felt_is_the_convolution_with_the_response(core, period_s):
    u = steps_ma(400)
    response = core.response(period_s, len(u))
    by_hand = u[0] + np.convolve(u - u[0], response)[: len(u)]
    assert core.felt(u, period_s) == pytest.approx(by_hand, abs=1e-9)


@EACH
def test_before_the_first_sample_the_drive_was_steady(core):
    assert core.felt(np.full(50, 640.0), 0.1) == pytest.approx(np.full(50, 640.0), abs=1e-9)
    u = np.concatenate([np.full(3, 640.0), np.full(80, 900.0)])
    late = core.felt(u, 0.1)
    silent = 3 + int(core.delay_s / 0.1)
    assert late[:silent] == pytest.approx(np.full(silent, 640.0), abs=1e-9)
    assert late[-1] == pytest.approx(900.0, abs=0.02 if core.resonance_share == 0.0 else 20.0)


def test_a_lag_is_exact_in_the_means_of_samples():
    core = replace(PLAIN, delay_s=0.4)
    ends_s = 0.1 * np.arange(30)
    u = np.concatenate([np.zeros(5), np.ones(40)])
    step = core.felt(u, 0.1)[5 + 4 :]
    filled_s = ends_s + 0.15 * np.exp(-ends_s / 0.15)  # the integral of 1 - exp(-t / tau), but for a constant
    assert step[: len(ends_s) - 1] == pytest.approx(np.diff(filled_s) / 0.1, abs=1e-12)


def test_a_delay_between_samples_is_shared_by_both():
    core = Core(1.0, 0.23, 0.0, 1.0)
    assert core.response(0.1, 5) == pytest.approx([0.0, 0.0, 0.7, 0.3, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("delay_s", "period_s", "samples"), [(0.6, 0.2, 3), (0.3, 0.1, 3), (0.7, 0.1, 7), (0.15, 0.05, 3), (0.35, 0.05, 7)]
)
def test_a_delay_of_whole_samples_is_one_whatever_rounding_makes_of_it(delay_s, period_s, samples):
    delay, share = Core(1.0, delay_s, 0.0, 1.0).taps(period_s)
    assert delay == samples
    assert share[0] > 0.5
    assert Core(1.0, delay_s, 0.0, 1.0).response(period_s, samples + 1) == pytest.approx([0.0] * samples + [1.0])


def continuous(core: Core, u: np.ndarray, period_s: float, per_sample: int) -> np.ndarray:
    """Speed (N,) at the ends of samples by scipy's lsim of delay, lags, resonance and vehicle, u held over each."""
    step_s = period_s / per_sample
    fine = np.repeat(u - u[0], per_sample)
    late = np.concatenate([np.zeros(round(core.delay_s / step_s)), fine])[: len(fine)]
    denominator = np.polymul([core.lag_s, 1.0], [core.time_constant_s, 1.0])
    if core.second_lag_s:
        denominator = np.polymul(denominator, [core.second_lag_s, 1.0])
    omega = 2.0 * math.pi * core.resonance_hz
    pair = np.array([1.0, 2.0 * core.damping * omega, omega**2])
    series = np.array([1.0 - core.resonance_share, 2.0 * (1.0 - core.resonance_share) * core.damping * omega, omega**2])
    system = signal.lti(core.gain_mps_per_ma * series, np.polymul(denominator, pair))
    times = step_s * np.arange(len(fine) + 1)
    _, y, _ = signal.lsim(system, np.append(late, late[-1]), times, interp=False)
    return core.gain_mps_per_ma * u[0] + np.asarray(y)[per_sample::per_sample]


def discrete_error(core: Core, period_s: float) -> float:
    """Greatest difference of the discrete speed from the continuous one, as a share of what the speed does."""
    held_s = 1.0
    levels = np.random.default_rng(4).uniform(200.0, 900.0, 30)
    u = np.repeat(levels, round(held_s / period_s))
    true = continuous(core, u, period_s, round(period_s / 0.002))
    a = core.pole(period_s)
    drive = (1.0 - a) * core.gain_mps_per_ma * core.felt(u, period_s)
    speed, _ = signal.lfilter([1.0], [1.0, -a], drive, zi=[a * core.gain_mps_per_ma * u[0]])
    return float(np.max(np.abs(speed - true)) / np.ptp(true))


@pytest.mark.parametrize(
    ("core", "most"), [(PLAIN, 0.003), (TWO_LAGS, 0.015), (RINGING, 0.014)], ids=["plain", "two lags", "ringing"]
)
def test_it_is_the_continuous_machine_with_an_error_of_the_order_of_the_period_squared(core, most):
    """Bounds are for 0.1 s: what is left is that a lag sees the one before it as held over each sample."""
    coarse, fine = discrete_error(core, 0.1), discrete_error(core, 0.02)
    assert coarse < most
    assert fine < 0.06 * coarse


@pytest.mark.parametrize("period_s", [0.02, 0.1, 0.2])
def test_the_resonance_is_the_means_of_what_its_pair_of_poles_makes_of_a_held_drive(period_s):
    omega = 2.0 * math.pi * RINGING.resonance_hz
    pair = np.array([[0.0, 1.0, 0.0, 0.0], [-(omega**2), -2.0 * RINGING.damping * omega, 0.0, omega**2]])
    through = linalg.expm(np.vstack([pair, [1.0, 0.0, 0.0, 0.0], np.zeros(4)]) * period_s)  # swing, its rate, its
    u = steps_ma(300) - steps_ma(300)[0]  # integral, and the drive that is held
    without = replace(RINGING, resonance_share=0.0)
    swung, state = np.zeros(len(u)), np.zeros(2)
    for k, value in enumerate(without.felt(u, period_s)):
        *state, integral, _ = through @ [*state, 0.0, value]
        swung[k] = integral / period_s
    by_hand = 0.5 * without.felt(u, period_s) + 0.5 * swung
    assert RINGING.felt(u, period_s) == pytest.approx(by_hand, abs=1e-7)


def test_it_rings_at_its_frequency_and_decays_with_its_damping():
    core = Core(1.0, 0.0, 1e-6, 1.0, resonance_share=1.0, resonance_hz=0.8, damping=0.1)
    step = core.felt(np.concatenate([np.zeros(1), np.ones(2000)]), 0.01)[1:] - 1.0
    peaks, _ = signal.find_peaks(step)
    damped_hz = 0.8 * math.sqrt(1.0 - 0.1**2)
    assert np.diff(peaks[:4]).mean() * 0.01 == pytest.approx(1.0 / damped_hz, abs=0.01)
    decay = math.exp(-2.0 * math.pi * 0.1 / math.sqrt(1.0 - 0.1**2))
    assert step[peaks[1]] / step[peaks[0]] == pytest.approx(decay, rel=0.01)
    assert step[peaks[0]] == pytest.approx(math.exp(-math.pi * 0.1 / math.sqrt(1.0 - 0.1**2)), rel=0.01)


@EACH
def test_the_discrete_model_runs_as_the_core_but_for_the_taps_that_it_leaves_out(core):
    u, period_s = steps_ma(300), 0.2
    a, c_0 = core.pole(period_s), 0.1
    drive = (1.0 - a) * (core.gain_mps_per_ma * core.felt(u, period_s) + c_0)
    speed, _ = signal.lfilter([1.0], [1.0, -a], drive, zi=[a * (core.gain_mps_per_ma * u[0] + c_0)])
    run = free_run(discretised(core, (), (), c_0, period_s), u, speed, {})
    known = np.isfinite(run)
    assert known.mean() > 0.8
    share = TAIL if core.resonance_share == 0.0 else 4.0 * TAIL  # what rings behind a lag lasts longer than either
    assert np.max(np.abs(run - speed)[known]) < 2.0 * share * core.gain_mps_per_ma * np.ptp(u)
    like = discretised(core, (), (), c_0, period_s)
    longer = replace(like, nb=100, theta=(*like.theta[:1], *(0.0,) * 100, like.theta[-1]))
    run = free_run(discretised(core, (), (), c_0, period_s, longer), u, speed, {})
    known = np.isfinite(run)
    assert run[known] == pytest.approx(speed[known], abs=1e-5)


@EACH
def test_the_speed_moves_as_much_later_than_the_current_as_its_parts_add(core):
    period_s, count = 0.02, 4000
    without = replace(core, resonance_share=0.0)
    speed = np.cumsum(without.response(period_s, count))
    a = without.pole(period_s)
    through = np.asarray(signal.lfilter([1.0 - a], [1.0, -a], speed))
    assert period_s * np.sum(1.0 - through) == pytest.approx(without.behind_s, abs=1.5 * period_s)
