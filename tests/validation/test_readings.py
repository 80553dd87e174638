"""A second reading of the speed is told from what moves for reasons of its own."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.readings import other_readings
from tests.validation.driving import drive, levels, wander

DT_S, SECONDS = 0.1, 240.0
SAMPLES = round(SECONDS / DT_S)


def with_column(one: Recording, values: np.ndarray, name: str = "by_satellite") -> Recording:
    return replace(one, columns={**one.columns, name: values})


def driven(seed: int = 3, **columns: np.ndarray) -> Recording:
    return drive(SECONDS, seed, DT_S, columns=columns)


READINGS = {
    "another unit, and noise": lambda y: 3.6 * y + np.random.default_rng(1).normal(0.0, 0.2, len(y)),
    "a second late": lambda y: np.roll(y, 10),
    "a mean over the last second": lambda y: np.convolve(y, np.ones(10) / 10)[: len(y)],
    "once a second": lambda y: np.repeat(y[::10], 10),
    "backward is negative": lambda y: -y,
    "lost at times": lambda y: np.where(np.arange(len(y)) % 50 < 10, np.nan, y),
}


@pytest.mark.parametrize("reading", READINGS)
def test_another_reading_of_the_speed_is_told(reading):
    one = driven()
    assert other_readings([with_column(one, READINGS[reading](one.output))]) == {
        "by_satellite": "the ground speed itself"
    }


def test_a_sensor_that_does_not_know_forward_from_backward_is_told():
    one = driven()
    turning = np.sign(wander(SAMPLES, DT_S, 1, 1.0, 10.0))
    one = replace(one, columns={**one.columns, OUTPUT: turning * one.output})
    assert other_readings([with_column(one, np.abs(one.output))]) == {"by_satellite": "the ground speed itself"}


def test_the_turns_of_a_shaft_before_the_gears_are_told_over_several_gears():
    gear = np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.0, 3.0)
    one, other = driven(gear=gear), driven(4, gear=np.full(SAMPLES, 2.0))
    ratios = {1.0: 1200.0, 2.0: 700.0, 3.0: 350.0}
    both = [
        with_column(each, np.array([ratios[g] for g in each.columns["gear"]]) * each.output, "motor_rpm")
        for each in (one, other)
    ]
    assert other_readings(both) == {"motor_rpm": "the ground speed itself"}


@pytest.mark.parametrize("late_s", [0.0, 0.5])
def test_a_sensor_of_the_acceleration_is_told(late_s):
    one = driven()
    change = np.gradient(drive(SECONDS, 3, DT_S, noise_mps=0.0).output, DT_S) / 9.81
    noisy = np.roll(change, round(late_s / DT_S)) + np.random.default_rng(1).normal(0.0, 0.3 * change.std(), SAMPLES)
    assert other_readings([with_column(one, noisy, "accel_g")]) == {"accel_g": "the change of the ground speed"}


@pytest.mark.parametrize("name", ["imu_y_mps2", "a [m/s²]", "accel_left_g", "acc"])
def test_what_is_named_as_an_acceleration_is_one_whatever_it_shows(name):
    found = other_readings([with_column(driven(), wander(SAMPLES, DT_S, 6, 1.0, 3.0), name)])
    assert found == {name: "the change of the ground speed"}


def test_the_valve_between_input_and_speed_is_told():
    one = driven()
    opened = np.roll(np.clip(one.input - 400.0, 0.0, 300.0), 3) + np.random.default_rng(1).normal(0.0, 20.0, SAMPLES)
    assert other_readings([with_column(one, opened, "valve_position")]) == {"valve_position": "the input itself"}


def test_what_drifts_is_not_told_by_an_input_that_is_held_for_long():
    one = driven()
    held = np.repeat(np.linspace(300.0, 800.0, 8), SAMPLES // 8)
    warmer = np.linspace(20.0, 80.0, SAMPLES)
    assert other_readings([with_column(with_column(one, warmer, "battery_warm"), held, "pump_current_ma")]) == {}


@pytest.mark.parametrize("name", ["accelerator_pedal", "vacuum", "yaw_rate_degps"])
def test_what_has_another_name_is_not_an_acceleration(name):
    assert other_readings([with_column(driven(), wander(SAMPLES, DT_S, 6, 1.0, 3.0), name)]) == {}


def test_what_pushes_the_machine_is_none_though_the_speed_changes_with_it():
    push = levels(SAMPLES, DT_S, 8, -0.5, 0.5)
    assert other_readings([drive(SECONDS, 3, DT_S, load_mps=push, columns={"tail_wind": push})]) == {}


def test_what_moves_for_reasons_of_its_own_is_none_though_it_moves_the_machine_or_goes_with_it():
    header = wander(SAMPLES, DT_S, 2, 1.0, 8.0)
    one = drive(SECONDS, 3, DT_S, load_mps=-0.4 * header, columns={"header_height": header})
    lifted = one.output - one.output.mean()
    follows = 0.8 * lifted / lifted.std() + 0.6 * wander(SAMPLES, DT_S, 5, 1.0, 8.0)
    one = with_column(with_column(one, follows, "follows"), np.full(SAMPLES, 7.3), "still")
    assert other_readings([one]) == {}


def test_a_signal_with_a_meaning_is_never_one():
    one = driven()
    assert other_readings([with_column(one, one.output, "wheel_speed_mps")]) == {}
