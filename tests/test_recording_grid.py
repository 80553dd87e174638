"""Readings come onto a uniform grid: jitter, gaps, coarse and fine grids, signals with times of their own."""

import numpy as np
import pytest

from cruise.columns import ActiveWhen, RecordingSettings, arranged
from cruise.csv_file import read_csv
from cruise.recording import Readings, Recording, RecordingError, resample
from cruise.sampling import Kind, means
from cruise.signals import INPUT, OUTPUT
from tests.csv_files import PLAIN, csv_of, ramp


@pytest.mark.parametrize(
    ("mean_step_s", "expected_s"), [(0.0993, 0.1), (0.0497, 0.05), (0.0335, 1 / 30), (0.00993, 0.01), (0.38, 0.38)]
)
def test_a_jittering_step_is_rounded_to_a_sensible_one(tmp_path, mean_step_s, expected_s):
    jitter = 1.0 + 0.05 * np.cos(np.arange(40))
    times = np.cumsum(jitter / jitter.mean() * mean_step_s)
    assert read_csv(csv_of(tmp_path, [f"{t:.6f},1,1" for t in times]), PLAIN).dt_s == pytest.approx(expected_s)


def test_jitter_leaves_a_straight_line_straight_and_a_step_a_step(tmp_path):
    random = np.random.default_rng(4)
    times = 0.1 * np.arange(60) + random.uniform(-0.008, 0.008, 60)
    times[0] = 0.0
    rows = [f"{t:.6f},{500.0 if k >= 30 else 0.0},{2.0 * t:.9f}" for k, t in enumerate(times)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN, 0.1)
    np.testing.assert_allclose(read.output, 2.0 * read.time_s, atol=1e-6)
    assert set(read.input.tolist()) == {0.0, 500.0}
    assert read.input[29] == 0.0
    assert read.input[30] == 500.0


