"""The reference stays within acceleration and jerk, arrives, and never passes the setpoint."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.control.reference import Reference, ReferenceSettings

SETTINGS = ReferenceSettings()


@pytest.mark.parametrize("dt_s", [0.05, 0.2])
@given(start=st.floats(0, 3), target=st.floats(0, 3))
def test_it_arrives_within_its_limits_without_overshoot(dt_s, start, target):
    reference = Reference(SETTINGS)
    reference.reset(start)
    speeds = np.array([start] + [reference.step(target, dt_s) for _ in range(round(12 / dt_s))])
    assert speeds[-1] == target
    accel = np.diff(speeds) / dt_s
    assert np.abs(accel).max(initial=0) <= SETTINGS.accel_mps2 + 1e-9
    direction = np.sign(target - start)
    assert (direction * (speeds - target) <= 1e-9).all()
    assert (direction * np.diff(speeds) >= -1e-9).all()


def test_a_step_takes_about_as_long_as_it_must():
    reference = Reference(SETTINGS)
    steps = 0
    while reference.speed_mps < 1.0:
        reference.step(1.0, 0.2)
        steps += 1
    shortest_s = 1.0 / SETTINGS.accel_mps2 + SETTINGS.accel_mps2 / SETTINGS.jerk_mps3
    assert steps * 0.2 <= 1.5 * shortest_s


def test_a_preview_changes_nothing_and_is_what_happens():
    reference = Reference(SETTINGS)
    reference.reset(0.5)
    reference.step(1.5, 0.2)
    before = reference.speed_mps, reference.accel_mps2
    coming = reference.preview(1.5, 0.2, 20)
    assert (reference.speed_mps, reference.accel_mps2) == before
    assert coming == [reference.step(1.5, 0.2) for _ in range(20)]


def test_another_setpoint_or_step_on_the_way_is_followed_at_once():
    once, twice = Reference(SETTINGS), Reference(SETTINGS)
    for reference in (once, twice):
        for _ in range(10):
            reference.step(1.5, 0.05)
    twice.preview(1.5, 0.05, 60)
    assert [twice.step(0.5, 0.05) for _ in range(20)] == [once.step(0.5, 0.05) for _ in range(20)]
    twice.preview(0.5, 0.05, 60)
    assert twice.step(0.5, 0.1) == once.step(0.5, 0.1)


def test_a_new_drive_begins_anew_whatever_the_last_one_was_about_to_do():
    """At the same setpoint: neither the way that was looked at nor the acceleration is left."""
    used, fresh = Reference(SETTINGS), Reference(SETTINGS)
    used.reset(0.0)
    for _ in range(20):
        used.step(2.0, 0.05)
        used.preview(2.0, 0.05, 60)
    for one in (used, fresh):
        one.reset(0.5)
    assert [used.step(2.0, 0.05) for _ in range(40)] == [fresh.step(2.0, 0.05) for _ in range(40)]
    assert used.preview(2.0, 0.05, 60) == fresh.preview(2.0, 0.05, 60)


@pytest.mark.parametrize("ahead_mps", [0.02, 0.1, -0.3])
def test_a_setpoint_that_moves_into_its_way_is_passed_and_not_jumped_to(ahead_mps):
    """An open relief valve makes the present speed the setpoint: at half a metre per second squared no one stops."""
    reference = Reference(SETTINGS)
    reference.reset(1.0)
    for _ in range(30):
        reference.step(2.0, 0.05)
    target, rates = reference.speed_mps + ahead_mps, [reference.accel_mps2]
    for _ in range(170):
        reference.step(target, 0.05)
        rates.append(reference.accel_mps2)
    assert np.abs(np.diff(rates)).max() < 2.0 * SETTINGS.jerk_mps3 * 0.05  # of the frame in which it arrives
    assert reference.speed_mps == target
