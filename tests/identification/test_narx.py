"""NARX: known polynomials come back, ridge is equation 7, and predictions are the recursion written by hand."""

import numpy as np
import pytest

from cruise.effects.engine_speed import EngineSpeed
from cruise.identification.least_squares import FitError
from cruise.identification.narx import GAMMAS, Narx, fit_narx
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.model.test_prediction import Drag
from tools.benchmarks.recovery import currents

EMPTY = Model(0.2, 1, 2, 1, (), (0.0,) * 4)
A, LINEAR, SQUARE, C_0 = 0.6, (0.05, 0.03), (0.01, 0.02), 0.3


def z_of(current: np.ndarray) -> np.ndarray:
    return (current - current.mean()) / (np.sqrt(2.0) * current.std())


def recorded(seed: int = 0, count: int = 600, noise_mps: float = 0.0, rpm=None) -> Recording:
    """y_k = 0.6 y + g sum_j (b_1j 2 z + b_2j (4 z^2 - 2))_(k-1-j) + 0.3 + e."""
    rng = np.random.default_rng(seed)
    current = currents(rng, count)
    z, gain = z_of(current), np.ones(count) if rpm is None else rpm / 2100.0
    y = np.full(count, 0.75)
    for k in range(2, count):
        drive = sum(LINEAR[j] * 2.0 * z[k - 1 - j] + SQUARE[j] * (4.0 * z[k - 1 - j] ** 2 - 2.0) for j in (0, 1))
        y[k] = A * y[k - 1] + gain[k] * drive + C_0 + noise_mps * rng.standard_normal()
    columns = {INPUT: current, OUTPUT: y} | ({} if rpm is None else {"engine_speed_rpm": rpm})
    return Recording(0.2 * np.arange(count), columns, 0.2, "narx")


def test_without_noise_the_truth_comes_back():
    found = fit_narx(EMPTY, 2, [recorded()], gamma=0.0)
    assert found.parameter_names == ("a_1", "h1_0_mps", "h1_1_mps", "h2_0_mps", "h2_1_mps", "c_0_mps")
    np.testing.assert_allclose(found.theta, (A, *LINEAR, *SQUARE, C_0), rtol=1e-6)
    assert found.poles == pytest.approx([A])


def test_gains_scale_the_polynomials():
    rpm = 1900.0 + 150.0 * np.sin(np.arange(600) / 30.0)
    structure = Model(0.2, 1, 2, 1, (EngineSpeed(1.0),), (0.0,) * 4)
    found = fit_narx(structure, 2, [recorded(rpm=rpm)], gamma=0.0)
    np.testing.assert_allclose(found.theta, (A, *LINEAR, *SQUARE, C_0), rtol=1e-6)


def test_with_noise_the_truth_lies_within_the_errors_and_no_higher_degree_is_found():
    found = fit_narx(EMPTY, 3, [recorded(1, noise_mps=0.02)], gamma=0.0)
    error = np.array(found.theta) - (A, *LINEAR, *SQUARE, 0.0, 0.0, C_0)
    assert (np.abs(error) < 3.5 * np.array(found.theta_std)).all()


def test_ridge_is_equation_7_of_scaled_columns_without_the_constant():
    one, gamma = recorded(2, noise_mps=0.05), 0.1
    found = fit_narx(EMPTY, 2, [one], gamma=gamma)
    y, z = one.output, z_of(one.input)
    hermite_1, hermite_2 = 2.0 * z, 4.0 * z**2 - 2.0
    k = np.arange(2, len(y))
    a = np.column_stack([y[k - 1], hermite_1[k - 1], hermite_1[k - 2], hermite_2[k - 1], hermite_2[k - 2]])
    mean, b = a.mean(axis=0), y[k] - y[k].mean()
    size = a.std(axis=0)
    scaled = (a - mean) / size
    theta = np.linalg.solve(scaled.T @ scaled / len(k) + gamma * np.eye(5), scaled.T @ b / len(k)) / size
    np.testing.assert_allclose(found.theta[:-1], theta, rtol=1e-9)
    assert found.theta[-1] == pytest.approx(y[k].mean() - mean @ theta)
    assert "given" in found.message


def test_an_endless_penalty_leaves_the_mean():
    one = recorded(3)
    found = fit_narx(EMPTY, 2, [one], gamma=1e12)
    np.testing.assert_allclose(found.ahead(one, 1)[3:], one.output[2:].mean(), rtol=1e-6)


@pytest.mark.parametrize("horizon", [1, 4])
def test_predictions_and_free_runs_are_the_recursion(horizon):
    one = recorded(4)
    found = fit_narx(EMPTY, 2, [one], gamma=0.0)
    noisy = Recording(one.time_s, {INPUT: one.input, OUTPUT: one.output + 0.1}, 0.2, "moved")
    ahead, z = found.ahead(noisy, horizon), z_of(one.input)
    start = 50
    speed = noisy.output[start]
    for k in range(start + 1, start + 1 + horizon):
        drive = sum(LINEAR[j] * 2.0 * z[k - 1 - j] + SQUARE[j] * (4.0 * z[k - 1 - j] ** 2 - 2.0) for j in (0, 1))
        speed = A * speed + drive + C_0
    assert ahead[start + horizon] == pytest.approx(speed, rel=1e-6)
    np.testing.assert_allclose(found.free_run(noisy)[100:], one.output[100:], rtol=1e-6)


def test_the_penalty_is_chosen_where_it_predicts_best_on_what_was_held_out():
    noisy = recorded(5, 200, noise_mps=0.3)
    found = fit_narx(EMPTY, 5, [noisy])
    assert found.gamma in GAMMAS
    assert "last quarter" in found.message
    fresh = recorded(6, 600)
    free = fit_narx(EMPTY, 5, [noisy], gamma=0.0)

    def error(narx: Narx) -> float:
        return float(np.nanmean((narx.ahead(fresh, 15) - fresh.output) ** 2))

    assert error(found) <= 1.05 * error(free)


def test_it_goes_through_the_filter():
    found = fit_narx(EMPTY, 2, [recorded(7, noise_mps=0.02)], smoother(PreparationSettings(), 0.2))
    assert found.unstable == ""
    assert np.isfinite(found.theta_std).all()


@pytest.mark.parametrize(
    ("model", "degree", "gamma", "says"),
    [
        (EMPTY, 0, None, "degree=0"),
        (Model(0.2, 1, 0, 0, (), (0.0,) * 2), 2, None, "nb=0"),
        (EMPTY, 2, -1.0, "gamma=-1"),
        (Model(0.2, 1, 1, 0, (Drag(),), (0.0,) * 4), 2, None, "reads the speed"),
    ],
)
def test_what_can_not_be_is_refused(model, degree, gamma, says):
    with pytest.raises(FitError, match=says):
        fit_narx(model, degree, [recorded()], gamma=gamma)


def test_a_constant_current_is_refused():
    one = recorded()
    still = Recording(one.time_s, {INPUT: np.full(600, 500.0), OUTPUT: one.output}, 0.2, "still")
    with pytest.raises(FitError, match="500 mA throughout"):
        fit_narx(EMPTY, 2, [still])


def test_no_recording_is_refused():
    with pytest.raises(FitError, match="no recording"):
        fit_narx(EMPTY, 2, [])
