"""The floor is the sensor's noise where nothing else is unknown, and never above what a perfect model would reach."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from cruise.recording import Recording, resample
from cruise.signals import INPUT, OUTPUT
from cruise.validation.noise_floor import causes_in, noise_floor
from tests.validation.machine import DT_S, record

PERIOD_S = 0.2
AVERAGED = np.sqrt(3.5) / 4.0  # white noise of four samples under a trapezoid of weights 1/2, 1, 1, 1, 1/2
H = 15  # 3 s


def perfect(seed: int, seconds: float) -> np.ndarray:
    """The speed without noise, soil and slope, at the model's period: what a model says that knows the rest."""
    return resample(record(seed=seed, seconds=seconds, noise_mps=0.0), PERIOD_S).output


def floor_of(native: Recording, predicted: np.ndarray):
    return noise_floor([native], [resample(native, PERIOD_S)], [predicted], H)


@pytest.mark.parametrize(("noise_mps", "seed"), [(0.01, 1), (0.04, 2)])
@pytest.mark.parametrize("grade", [0.0, 0.05])
def test_the_white_part_is_the_noise_whatever_the_model_lacks(noise_mps: float, seed: int, grade: float):
    native = record(seed=seed, seconds=300.0, noise_mps=noise_mps, grade_mps_per_deg=grade)
    found = floor_of(native, perfect(seed, 300.0))  # a model without the slope
    assert found.white is not None
    assert found.white.value_mps == pytest.approx(AVERAGED * noise_mps, rel=0.04)
    assert found.white.low_mps < found.white.value_mps < found.white.high_mps
    assert found.white.high_mps / found.white.low_mps < 1.1
    assert found.to_hz == pytest.approx(10.0)


def test_the_interval_holds_the_truth_as_often_as_it_says():
    held, levels = 0, []
    for seed in range(20):
        native = record(seed=seed, seconds=120.0, noise_mps=0.02)
        white = noise_floor([native], [native], [np.full(len(native), np.nan)], 60).white
        assert white is not None
        held += white.low_mps <= 0.02 <= white.high_mps
        levels.append(white.value_mps)
    assert np.mean(levels) == pytest.approx(0.02, rel=0.01)
    assert held >= 16  # 95 % of 20 is 19; fewer than 16 has a chance of 0.3 %


def test_means_of_means_have_less_of_the_noise_by_every_one_of_them():
    native = replace(record(seed=2, seconds=1200.0, noise_mps=0.02), averaged=True)
    coarse = resample(native, PERIOD_S)
    white = noise_floor([native], [coarse], [np.full(len(coarse), np.nan)], H).white
    assert white is not None
    assert white.value_mps == pytest.approx(0.02 / np.sqrt(4.0), rel=0.03)


def test_a_perfect_model_has_nothing_to_gain():
    native, predicted = record(seed=4, seconds=300.0, noise_mps=0.04), perfect(4, 300.0)
    found = floor_of(native, predicted)
    rmse = float(np.sqrt(np.mean((resample(native, PERIOD_S).output - predicted) ** 2)))
    assert found.reached is not None
    assert found.reached.value_mps == pytest.approx(rmse, rel=0.05)
    assert found.reached.high_mps > rmse
    assert found.between_mps < 0.5 * AVERAGED * 0.04


def test_what_the_model_lacks_is_found_from_above():
    native = record(seed=1, seconds=400.0, noise_mps=0.02, grade_mps_per_deg=0.05)
    predicted = perfect(1, 400.0)
    found = floor_of(native, predicted)
    lacking = float(np.sqrt(np.mean((resample(native, PERIOD_S).output - predicted) ** 2)))
    assert found.reached is not None
    assert lacking > 0.08
    assert found.reached.high_mps < 0.4 * lacking
    assert found.reached.low_mps > AVERAGED * 0.02


def test_slow_soil_is_between_the_two():
    """The floor 3 s ahead is then not the sensor's: soil is forgotten with exp(-3 s / 5 s) before it acts."""
    soil, noise = 0.06, 0.01
    native = record(seed=3, seconds=600.0, noise_mps=noise, soil_mps=soil)
    found = floor_of(native, perfect(3, 600.0))
    least = soil * np.sqrt((1.0 - np.exp(-2 * 3.0 / 5.0)) * 5.0 / 5.5)  # of what is new in 3 s, behind a lag of 0.5 s
    assert found.white is not None
    assert found.reached is not None
    assert found.white.value_mps == pytest.approx(AVERAGED * noise, rel=0.06)
    assert 0.75 * least < found.between_mps < 1.35 * least
    assert found.reached.value_mps**2 == pytest.approx(found.white.value_mps**2 + found.between_mps**2)


