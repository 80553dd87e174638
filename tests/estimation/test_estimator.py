"""The estimator recovers a known truth, follows it when it changes, and is not fooled when nothing can be learned."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from cruise.estimation.estimator import Estimator, EstimatorSettings
from cruise.estimation.gate import Gate, GateKeeper, GateSettings
from cruise.estimation.supervision import SupervisionSettings
from cruise.model.prediction import ahead, states_over
from cruise.signals import Sample
from tests.estimation.conftest import TRUE, Machine, columns, steps

HORIZON = 15  # 3 s


def learn(estimator, samples):
    return [estimator.learn(sample) for sample in samples]


def error_ahead(model, samples):
    currents, speeds, signals = columns(samples)
    return float(np.sqrt(np.nanmean((ahead(model, currents, speeds, signals, HORIZON) - speeds) ** 2)))


def batch(model, samples):
    """Ordinary least squares, here by hand: identification has its own tests."""
    currents, speeds, signals = columns(samples)
    regressors, offset = model.regression(states_over(model, currents, speeds, signals))
    matrix = np.column_stack([np.broadcast_to(column, len(speeds)) for column in regressors])
    usable = np.isfinite(matrix).all(axis=1)
    return model.with_theta(np.linalg.lstsq(matrix[usable], (speeds - offset)[usable])[0])


@pytest.mark.parametrize("seed", range(6))
def test_after_60_s_it_predicts_as_well_as_batch_least_squares(factory, machine, seed):
    estimator = Estimator(factory, EstimatorSettings())
    taught = machine.drive(steps(60, seed), seed)
    learn(estimator, taught)
    unseen = machine.drive(steps(120, seed + 100), seed + 100)
    online, offline = error_ahead(estimator.snapshot(), unseen), error_ahead(batch(factory, taught), unseen)
    assert online <= 1.05 * offline
    assert error_ahead(factory, unseen) > 5 * offline


def test_it_follows_a_changed_machine_within_30_s(factory, machine):
    changed = Machine((0.68, 3.3e-4, 3.0e-4, 1.6e-4, -0.06))
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, machine.drive(steps(150, 1), 1, later=changed, at=600))
    unseen = changed.drive(steps(120, 3), 3)
    best = error_ahead(factory.with_theta(changed.theta), unseen)
    stale = error_ahead(factory.with_theta(TRUE), unseen)
    assert stale > 3 * best
    assert error_ahead(estimator.snapshot(), unseen) < best + 0.25 * (stale - best)


def test_half_an_hour_of_constant_speed_teaches_nothing_and_forgets_nothing(factory, machine):
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, machine.drive(steps(120, 4), 4))
    before = estimator.snapshot()
    results = learn(estimator, machine.drive(np.full(9000, 800.0), 5, start=600))
    assert {result.gate for result in results[40:]} == {Gate.NO_EXCITATION}
    after = estimator.snapshot()
    np.testing.assert_allclose(after.theta, before.theta, rtol=0.15, atol=0.01)
    assert max(np.array(after.theta_std) / np.array(factory.theta_std)) <= 1.1


def test_a_hill_while_engaged_does_not_change_the_model(factory, machine):
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, machine.drive(steps(120, 6), 6))
    before = estimator.snapshot()
    hill = 0.05 * np.clip((np.arange(400) - 100) / 20, 0, 1)
    compensating = 800.0 + 120.0 * np.clip((np.arange(400) - 110) / 30, 0, 1)
    samples = machine.drive(compensating, 7, start=600, disturbance_mps=-hill, engaged=True, reference_mps=np.ones(400))
    results = learn(estimator, samples)
    assert results[-1].gate is Gate.NO_EXCITATION
    np.testing.assert_allclose(estimator.snapshot().theta, before.theta, rtol=0.03, atol=1e-5)


def test_while_engaged_the_offset_is_held_and_the_rest_learns(factory, machine):
    heavier = Machine((0.75, 3.4e-4, 2.9e-4, 1.2e-4, -0.25))
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, machine.drive(steps(120, 8), 8))
    offset = estimator.snapshot().theta[-1]
    currents = steps(180, 9, hold=25)
    gain = 1.15 * sum(TRUE[1:4]) / 0.25
    reference = np.repeat((currents[::25] - 380.0) * 1.3 * gain, 25)[: len(currents)]
    learn(estimator, heavier.drive(currents, 9, start=600, engaged=True, reference_mps=reference))
    learned = estimator.snapshot()
    assert learned.theta[-1] == offset
    true_gain = sum(heavier.theta[1:4]) / (1 - heavier.theta[0])
    assert learned.dc_gain_mps_per_ma == pytest.approx(true_gain, rel=0.05)


def test_predicting_never_learns(factory, machine):
    samples = machine.drive(steps(20, 1), 1)
    estimator = Estimator(factory, EstimatorSettings())
    assert math.isnan(estimator.predict(samples[0]))
    learn(estimator, samples[:50])
    saved = estimator.save()
    first = estimator.predict(samples[50])
    assert estimator.predict(samples[50]) == first
    assert estimator.save() == saved
    assert estimator.learn(samples[50]).predicted_mps == pytest.approx(first)


def test_a_restored_estimator_goes_on_as_if_nothing_had_happened(factory, machine):
    samples = machine.drive(steps(80, 2), 2)
    one, other = Estimator(factory, EstimatorSettings()), Estimator(factory, EstimatorSettings())
    learn(one, samples[:200])
    other.restore(one.save())
    np.testing.assert_array_equal(one.snapshot().theta, other.snapshot().theta)
    np.testing.assert_allclose(one.snapshot().theta_std, other.snapshot().theta_std)
    learn(other, samples[200:])
    assert error_ahead(other.snapshot(), samples) == pytest.approx(
        error_ahead(factory.with_theta(TRUE), samples), rel=0.1
    )


def test_an_estimator_that_forgets_is_as_new(factory, machine):
    samples = machine.drive(steps(80, 2), 2)
    one, other = Estimator(factory, EstimatorSettings()), Estimator(factory, EstimatorSettings())
    learn(one, [replace(sample, speed_mps=1.5 * sample.speed_mps) for sample in samples[:200]])
    one.forget()
    learn(one, samples[200:400])
    learn(other, samples[200:400])
    assert one.snapshot() == other.snapshot()


@pytest.mark.parametrize(
    ("broken", "says"),
    [
        ({"theta": [0.5, 1e-4]}, "this model has 5"),
        ({"theta": [0.5, math.nan, 1e-4, 1e-4, 0.0]}, "stable drive"),
        ({"theta": [1.2, 1e-4, 1e-4, 1e-4, 0.0]}, "stable drive"),
        ({"theta": [0.5, -1e-4, -1e-4, 1e-4, 0.0]}, "stable drive"),
    ],
)
def test_saved_nonsense_is_refused(factory, broken, says):
    estimator = Estimator(factory, EstimatorSettings())
    with pytest.raises(ValueError, match=says):
        estimator.restore(estimator.save() | broken)


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (EstimatorSettings, "pole_max", 1.0),
        (EstimatorSettings, "gain_range", 0.9),
        (EstimatorSettings, "gain_range", 100.0),
        (GateSettings, "excitation_s", 1e9),
        (SupervisionSettings, "horizon_s", 3600.0),
    ],
)
def test_a_setting_beyond_what_it_can_mean_is_refused(kind, name, value):
    """A pole on the unit circle, a range that holds nothing or everything, memory and time without end."""
    with pytest.raises(msgspec.ValidationError, match=name):
        msgspec.convert({name: value}, kind)


GOOD = {"engine_speed_rpm": 2000.0, "gear": 2.0}


@pytest.mark.parametrize(
    ("fields", "gate"),
    [
        ({"current_ma": math.nan}, Gate.STALE_SIGNAL),
        ({"speed_mps": math.nan}, Gate.STALE_SIGNAL),
        ({"signals": GOOD | {"engine_speed_rpm": math.nan}}, Gate.STALE_SIGNAL),
        ({"signals": {"gear": 2.0}}, Gate.STALE_SIGNAL),
        ({"overridden": True}, Gate.OVERRIDDEN),
        ({"signals": GOOD | {"gear": 3.0}}, Gate.GEAR_CHANGE),
        ({"signals": GOOD | {"gear": 0.0}}, Gate.NEUTRAL),
        ({"signals": GOOD | {"gear": -1.0}}, Gate.NEUTRAL),
        ({"speed_mps": 0.01}, Gate.STANDING_STILL),
        ({"current_ma": 1190.0}, Gate.SATURATED),
        ({"speed_mps": 4.0}, Gate.IMPLAUSIBLE),
        ({}, Gate.OPEN),
    ],
)
def test_the_gate_says_why_a_sample_may_not_teach(factory, machine, fields, gate):
    samples = machine.drive(steps(40, 3), 3)
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, samples[:150])
    before = estimator.save()
    result = estimator.learn(replace(samples[150], **fields))
    assert result.gate is gate
    assert (estimator.save() == before) == (gate is not Gate.OPEN)


def test_a_gear_that_is_not_known_during_the_shift_hides_no_shift():
    """For a model without gears: one with them has a hole there."""
    keeper = GateKeeper(GateSettings(), 0.2)
    gates = {}
    for k in range(50):
        time_s = 0.2 * k
        gear = 2.0 if time_s < 5.0 else 3.0 if time_s > 5.9 else math.nan
        sample = Sample(time_s, 700.0, 1.0, {"gear": gear})
        gates[k] = keeper.judge(sample, 1.0 + 0.1 * math.sin(time_s))
    assert gates[24] is Gate.OPEN
    assert gates[30] is gates[43] is Gate.GEAR_CHANGE
    assert gates[46] is Gate.OPEN


def test_a_reference_that_gives_way_to_the_machine_excites_nothing():
    """It follows the speed then, and so does the current; what it did before counts for nothing afterwards either."""
    keeper = GateKeeper(GateSettings(), 0.2)
    gates = []
    for k in range(150):
        asked_mps = math.nan if 50 <= k < 100 else 1.0 if k < 30 else 1.5
        sample = Sample(0.2 * k, 700.0, 1.5 - 0.005 * k, {"gear": 2.0}, reference_mps=asked_mps, engaged=True)
        gates.append(keeper.judge(sample, 1.0))
    assert gates[32] is Gate.OPEN
    assert set(gates[50:]) == {Gate.NO_EXCITATION}


def test_after_a_hole_it_warms_up_again(factory, machine):
    samples = machine.drive(steps(40, 3), 3)
    estimator = Estimator(factory, EstimatorSettings())
    learn(estimator, samples[:100])
    late = [replace(sample, time_s=sample.time_s + 5.0) for sample in samples[100:]]
    assert [estimator.learn(sample).gate for sample in late[:10]] == [Gate.WARMING_UP] * 10


@pytest.mark.parametrize("kind", ["flat", "wild", "inverted"])
def test_nonsense_never_leaves_the_safe_set(factory, machine, kind):
    estimator = Estimator(factory, EstimatorSettings())
    samples = machine.drive(steps(300, 7), 7)
    rng = np.random.default_rng(0)
    for sample in samples:
        lie = {"flat": 1.0, "wild": float(rng.uniform(0.2, 3)), "inverted": 3.0 - sample.speed_mps}[kind]
        estimator.learn(replace(sample, speed_mps=lie))
        model = estimator.snapshot()
        assert abs(model.poles[0]) <= 0.99
        assert 1 / 3 <= model.dc_gain_mps_per_ma / factory.dc_gain_mps_per_ma <= 3
        assert np.isfinite(model.theta_std).all()