def test_a_finer_grid_interpolates_the_speed_and_holds_the_current(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp()), PLAIN, 0.05)
    assert len(read) == 39
    np.testing.assert_allclose(read.output, 2.0 * read.time_s, atol=1e-9)
    np.testing.assert_allclose(read.input, 10.0 * (np.arange(39) // 2), atol=1e-9)


def test_a_coarser_grid_holds_the_means_that_the_online_path_takes(tmp_path):
    random = np.random.default_rng(5)
    times, speeds = 0.01 * np.arange(400), random.normal(size=400)
    rows = [f"{t:.6g},{u!r},{v!r}" for t, u, v in zip(times, speeds[::-1].tolist(), speeds.tolist(), strict=True)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN, 0.2)
    np.testing.assert_allclose(read.time_s, 0.2 * np.arange(1, 20), atol=1e-12)
    np.testing.assert_allclose(read.output, means(times, speeds, read.time_s, 0.2, Kind.CONTINUOUS, 0.3), atol=1e-9)
    by_hand = [speeds[::-1][20 * k : 20 * k + 20].mean() for k in range(19)]
    np.testing.assert_allclose(read.input, by_hand, atol=1e-9)


@pytest.mark.parametrize("step_s", [0.01, 0.02, 0.04, 0.05, 0.1])
def test_means_of_means_are_the_means_of_the_readings(step_s):
    """A mean counts for the period that ends with it: speed and current stay as they lay."""
    random = np.random.default_rng(6)
    time_s = 7.3 + 0.01 * np.arange(4000)
    speeds = np.cumsum(random.normal(size=4000)) * 0.01
    currents, gears = (np.repeat(values, 40) for values in (random.uniform(0.0, 900.0, 100), np.arange(100.0) % 3))
    fine = Recording(time_s, {INPUT: currents, OUTPUT: speeds, "gear": gears}, 0.01, "fine")
    between = resample(fine, step_s) if step_s > 0.01 else fine
    at_once, in_two = resample(fine, 0.2), resample(between, 0.2)
    assert between.averaged == (step_s > 0.01)
    assert in_two.averaged
    assert in_two[3:9].averaged
    np.testing.assert_allclose(in_two.time_s, at_once.time_s, atol=1e-9)
    for name in (INPUT, OUTPUT, "gear"):
        np.testing.assert_allclose(in_two.columns[name], at_once.columns[name], atol=1e-9)


def test_resampling_follows_the_same_rules(tmp_path):
    path = csv_of(tmp_path, ramp(60, 0.05))
    fine, coarse = read_csv(path, PLAIN), read_csv(path, PLAIN, 0.2)
    again = resample(fine, 0.2)
    assert again.dt_s == 0.2
    np.testing.assert_allclose(again.output, coarse.output, atol=1e-9)
    np.testing.assert_allclose(again.input, coarse.input, atol=1e-9)


def readings(step_s: float, values, count: int = 41, start_s: float = 0.0) -> Readings:
    time_s = start_s + step_s * np.arange(count)
    return Readings(time_s, values(time_s))


def test_signals_with_times_of_their_own_meet_on_the_slower_ones_grid():
    columns = {
        INPUT: readings(0.1, lambda t: 100.0 * t),
        OUTPUT: readings(0.2, lambda t: 2.0 * t, 21, 0.003),
        "pitch_deg": readings(0.02, lambda t: t + np.cos(50 * np.pi * t), 201),  # at half its rate: noise
        "gear": readings(0.5, np.floor, 9),
        "oil_temperature_c": readings(1.0, lambda t: 60.0 + t, 5),
    }
    read = arranged("made up", columns, PLAIN, None)
    assert read.dt_s == pytest.approx(0.2)
    assert read.time_s[0] == 0.003
    inside = slice(1, -1)
    at_s = read.time_s[inside]
    np.testing.assert_allclose(read.output[inside], 2.0 * at_s, atol=1e-9)
    np.testing.assert_allclose(read.input[inside], 100.0 * (at_s + 0.05), atol=6.0)  # the mean of what holds from then
    np.testing.assert_allclose(read.columns["pitch_deg"][inside], at_s, atol=0.06)
    np.testing.assert_allclose(read.columns["gear"][inside], np.floor(at_s))
    np.testing.assert_allclose(read.columns["oil_temperature_c"][inside], 60.0 + at_s, atol=1e-9)
    coarse = arranged("made up", columns, PLAIN, 0.4)
    np.testing.assert_allclose(coarse.output, 2.0 * (coarse.time_s - 0.2), atol=0.01)
    assert read.stamps_s is not None
    fine = arranged("made up", columns, PLAIN, 0.1)
    np.testing.assert_array_equal(resample(fine, 0.2).stamps_s, read.stamps_s)


def test_a_current_that_comes_faster_acts_from_its_grid_time_on():
    """Speed is what the current has added up to 0.3 s ago: a delay of three steps of 0.1 s, neither more nor less."""
    currents = np.random.default_rng(8).uniform(300.0, 900.0, 600)
    driven = np.concatenate([np.zeros(30), 0.01 * np.cumsum(currents)])[:600]
    time_s = 0.01 * np.arange(600)
    columns = {INPUT: Readings(time_s, currents), OUTPUT: Readings(time_s[9::10], driven[8::10])}
    read = arranged("made up", columns, PLAIN, None)
    assert read.dt_s == pytest.approx(0.1)
    np.testing.assert_allclose(np.diff(read.output)[3:], 0.1 * read.input[:-4], atol=1e-9)
    at_once = arranged("made up", columns, PLAIN, 0.2)
    np.testing.assert_allclose(resample(read, 0.2).input, at_once.input, atol=1e-9)


def test_where_the_rate_changes_the_commoner_one_is_the_grids_and_the_denser_readings_are_averaged():
    time_s = np.concatenate([0.1 * np.arange(600), 60.0 + 0.01 * np.arange(401)])
    shaking = np.where(time_s < 60.0, 1.0, 1.0 + 0.5 * np.sin(2 * np.pi * 31.0 * time_s))
    currents = np.concatenate([np.full(600, 500.0), np.random.default_rng(9).uniform(300.0, 900.0, 401)])
    read = arranged("made up", {INPUT: Readings(time_s, currents), OUTPUT: Readings(time_s, shaking)}, PLAIN, None)
    assert read.dt_s == pytest.approx(0.1)
    assert not read.averaged
    np.testing.assert_allclose(read.output[:595], 1.0)
    assert read.output[605:-5].std() < 0.05  # of 0.35 at 100 Hz; at its instants it would be that of 1 Hz
    np.testing.assert_allclose(read.input[600:639], currents[600:990].reshape(39, 10).mean(axis=1))
    assert read.notes == tuple(
        f"{name}: comes every 0.01 s instead of 0.1 s from t=60 s on, 40 % of it at another rate"
        for name in (INPUT, OUTPUT)
    )
    slowed = np.concatenate([0.05 * np.arange(600), 30.0 + 0.15 * np.arange(201)])
    notes = arranged("made up", {name: Readings(slowed, 500.0 + slowed) for name in (INPUT, OUTPUT)}, PLAIN, None).notes
    assert f"{INPUT}: comes every 0.15 s instead of 0.05 s from t=30 s on, 25 % of it at another rate" in notes


def test_a_step_that_stamps_of_few_digits_halve_is_no_change_of_rate():
    time_s = np.floor(np.arange(801) / 0.6 + 1e-6) / 100.0  # 60 Hz, in steps of 0.02, 0.02 and 0.01 s
    columns = {name: Readings(time_s, 500.0 + time_s) for name in (INPUT, OUTPUT)}
    read = arranged("made up", columns, PLAIN, None)
    assert read.dt_s == pytest.approx(1 / 60)
    assert read.notes == ()


def test_readings_out_of_order_or_repeated_are_counted_not_taken():
    speed = readings(0.1, lambda t: 2.0 * t)
    times = np.insert(speed.time_s, [10, 20, 30], [0.5, speed.time_s[20], np.nan])
    values = np.insert(speed.values, [10, 20, 30], [99.0, 99.0, 99.0])
    current = readings(0.1, lambda t: 100.0 * t)
    read = arranged("made up", {INPUT: current, OUTPUT: Readings(times, values)}, PLAIN, None)
    np.testing.assert_allclose(read.output, speed.values, atol=1e-9)
    assert read.notes == ("ground_speed_mps: 3 of 44 readings out of order or repeated, left out",)


def test_one_stamp_far_ahead_costs_one_reading():
    speed, current = readings(0.1, lambda t: 2.0 * t), readings(0.1, lambda t: 500.0 + t)
    speed.time_s[20] = 5000.0
    read = arranged("made up", {INPUT: current, OUTPUT: speed}, PLAIN, None)
    np.testing.assert_allclose(read.output, 2.0 * read.time_s, atol=1e-9)
    assert read.notes == ("ground_speed_mps: 1 of 41 readings out of order or repeated, left out",)


def test_a_flag_gates_the_input_from_its_own_last_reading_on():
    current, speed = readings(0.1, lambda t: 700.0 + 0.0 * t), readings(0.1, lambda t: 2.0 * t)
    flag = Readings(np.array([0.55, 2.05]), np.array([1.0, 0.0]))
    settings = RecordingSettings(active_when=ActiveWhen(column="safe"))
    read = arranged("made up", {INPUT: current, OUTPUT: speed, "safe": flag}, settings, None)
    assert np.isnan(read.input[:6]).all()
    assert set(read.input[6:21].tolist()) == {700.0}
    assert set(read.input[21:].tolist()) == {0.0}
    assert read.notes[0] == "input set to 0 in 20 of 41 readings: safe is not above 0.5"


def test_too_few_readings_are_named(tmp_path):
    columns = {INPUT: readings(0.1, np.sin, 9), OUTPUT: readings(0.1, np.sin)}
    with pytest.raises(RecordingError, match="made up: pump_current_ma has 9 readings, too few"):
        arranged("made up", columns, PLAIN, None)
    with pytest.raises(RecordingError, match="made up: no column 'amps' for input; it has pump_current_ma, ground"):
        arranged("made up", columns, RecordingSettings(input="amps"), None)


def test_a_gap_stays_a_gap(tmp_path):
    rows = ramp(60)
    read = read_csv(csv_of(tmp_path, rows[:20] + rows[51:]), PLAIN)
    assert len(read) == 60
    assert np.isnan(read.output[20:51]).all()
    assert np.isfinite(read.output[:20]).all()
    assert np.isfinite(read.output[51:]).all()
    assert "ground_speed_mps: gap of 3.2 s at t=1.9 s" in read.notes
    assert resample(read, 0.1).notes == read.notes


def test_a_slow_signal_lives_as_long_as_its_own_period_says(tmp_path):
    rows = [f"{row},{60 + k if k % 10 == 0 else ''}" for k, row in enumerate(ramp(60))]
    read = read_csv(csv_of(tmp_path, rows, "time_s,pump_current_ma,ground_speed_mps,oil_temperature_c"), PLAIN)
    np.testing.assert_allclose(read.context()["oil_temperature_c"][:51], 60.0 + np.arange(51), atol=1e-9)


@pytest.mark.parametrize("dt_s", [0.0, -0.1, float("nan"), float("inf")])
def test_an_impossible_period_is_refused(tmp_path, dt_s):
    with pytest.raises(RecordingError, match="sampling period"):
        read_csv(csv_of(tmp_path, ramp()), PLAIN, dt_s)
