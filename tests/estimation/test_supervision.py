"""The running 3 s ahead errors are those of a free run, and only a model that proves itself takes over."""

import math

import numpy as np
import pytest

from cruise.estimation.supervision import AheadErrors, SupervisionSettings, Supervisor
from cruise.model.prediction import ahead
from tests.estimation.conftest import TRUE, columns, steps

SETTINGS = SupervisionSettings()
HORIZON = 15  # 3 s of 0.2 s


def judge(step, model, samples):
    """Hand every sample to `step` with the model's state before its speed; returns what `step` returned."""
    state = model.start(samples[0].speed_mps, samples[0].current_ma, samples[0].signals)
    returned = []
    for sample in samples:
        state = model.apply(state, sample.current_ma, sample.signals)
        returned.append(step(state, sample))
        state = model.observe(state, sample.speed_mps)
    return returned


def test_without_disturbance_the_error_is_that_of_a_free_run(factory, machine):
    settings = SupervisionSettings(disturbance_s=1e9, window_s=1e9)
    errors, samples = AheadErrors(0.2, settings), machine.drive(steps(20, 1), 1)
    squares, before = [], 0.0

    def step(state, sample):
        nonlocal before
        errors.step(state, sample, {"factory": factory})
        now = errors.mean_squares.get("factory", math.nan)
        # With an endless window the first square stays and each next one adds its share.
        squares.append((now - before) * settings.window_s / 0.2 + before if before else now)
        before = now if math.isfinite(now) else 0.0

    judge(step, factory, samples)
    currents, speeds, signals = columns(samples)
    predicted = ahead(factory, currents, speeds, signals, HORIZON)
    expected = (speeds - predicted) ** 2
    np.testing.assert_allclose(squares[HORIZON + 6 :], expected[HORIZON + 6 :], rtol=1e-3, atol=1e-5)


def test_persistence_is_the_speed_three_seconds_ago(factory, machine):
    errors, samples = AheadErrors(0.2, SETTINGS), machine.drive(steps(20, 2), 2)
    judge(lambda state, sample: errors.step(state, sample, {"factory": factory}), factory, samples[: HORIZON + 1])
    assert errors.rms_mps("persistence") == pytest.approx(abs(samples[HORIZON].speed_mps - samples[0].speed_mps))
    assert math.isnan(AheadErrors(0.2, SETTINGS).rms_mps("persistence"))


def test_a_disturbance_that_was_known_three_seconds_ago_is_no_error(factory, machine):
    true = factory.with_theta(TRUE)
    samples = machine.drive(steps(60, 3), 3, disturbance_mps=-0.05)
    errors = AheadErrors(0.2, SupervisionSettings(window_s=5.0))  # so that the start, when it was unknown, has passed
    judge(lambda state, sample: errors.step(state, sample, {"true": true}), true, samples)
    assert errors.rms_mps("true") < 0.03
    blind = AheadErrors(0.2, SupervisionSettings(window_s=5.0, disturbance_s=1e9))
    judge(lambda state, sample: blind.step(state, sample, {"true": true}), true, samples)
    assert blind.rms_mps("true") > 0.15


def test_a_better_model_takes_over_after_its_proof_and_a_worse_one_never(factory, machine):
    samples = machine.drive(steps(60, 4), 4)
    better, worse = factory.with_theta(TRUE), factory.with_theta((0.9, 6e-4, 6e-4, 6e-4, 0.1))
    supervisor = Supervisor(factory, SETTINGS)
    adopted = judge(lambda state, sample: supervisor.step(state, sample, better), factory, samples)
    first = next(k for k, model in enumerate(adopted) if model is not None)
    assert adopted[first] is better
    assert supervisor.driving is better
    assert supervisor.adoptions == 1
    assert (first + 1) * 0.2 >= SETTINGS.proof_s
    supervisor = Supervisor(factory, SETTINGS)
    assert not any(judge(lambda state, sample: supervisor.step(state, sample, worse), factory, samples))
    assert supervisor.driving is factory


def test_a_hole_takes_the_proof_away_but_not_the_errors(factory, machine):
    supervisor, samples = Supervisor(factory, SETTINGS), machine.drive(steps(30, 5), 5)
    judge(lambda state, sample: supervisor.step(state, sample, factory), factory, samples)
    known = supervisor.errors.rms_mps("factory")
    supervisor.errors.restart()
    assert supervisor.errors.judged_s == 0.0
    assert supervisor.errors.rms_mps("factory") == known
    judge(lambda state, sample: supervisor.step(state, sample, factory), factory, samples[: HORIZON - 1])
    assert supervisor.errors.judged_s == 0.0
