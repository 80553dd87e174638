"""Active braking: what it takes for braking, and what a model with it does."""

import math

import numpy as np
import pytest

from cruise.effects.active_braking import ActiveBraking
from cruise.model.model import Model

DT_S = 0.05


def paces(drive_ma, pace=0.5):
    effect = ActiveBraking(pace)
    through, state = effect.over(drive_ma, np.zeros(len(drive_ma)), {}, DT_S)
    np.testing.assert_array_equal(through, drive_ma)
    return effect.pace({}, state)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_only_a_falling_drive_is_braking_in_both_directions_of_travel(direction):
    drive = direction * np.repeat([200.0, 500.0, 200.0], [40, 60, 200])
    found = paces(drive)
    np.testing.assert_array_equal(found[:100], 1.0)  # steady from the first sample on, then rising
    assert found[120] == 0.5
    assert found[-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_machine_that_is_reversed_brakes_until_it_stands_and_is_slow_the_other_way_at_first(direction):
    drive = direction * np.repeat([300.0, -300.0, -150.0], [100, 35, 100])
    found = paces(drive)
    braking = np.flatnonzero(found[100:135] < 0.75)
    assert 0.4 <= DT_S * len(braking) <= 1.2
    assert not (np.diff(braking) > 1).any()
    np.testing.assert_array_equal(found[125:135], 1.0)  # it speeds up, the other way
    settled = paces(direction * np.repeat([-300.0, -150.0], [300, 100]))[300:]
    assert found[135:].sum() > settled.sum(), "it has not reached all of its speed, and has less to lose"


def test_it_lasts_as_long_as_the_machine_takes_to_slow_down():
    drive = np.repeat([200.0, 500.0, 200.0], [40, 200, 400])
    lasting = {}
    for pace in (0.25, 0.5):
        found = paces(drive, pace)[240:]
        lasting[pace] = DT_S * np.count_nonzero(found < 0.5 * (1.0 + pace))
    assert lasting[0.25] > 1.7 * lasting[0.5]  # it coasts twice as long
    assert lasting[0.5] > 1.0


def test_ripple_of_the_current_is_hardly_braking():
    ripple = 500.0 + 2.0 * np.sin(2 * np.pi * 3.0 * DT_S * np.arange(200))
    assert paces(ripple).min() > 0.95


@pytest.mark.parametrize("pace", [0.5, 2.0])
def test_the_time_constant_down_is_that_up_divided_by_the_pace(pace):
    model = Model(DT_S, 1, 1, 0, (ActiveBraking(pace),), (0.96, 4e-5, 0.0))

    def time_to_63_percent(before_ma, after_ma):
        start, end = 1e-3 * before_ma, 1e-3 * after_ma
        state = model.start(start, before_ma, {})
        state = model.advance(state, before_ma, start, {})
        run = np.array(model.predict(state, [after_ma] * 200, [{}] * 200))
        assert run[-1] == pytest.approx(end, abs=0.01 * abs(start - end) + 1e-3)  # the steady speeds are the same
        return DT_S * np.argmax(np.abs(run - start) > 0.63 * abs(end - start))

    up, down = time_to_63_percent(200.0, 800.0), time_to_63_percent(800.0, 200.0)
    assert up == pytest.approx(DT_S / -math.log(0.96), rel=0.1)
    assert down / up == pytest.approx(1.0 / pace, rel=0.25)


def test_a_machine_that_nothing_brakes_slows_down_at_one_rate():
    fall_ma_per_s, gain_mps_per_ma = 100.0, 1e-3
    effect = ActiveBraking(1.0, fall_ma_per_s, lag_s=0.05, time_constant_s=DT_S / -math.log(0.96))
    model = Model(DT_S, 1, 1, 0, (effect,), (0.96, 0.04 * gain_mps_per_ma, 0.0))
    state = model.advance(model.start(0.8, 800.0, {}), 800.0, 0.8, {})
    run = np.array(model.predict(state, [200.0] * 300, [{}] * 300))
    falling = (run < 0.75) & (run > 0.35)  # near the end the rest of the way is shorter than the reach
    np.testing.assert_allclose(np.diff(run)[falling[1:]] / DT_S, -fall_ma_per_s * gain_mps_per_ma, rtol=0.02)
    assert run[-1] == pytest.approx(0.2, abs=0.01)
    up = np.array(model.predict(model.start(0.2, 200.0, {}), [800.0] * 300, [{}] * 300))
    free = np.array(
        Model(DT_S, 1, 1, 0, (), model.theta).predict(model.start(0.2, 200.0, {}), [800.0] * 300, [{}] * 300)
    )
    np.testing.assert_allclose(up, free)


def test_the_controllers_view_keeps_the_present_pace():
    model = Model(DT_S, 1, 1, 0, (ActiveBraking(0.5),), (0.96, 4e-5, 0.0))
    state = model.advance(model.start(0.5, 500.0, {}), 500.0, 0.5, {})
    assert model.linearise(state, {}).speed_coefficients[0] == pytest.approx(0.96)
    braking = state
    for _ in range(10):
        braking = model.advance(braking, 200.0, 0.5, {})
    assert model.linearise(braking, {}).speed_coefficients[0] == pytest.approx(0.5 * 0.96 + 0.5)
