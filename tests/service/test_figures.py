"""The figures of a drive, on traces whose figures are known."""

import math

import numpy as np
import pytest

from cruise.service.figures import SETTLE_S, above_1hz_rms, drive_figures

FRAME_S = 0.05
RANGE_MA = 1200.0


def trace(setpoint, speed, command=None, accel=None):
    """Columns of a trace; NaN in the setpoint: a person drives."""
    setpoint = np.asarray(setpoint, float)
    zeros = np.zeros(len(setpoint))
    return {
        "engaged": np.isfinite(setpoint).astype(float),
        "setpoint_mps": setpoint,
        "true_speed_mps": np.asarray(speed, float),
        "true_accel_mps2": zeros if accel is None else accel,
        "command_ma": zeros if command is None else command,
    }


def figures(*columns, **more):
    return drive_figures(trace(*columns, **more), FRAME_S, RANGE_MA)


def pieces(*parts):
    """(value, seconds) after each other."""
    return np.concatenate([np.full(round(seconds / FRAME_S), value) for value, seconds in parts])


TIME_S = np.arange(0.0, 60.0, FRAME_S)


@pytest.mark.parametrize(
    ("frequency_hz", "expected_ma"), [(2.0, 10.0 / math.sqrt(2)), (1.2, 10.0 / math.sqrt(2)), (0.2, 0.0), (0.8, 0.0)]
)
def test_content_above_1_hz_of_a_sine_is_its_rms_or_nothing(frequency_hz, expected_ma):
    command = 700.0 + 10.0 * np.sin(2 * np.pi * frequency_hz * TIME_S + 0.4)
    assert above_1hz_rms(command, FRAME_S) == pytest.approx(expected_ma, rel=0.02, abs=0.01)
    found = figures(np.ones(len(TIME_S)), np.ones(len(TIME_S)), command=command)
    assert found["command_above_1hz_rms_pct"] == pytest.approx(100 * expected_ma / RANGE_MA, rel=0.02, abs=0.001)


def test_a_command_that_is_too_short_for_its_spectrum_has_no_figure():
    assert math.isnan(above_1hz_rms(np.ones(399), FRAME_S))
    assert above_1hz_rms(np.ones(400), FRAME_S) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("before", "after"), [(1.0, 1.5), (1.5, 1.0), (1.0, 1.2)])
def test_a_tenth_too_far_is_an_overshoot_of_ten_percent(before, after):
    setpoint = pieces((before, 20.0), (after, 20.0))
    beyond = after + 0.1 * (after - before)
    speed = pieces((before, 22.0), (beyond, 1.0), (after, 17.0))
    assert figures(setpoint, speed)["overshoot_pct"] == pytest.approx(10.0)


def test_the_largest_overshoot_counts_and_one_that_never_arrives_has_none():
    setpoint = pieces((1.0, 20.0), (1.5, 20.0), (1.0, 20.0))
    speed = pieces((1.0, 20.0), (1.4, 20.0), (0.9, 2.0), (1.0, 18.0))
    assert figures(setpoint, speed)["overshoot_pct"] == pytest.approx(20.0)
    assert figures(setpoint[:800], speed[:800])["overshoot_pct"] == pytest.approx(0.0)


def test_a_change_too_small_for_a_percentage_has_no_overshoot():
    setpoint = pieces((1.0, 20.0), (1.05, 20.0))
    speed = pieces((1.0, 20.0), (1.3, 20.0))
    assert math.isnan(figures(setpoint, speed)["overshoot_pct"])


def test_what_comes_after_the_next_change_is_not_counted_for_the_one_before():
    setpoint = pieces((1.0, 20.0), (1.5, 4.0), (2.5, 20.0))
    speed = pieces((1.0, 20.0), (1.5, 4.0), (2.5, 20.0))
    assert figures(setpoint, speed)["overshoot_pct"] == pytest.approx(0.0)


def test_each_change_has_its_own_size():
    setpoint = pieces((1.4, 20.0), (1.5, 2.0), (1.0, 2.0), (1.5, 20.0))
    speed = pieces((1.4, 20.0), (1.5, 2.0), (1.0, 2.0), (1.55, 2.0), (1.5, 18.0))
    assert figures(setpoint, speed)["overshoot_pct"] == pytest.approx(10.0)  # of 0.5 m/s, not of 0.1


def test_what_comes_after_the_operator_took_over_is_no_overshoot():
    setpoint = pieces((1.5, 20.0), (1.0, 4.0), (math.nan, 20.0))
    speed = pieces((1.5, 20.0), (0.95, 4.0), (0.0, 20.0))
    assert figures(setpoint, speed)["overshoot_pct"] == pytest.approx(10.0)


def test_errors_leave_out_the_time_after_a_change_and_without_cruise():
    setpoint = pieces((math.nan, 10.0), (1.0, 20.0), (1.5, 20.0), (math.nan, 10.0))
    speed = pieces((9.0, 10.0), (3.0, SETTLE_S), (1.04, 12.0), (4.0, SETTLE_S), (1.48, 12.0), (9.0, 10.0))
    found = figures(setpoint, speed)
    assert found["rms_error_mps"] == pytest.approx(math.sqrt((0.04**2 + 0.02**2) / 2), rel=0.01)
    assert found["steady_error_mps"] == pytest.approx(0.01, rel=0.01)
    assert found["engaged_s"] == pytest.approx(40.0)
    assert found["setpoint_changes"] == 2  # engaging is one


def test_the_largest_acceleration_counts_while_engaged_only():
    setpoint = pieces((math.nan, 10.0), (1.0, 20.0))
    accel = pieces((3.0, 10.0), (0.2, 10.0), (-0.7, 5.0), (0.0, 5.0))
    assert figures(setpoint, setpoint, accel=accel)["accel_max_mps2"] == pytest.approx(0.7)


def test_a_drive_by_hand_has_no_figures_and_no_error():
    found = figures(np.full(200, math.nan), np.ones(200))
    assert found["engaged_s"] == 0.0
    assert found["setpoint_changes"] == 0
    for name in ("rms_error_mps", "steady_error_mps", "overshoot_pct", "command_above_1hz_rms_pct", "accel_max_mps2"):
        assert math.isnan(found[name])
