"""Output error: the simulation's truth comes back from any start, and by filter or stepwise alike."""

import numpy as np
import pytest

from cruise.effects.gear_ratio import GearRatio
from cruise.identification import output_error
from cruise.identification.arx import fit_arx
from cruise.identification.output_error import fit_output_error
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.identification.truth import STROKE_SHARE, STROKED, STROKED_MODEL, stroked
from tests.model.test_prediction import Drag
from tools.benchmarks.recovery import SYSTEMS, currents, filtered, recording

TRUTH = SYSTEMS["output_error"].truth
EMPTY = Model(0.2, 2, 2, 2, (), (0.0,) * 5)


def test_it_finds_the_minimum_that_arx_misses():
    one = SYSTEMS["output_error"].record(0)
    found, plain = fit_output_error(EMPTY, [one]), fit_arx(EMPTY, [one])
    assert found.converged
    assert "3 of 3 starts in this minimum" in found.message
    assert found.residual_std_mps == pytest.approx(0.03, rel=0.1)
    assert np.abs(np.array(found.theta) - TRUTH)[0] < 3.0 * found.theta_std[0]
    assert abs(plain.theta[0] - TRUTH[0]) > 5.0 * plain.theta_std[0]


def test_the_error_that_it_minimised_is_that_of_its_free_run():
    one = SYSTEMS["output_error"].record(1)
    found = fit_output_error(EMPTY, [one])
    error = found.free_run(one) - one.output
    used = error[np.isfinite(error)]
    assert np.sqrt(used @ used / (len(used) - 5)) == pytest.approx(found.residual_std_mps, rel=1e-6)
    np.testing.assert_array_equal(found.ahead(one, 15), found.free_run(one))


def test_no_step_in_any_direction_makes_the_error_less():
    one = SYSTEMS["output_error"].record(2)
    found = fit_output_error(EMPTY, [one])

    def power(theta: np.ndarray) -> float:
        run = output_error.OutputError(EMPTY.with_theta(theta), "").free_run(one)
        return float(np.nansum((run - one.output) ** 2))

    best = power(np.array(found.theta))
    for i, std in enumerate(found.theta_std):
        for sign in (-0.3, 0.3):
            moved = np.array(found.theta)
            moved[i] += sign * std
            assert power(moved) > best


@pytest.mark.parametrize("smoothed", [False, True])
def test_stepwise_is_the_same_as_by_filter(monkeypatch, smoothed):
    smooth = smoother(PreparationSettings(), 0.2) if smoothed else None
    parts = [SYSTEMS["output_error"].record(3)[:250], SYSTEMS["output_error"].record(4)[:200]]
    fast = fit_output_error(EMPTY, parts, smooth)
    monkeypatch.setattr(output_error, "_simple", lambda model, recordings: False)
    slow = fit_output_error(EMPTY, parts, smooth)
    assert fast.converged
    assert slow.converged
    # filtered, the two differ in where the filter meets the ends of a stretch
    apart = np.abs(np.subtract(slow.theta, fast.theta)) / fast.theta_std
    assert apart.max() < (0.5 if smoothed else 1e-3)
    np.testing.assert_allclose(slow.theta_std, fast.theta_std, rtol=0.5 if smoothed else 1e-3)


def test_gears_that_move_the_poles_come_back():
    rng = np.random.default_rng(6)
    current, count = currents(rng, 400), 400
    gear = np.where(np.arange(count) % 100 < 50, 2.0, 3.0)
    alpha, ratio = np.where(gear == 3.0, (2.5 / 4.4) ** 2, 1.0), np.where(gear == 3.0, 4.4 / 2.5, 1.0)
    w = np.zeros(count)
    for k in range(2, count):
        drive = ratio[k] * (4e-4 * current[k - 1] + 2e-4 * current[k - 2])
        w[k] = alpha[k] * (0.8 * w[k - 1] + drive - 0.1) + (1.0 - alpha[k]) * w[k - 1]
    columns = {INPUT: current, OUTPUT: w + 0.02 * rng.standard_normal(count), "gear": gear}
    one = Recording(0.2 * np.arange(count), columns, 0.2, "gears")
    found = fit_output_error(Model(0.2, 1, 2, 1, (GearRatio(1.4, 2.5, 4.4, 7.8),), (0.0,) * 4), [one])
    assert found.converged
    assert (np.abs(np.array(found.theta) - (0.8, 4e-4, 2e-4, -0.1)) < 3.0 * np.array(found.theta_std)).all()


@pytest.mark.parametrize("start", [STROKED, (0.0, 0.0, 0.0)])
def test_what_yields_with_the_stroke_comes_back(start):
    one = stroked(600, noise_mps=0.02)
    found = fit_output_error(STROKED_MODEL.with_theta(start), [one])
    assert found.converged
    assert found.model.stroke_share == STROKE_SHARE
    assert (np.abs(np.array(found.theta) - STROKED) < 3.0 * np.array(found.theta_std)).all()


def test_an_effect_that_reads_the_speed_reads_the_simulated_one():
    rng = np.random.default_rng(6)
    current = currents(rng, 300)
    w = np.zeros(300)
    for k in range(1, 300):
        w[k] = 0.8 * w[k - 1] + 5e-4 * current[k] - 0.03 * w[k - 1] ** 2 - 0.1
    noise = 0.03 * rng.standard_normal(300)
    noise[:2] = 0.0  # a machine that stands: the simulation begins at measured speeds
    one = recording(current, w + noise)
    found = fit_output_error(Model(0.2, 1, 1, 0, (Drag(),), (0.0,) * 4), [one])
    assert found.converged
    assert (np.abs(np.array(found.theta) - (0.8, 5e-4, -0.03, -0.1)) < 3.5 * np.array(found.theta_std)).all()
    with pytest.raises(ValueError, match="drag reads the speed"):
        found.free_run(one, smoother(PreparationSettings(), 0.2))


def test_without_recursion_it_is_least_squares():
    one = SYSTEMS["arx"].record(7)
    structure = Model(0.2, 0, 3, 2, (), (0.0,) * 4)
    assert fit_output_error(structure, [one]).theta == fit_arx(structure, [one]).theta


def test_a_truth_that_runs_away_leaves_a_stable_model_and_the_word_about_it():
    rng = np.random.default_rng(8)
    current = currents(rng, 300)
    one = recording(current, filtered([1e-5], [1.0, -1.01], current))
    found = fit_output_error(Model(0.2, 1, 1, 0, (), (0.0,) * 3), [one])
    assert np.abs(found.poles).max() < 1.0
    assert found.unstable == ""
    assert not found.converged
    assert "not converged" in found.message


def test_recordings_are_never_joined_and_holes_begin_again():
    parts = [SYSTEMS["output_error"].record(seed)[:200] for seed in (9, 10)]
    speed = parts[0].output.copy()
    speed[100:103] = np.nan
    parts[0] = Recording(parts[0].time_s, {INPUT: parts[0].input, OUTPUT: speed}, 0.2, "holed")
    found = fit_output_error(EMPTY, parts)
    assert found.converged
    assert (np.abs(np.array(found.theta) - TRUTH) < 3.5 * np.array(found.theta_std)).all()
