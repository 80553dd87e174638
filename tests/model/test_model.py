"""The model's recursion against the equation written out by hand, and its views against each other."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from cruise.effects import Effect, Parameter, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model
from cruise.model.prediction import ahead, lagged, states_over

EFFECTS = (DeadZone(380.0), QuadraticGain(0.6), EngineSpeed(1.0), GearRatio(1.4, 2.5, 4.4, 7.8))
THETA = (0.6, 0.1, 4e-4, 3e-4, 2e-4, -0.03)
MODEL = Model(0.2, 2, 3, 2, EFFECTS, THETA)


@dataclass(frozen=True)
class Slow(Effect):
    """A command effect with a memory, for these tests only: a first-order lag."""

    name = "slow"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {"share": Parameter("-", 0, 1, 1, "of the way in one sample")}

    share: float = 0.5

    def start(self, like):
        return like * 0.0

    def step(self, value, past_speed, signals, state, dt_s):
        state = state + self.share * (value - state)
        return state, state


@dataclass(frozen=True)
class Grade(Effect):
    """A load effect, for these tests only."""

    name = "grade"
    stage = Stage.LOAD
    needs = ("pitch_deg",)
    reads_speed = True
    parameters: ClassVar = {}

    def step(self, value, past_speed, signals, state, dt_s):
        return signals["pitch_deg"] * 0.1 + 0.01 * past_speed, state


def course(count=80, seed=5):
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(400, 1000, count // 8 + 1), 8)[:count]
    signals = {
        "engine_speed_rpm": 1900 + 100 * np.sin(np.arange(count) / 9.0),
        "gear": np.where(np.arange(count) < count // 2, 2.0, 3.0),
        "pitch_deg": 3 * np.sin(np.arange(count) / 14.0),
    }
    return current, signals


def simulate(model, current, signals, first=0.4):
    now = {name: float(column[0]) for name, column in signals.items()}
    state = model.start(first, float(current[0]), now)
    speeds = []
    for k, value in enumerate(current):
        now = {name: float(column[k]) for name, column in signals.items()}
        state = model.apply(state, float(value), now)
        speed = model.next_speed(state)
        state = model.observe(state, speed)
        speeds.append(speed)
    return np.array(speeds)


def test_the_recursion_is_the_equation_of_the_paper():
    current, signals = course()
    speeds = simulate(MODEL, current, signals)
    beyond = np.maximum(current - 380.0, 0.0)
    drive = beyond * (1 + 0.6 * beyond / 1000.0)
    k = 60  # in third gear
    gain = signals["engine_speed_rpm"][k] / 2100.0 * 4.4 / 2.5
    alpha = (2.5 / 4.4) ** 2
    a1, a2, b0, b1, b2, c0 = THETA
    inner = a1 * speeds[k - 1] + a2 * speeds[k - 2]
    inner += gain * (b0 * drive[k - 2] + b1 * drive[k - 3] + b2 * drive[k - 4]) + c0
    assert speeds[k] == pytest.approx(alpha * inner + (1 - alpha) * speeds[k - 1], rel=1e-12)


@pytest.mark.parametrize("extra", [(), (Slow(0.5),), (Grade(),), (Slow(0.3), Grade())])
def test_predicting_from_every_sample_equals_predicting_from_one(extra):
    theta = (*THETA[:-1], *([0.02] if any(e.acts_as is Stage.LOAD for e in extra) else []), THETA[-1])
    model = Model(0.2, 2, 3, 2, (*extra, *EFFECTS), theta)
    current, signals = course()
    speeds = simulate(model, current, signals) + 0.05 * np.random.default_rng(1).standard_normal(len(current))
    horizon = 7
    whole = ahead(model, current, speeds, signals, horizon)
    now = {name: float(column[0]) for name, column in signals.items()}
    state = model.start(float(speeds[0]), float(current[0]), now)
    if extra and isinstance(extra[0], Slow):  # the recording begins with the lag at rest, not settled
        state = state._replace(effects=tuple(effect.start(0.0) for effect in model.effects))
    for k in range(len(current) - horizon):
        now = [{name: float(column[i]) for name, column in signals.items()} for i in range(k, k + horizon + 1)]
        state = model.advance(state, float(current[k]), float(speeds[k]), now[0])
        predicted = model.predict(state, [float(u) for u in current[k + 1 : k + 1 + horizon]], now[1:])
        if k >= 5:
            assert whole[k + horizon] == pytest.approx(predicted[-1], rel=1e-9)


def test_the_controllers_view_predicts_what_the_model_does():
    current, signals = course()
    speeds = simulate(MODEL, current, signals)
    now = {name: float(column[50]) for name, column in signals.items()}
    state = MODEL.start(float(speeds[0]), float(current[0]), {n: float(c[0]) for n, c in signals.items()})
    for k in range(51):
        state = MODEL.advance(
            state, float(current[k]), float(speeds[k]), {name: float(c[k]) for name, c in signals.items()}
        )
    coming = [500.0, 600.0, 900.0, 700.0, 420.0, 380.0, 800.0, 800.0]
    predicted = MODEL.predict(state, coming, [now] * len(coming))
    response = MODEL.linearise(state, now)
    drives = [MODEL.drive_for(value, state, now) for value in coming]
    free = response.free(state.speeds, state.drives, 0.0, len(coming))
    np.testing.assert_allclose(free + response.forced(len(coming)) @ drives, predicted, rtol=1e-10)


def test_current_for_undoes_drive_for_and_opens_at_zero():
    state = MODEL.start(0.0, 0.0, {"engine_speed_rpm": 2100.0, "gear": 2.0})
    for current in (390.0, 600.0, 1100.0, -700.0):
        inverse = MODEL.current_for(MODEL.drive_for(current, state, {}), state, {})
        assert (inverse.low, inverse.high) == pytest.approx((current, current))
    assert MODEL.current_for(0.0, state, {}).nearest(100.0) == 100.0


def test_dc_gain_is_where_a_constant_drive_ends():
    response = MODEL.linearise(
        MODEL.start(0.0, 0.0, {"engine_speed_rpm": 2100.0, "gear": 4.0}), {"engine_speed_rpm": 2100.0, "gear": 4.0}
    )
    speeds = response.free((0.0, 0.0), [0.0] * 5, 0.0, 2000) + response.forced(2000) @ np.full(2000, 100.0)
    assert speeds[-1] == pytest.approx(
        100.0 * response.dc_gain + response.offset_mps / (1 - sum(response.speed_coefficients))
    )


def test_a_missing_signal_is_named():
    assert MODEL.missing(["gear"]) == ("engine_speed_rpm",)
    assert not MODEL.usable({"gear": 2.0, "engine_speed_rpm": math.nan})
    assert MODEL.usable({"gear": 2.0, "engine_speed_rpm": 2000.0})


@pytest.mark.parametrize("wrong", [{"nb": 0}, {"delay": -1}, {"period_s": 0.0}, {"theta": (1.0,)}])
def test_an_impossible_structure_is_refused(wrong):
    fields = {"period_s": 0.2, "na": 2, "nb": 3, "delay": 2, "effects": (), "theta": THETA} | wrong
    with pytest.raises(ValueError, match=r"structure|parameters"):
        Model(**fields)


def test_lagged():
    values = np.arange(4.0)
    np.testing.assert_array_equal(lagged(values, 1), [np.nan, 0, 1, 2])
    np.testing.assert_array_equal(lagged(values, -1), [1, 2, 3, np.nan])
    np.testing.assert_array_equal(lagged(values, 0), values)


def test_a_hole_in_a_recording_is_no_start():
    current, signals = course()
    speeds = simulate(MODEL, current, signals)
    current[30] = np.nan
    state = states_over(MODEL, current, speeds, signals)
    predicted = MODEL.next_speed(state)
    assert np.isnan(predicted[32:35]).all()
    assert np.isfinite(predicted[35:]).all()
