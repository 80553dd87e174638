"""The two ways of predicting a recording give the same numbers, and free runs begin where they can."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from cruise.effects import Effect, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.model import prediction
from cruise.model.model import Model

GEARS = GearRatio(1.4, 2.5, 4.4, 7.8)
SHAPES = (DeadZone(380.0), EngineSpeed(1.0))


@dataclass(frozen=True)
class Drag(Effect):
    """A load that reads the speed, for these tests only."""

    name = "drag"
    stage = Stage.LOAD
    needs = ()
    reads_speed = True
    parameters: ClassVar = {}

    def step(self, value, past_speed, signals, state, dt_s):
        return past_speed * abs(past_speed), state


def recording(count: int = 120, seed: int = 0):
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(400, 1000, count // 8 + 1), 8)[:count]
    speeds = 1.0 + 0.2 * rng.standard_normal(count)
    signals = {"engine_speed_rpm": rng.uniform(1800, 2100, count), "gear": np.where(np.arange(count) < 70, 2.0, 3.0)}
    return current, speeds, signals


def model(na: int, nb: int, delay: int, *effects: Effect) -> Model:
    loads = sum(effect.acts_as is Stage.LOAD for effect in effects)
    theta = (*[0.5, 0.2, 0.1][:na], *[4e-4, 3e-4, 2e-4][:nb], *(-0.05,) * loads, 0.1)
    return Model(0.2, na, nb, delay, effects, theta)


MODELS = {
    "linear": model(1, 3, 2),
    "second order": model(2, 3, 2),
    "no feedback": model(0, 3, 2),
    "no drive": model(2, 0, 0),
    "shapes": model(1, 2, 1, *SHAPES),
    "gears": model(2, 2, 1, *SHAPES, GEARS),
    "gears without feedback": model(0, 2, 1, GEARS),
}


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("horizon", [1, 2, 7, 15])
@pytest.mark.parametrize("name", MODELS)
def test_over_whole_arrays_is_the_same_as_step_by_step(name, horizon, holes):
    chosen, (current, speeds, signals) = MODELS[name], recording()
    if holes:
        current[40], speeds[61:64], signals["gear"][90] = np.nan, np.nan, np.nan
    noise = [0.01 * np.arange(len(current)), 0.02 * np.arange(len(current))]
    state = prediction.states_over(chosen, current, speeds, signals)
    assert not chosen.reads_speed
    slow = prediction.ahead_stepwise(chosen, state, current, speeds, signals, horizon, noise)
    fast = prediction.ahead(chosen, current, speeds, signals, horizon, noise)
    np.testing.assert_allclose(fast, slow, rtol=1e-12)
    assert np.isfinite(fast).mean() > 0.4


@pytest.mark.parametrize("name", MODELS)
def test_a_free_run_is_the_same_either_way_and_as_the_prediction_from_its_start(name):
    chosen, (current, speeds, signals) = MODELS[name], recording()
    state = prediction.states_over(chosen, current, speeds, signals)
    fast = prediction.free_run(chosen, current, speeds, signals)
    slow = prediction.run_stepwise(chosen, state, current, speeds, signals)[:, 0]
    np.testing.assert_allclose(fast, slow, rtol=1e-12)
    first = int(np.argmax(np.isfinite(fast)))
    last = len(speeds) - 1
    whole = prediction.ahead(chosen, current, speeds, signals, last - first + 1)
    assert whole[last] == pytest.approx(fast[last], rel=1e-9)


def test_an_effect_that_reads_the_speed_is_seen_and_stepped():
    chosen, (current, speeds, signals) = model(1, 2, 1, Drag()), recording()
    assert chosen.reads_speed
    run = prediction.free_run(chosen, current, speeds, signals)
    expected = speeds[1]
    for k in range(2, len(speeds)):
        expected = 0.5 * expected + 4e-4 * current[k - 1] + 3e-4 * current[k - 2] - 0.05 * expected**2 + 0.1
        assert run[k] == pytest.approx(expected, rel=1e-12)


def standing_on_a_slope():
    """A machine that stands at no current on 5 degrees after its first 20 samples, and its brakes hold."""
    current, speeds, signals = recording()
    current[20:60], speeds[20:60] = 0.0, 0.0
    return current, speeds, signals | {"pitch_deg": np.full(len(current), 5.0)}


@pytest.mark.parametrize("others", [(), (Drag(),)])
def test_a_machine_that_stands_at_no_current_is_held_on_a_slope(others):
    chosen, (current, speeds, signals) = model(1, 2, 1, Grade(), *others), standing_on_a_slope()
    free = replace(chosen, theta=(0.5, 4e-4, 3e-4, 0.05, *(-0.05,) * len(others), 0.0))
    run = prediction.free_run(free, current, speeds, signals)
    assert run[40:60] == pytest.approx(0.0, abs=1e-3)  # without brakes it rolls: -0.05 * 0.855 / 0.5
    assert run[65:].min() > 0.2
    state = prediction.states_over(free, current, speeds, signals)
    slow = prediction.ahead_stepwise(free, state, current, speeds, signals, 15)
    np.testing.assert_allclose(prediction.ahead(free, current, speeds, signals, 15), slow, rtol=1e-12)
    assert slow[40:60] == pytest.approx(0.0, abs=1e-3)
    by_hand = prediction.run_stepwise(free, state, current, speeds, signals)[:, 0]
    np.testing.assert_allclose(run, by_hand, rtol=1e-12, atol=1e-12)


def test_a_machine_that_moves_or_is_asked_to_is_not_held():
    current, speeds, _ = standing_on_a_slope()
    held = prediction.standing_held(current, speeds, 0.2)
    assert np.flatnonzero(held).tolist() == list(range(20, 60))
    current[30], speeds[40], speeds[50] = 50.0, 0.3, np.nan
    assert np.flatnonzero(~prediction.standing_held(current, speeds, 0.2))[20:23].tolist() == [30, 40, 50]


def test_a_machine_that_was_parked_throughout_is_held_whatever_its_sensors_read_at_rest():
    rng = np.random.default_rng(0)
    current, speeds = 1.0 * rng.standard_normal(300), 0.015 * rng.standard_normal(300)
    assert prediction.standing_held(current, speeds, 0.2).mean() > 0.99
    rolls = np.where(np.arange(300) < 150, speeds, -0.2)
    assert not prediction.standing_held(current, rolls, 0.2).any()


def test_a_machine_that_rolls_where_it_is_left_alone_is_not_held():
    current, speeds, _ = standing_on_a_slope()
    speeds[40:46] = 0.3  # 6 of the 26 samples without current for 3 s
    assert not prediction.standing_held(current, speeds, 0.2).any()


def test_a_machine_that_creeps_with_the_slope_is_not_held_and_one_whose_sensor_is_noisy_is():
    """5 cm/s are less than a twentieth of the greatest speed, and none of them is noise."""
    rng = np.random.default_rng(0)
    current = np.concatenate([np.full(200, 600.0), np.zeros(400)])
    noise = 0.02 * rng.standard_normal(600)
    speeds = np.where(current > 0.0, 3.0, 0.0) + noise
    assert prediction.standing_held(current, speeds, 0.2)[200:].all()
    biased = np.where(current > 0.0, 3.0, 0.1) + noise
    assert prediction.standing_held(current, biased, 0.2)[200:].mean() > 0.98
    creeps = speeds - 0.5 * noise + np.where(current > 0.0, 0.0, 0.07 * np.sin(0.05 * np.arange(600)))
    assert not prediction.standing_held(current, creeps, 0.2).any()


def test_a_free_run_begins_again_after_a_hole_with_measured_speeds():
    chosen, (current, speeds, signals) = MODELS["second order"], recording()
    current[50] = np.nan
    run = prediction.free_run(chosen, current, speeds, signals)
    assert np.isnan(run[:4]).all()  # delay and order of the drive
    assert np.isnan(run[52:55]).all()
    by_hand = prediction.free_run(chosen, current[51:], speeds[51:], {n: c[51:] for n, c in signals.items()})
    np.testing.assert_allclose(run[55:], by_hand[4:], rtol=1e-12)
    expected = 0.5 * speeds[3] + 0.2 * speeds[2] + 0.1
    expected += 4e-4 * current[2] + 3e-4 * current[1] + 2e-4 * current[0]
    assert run[4] == pytest.approx(expected)


def test_a_hole_in_the_speed_does_not_stop_a_free_run():
    chosen, (current, speeds, signals) = MODELS["linear"], recording()
    whole = prediction.free_run(chosen, current, speeds, signals)
    speeds[60:70] = np.nan
    np.testing.assert_array_equal(prediction.free_run(chosen, current, speeds, signals), whole)


def test_an_unstable_model_runs_away_without_a_warning():
    chosen = replace(MODELS["linear"], theta=(30.0, *MODELS["linear"].theta[1:]))
    current, speeds, signals = recording(400)
    assert not np.isfinite(prediction.free_run(chosen, current, speeds, signals)[-1])


def test_several_models_run_side_by_side():
    chosen, (current, speeds, signals) = MODELS["gears"], recording()
    other = chosen.with_theta(0.9 * np.array(chosen.theta))
    both = replace(chosen, theta=tuple(np.column_stack([chosen.theta, other.theta])))
    state = prediction.states_over(chosen, current, speeds, signals)
    runs = prediction.run_stepwise(both, state, current, speeds, signals, 2)
    for found, one in zip(runs.T, (chosen, other), strict=True):
        np.testing.assert_allclose(found, prediction.free_run(one, current, speeds, signals), rtol=1e-12)


@pytest.mark.parametrize("lag", [0, 1, 3, 200, -2])
def test_lags(lag):
    values = np.arange(100.0)
    expected = np.array([k - lag if 0 <= k - lag < 100 else np.nan for k in range(100)])
    np.testing.assert_array_equal(prediction.lagged(values, lag), expected)
    if lag >= 0:
        np.testing.assert_array_equal(prediction.lags(values, 0, 200)[lag], expected)


def test_runs():
    usable = np.array([1, 1, 0, 0, 1, 0, 1, 1], dtype=bool)
    assert prediction.runs(usable) == [slice(0, 2), slice(4, 5), slice(6, 8)]
    assert prediction.runs(np.zeros(4, dtype=bool)) == []