def coloured(native: Recording, time_constant_s: float, std_mps: float) -> Recording:
    """The recording with noise of a sensor that filters."""
    pole = np.exp(-DT_S / time_constant_s)
    white = np.random.default_rng(9).standard_normal(len(native))
    noise = std_mps * np.sqrt(1.0 - pole**2) * signal.lfilter([1.0], [1.0, -pole], white)
    return Recording(native.time_s, {**native.columns, OUTPUT: native.output + noise}, DT_S, "coloured.csv")


@pytest.mark.parametrize("time_constant_s", [0.05, 0.1, 0.3])
def test_coloured_noise_makes_the_bound_low_never_high(time_constant_s: float):
    native = coloured(record(seed=5, seconds=300.0, noise_mps=0.0), time_constant_s, 0.03)
    predicted = perfect(5, 300.0)
    error = resample(native, PERIOD_S).output - predicted
    found = floor_of(native, predicted)
    assert found.white_at_most_mps < 1.03 * float(np.std(error))
    if found.white is not None:
        assert found.white.value_mps < float(np.std(error))


def test_a_spectrum_that_falls_to_its_end_gives_no_bound_from_below():
    quiet = record(seed=6, seconds=200.0, noise_mps=0.0)
    sections = np.asarray(signal.butter(2, 3.0, fs=1.0 / DT_S, output="sos"))
    filtered = 0.03 * np.asarray(signal.sosfilt(sections, np.random.default_rng(9).standard_normal(len(quiet))))
    native = Recording(quiet.time_s, {**quiet.columns, OUTPUT: quiet.output + filtered}, DT_S, "filtered.csv")
    found = noise_floor([native], [native], [np.full(len(native), np.nan)], 60)
    assert found.white is None
    assert 0.0 < found.white_at_most_mps < 0.01
    assert np.isnan(found.between_mps)


def test_no_floor_from_below_stands_above_what_a_model_leaves():
    """A small robot: a lag of 40 ms and a dead zone. Its steps are as sudden as noise at 5 Hz."""
    rng = np.random.default_rng(3)
    current = np.repeat(rng.uniform(-90.0, 90.0, 57), 150)  # 85 s at 100 Hz
    opened = np.sign(current) * np.maximum(np.abs(current) - 15.0, 0.0) * 0.04
    pole = np.exp(-0.01 / 0.04)
    moved = np.asarray(signal.lfilter([1.0 - pole], [1.0, -pole], opened))
    measured = moved + 0.01 * rng.standard_normal(len(moved))
    time_s = 0.01 * np.arange(len(moved))
    robot = Recording(time_s, {INPUT: current, OUTPUT: measured}, 0.01, "robot.csv")
    still = resample(robot, PERIOD_S)
    known = resample(replace(robot, columns={INPUT: current, OUTPUT: moved}), PERIOD_S).output
    found = noise_floor([robot], [still], [known], H)
    left_mps = float(np.sqrt(np.mean((still.output - known) ** 2)))
    assert found.white is None or found.white.low_mps < left_mps
    assert found.reached is not None
    assert found.reached.value_mps == pytest.approx(left_mps, rel=1e-3)  # the flexible model only spoils it
    assert found.white_at_most_mps < 1.5 * left_mps


def test_too_little_data_is_no_floor():
    native = record(seed=6, seconds=10.0)
    found = floor_of(native, resample(native, PERIOD_S).output)
    assert found.white is None
    assert found.reached is None
    assert np.isnan(found.white_at_most_mps)


def test_what_answers_to_the_speed_is_no_cause():
    native = record(seed=1, seconds=20.0)
    columns = {**native.columns, "wheel_speed_mps": native.output, "engine_load_pct": native.input}
    both = Recording(native.time_s, columns, DT_S, "x.csv")
    assert causes_in([both]) == ("engine_speed_rpm", "pitch_deg", "machine_mass_kg")
    lower = Recording(native.time_s, {INPUT: native.input, OUTPUT: native.output}, DT_S, "x.csv")
    assert causes_in([lower]) == ()


def test_pieces_in_which_no_error_is_known_before_a_prediction_still_have_a_floor():
    native, predicted = record(seed=4, seconds=300.0, noise_mps=0.04), perfect(4, 300.0)
    in_pieces = np.where(np.arange(len(predicted)) % 30 < H, predicted, np.nan)
    reached = floor_of(native, in_pieces).reached
    assert reached is not None
    assert AVERAGED * 0.04 < reached.value_mps < 2.0 * AVERAGED * 0.04
