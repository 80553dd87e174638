"""ARMAX: the noise model comes back, and predictions carry innovations as far as they reach."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.armax import Armax, _lagged, fit_armax
from cruise.identification.arx import fit_arx
from cruise.identification.least_squares import FitError
from cruise.identification.prediction_error import reflected, search
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.identification.truth import STROKE_SHARE, STROKED, STROKED_MODEL, stroked
from tools.benchmarks.recovery import SYSTEMS, currents, filtered, recording

TRUTH = SYSTEMS["armax"].truth
EMPTY = Model(0.2, 2, 2, 2, (), (0.0,) * 5)
KNOWN = Armax(EMPTY.with_theta(TRUTH[:5]), "", noise=(0.6, -0.2))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def test_it_finds_the_minimum_that_arx_misses():
    one = SYSTEMS["armax"].record(0)
    found, plain = fit_armax(EMPTY, 1, [one]), fit_arx(EMPTY, [one])
    assert found.converged
    assert "2 of 2 starts in this minimum" in found.message
    assert found.residual_std_mps == pytest.approx(0.03, rel=0.1)
    assert abs(found.theta[0] - TRUTH[0]) < 3.0 * found.theta_std[0]
    assert abs(plain.theta[0] - TRUTH[0]) > 5.0 * plain.theta_std[0]  # biased by the noise's colour
    assert found.residual_std_mps < 0.95 * plain.residual_std_mps


def test_no_step_in_any_direction_makes_the_error_less():
    one = SYSTEMS["armax"].record(1)
    found = fit_armax(EMPTY, 2, [one])

    def power(theta: np.ndarray) -> float:
        moved = replace(found, model=found.model.with_theta(theta[:5]), noise=tuple(theta[5:].tolist()))
        innovation = moved.innovations(one)
        return float(np.nansum(innovation**2))

    best, size = power(np.array(found.theta)), np.array(found.theta_std)
    for i, std in enumerate(size):
        for sign in (-0.3, 0.3):
            moved = np.array(found.theta)
            moved[i] += sign * std
            assert power(moved) > best


def test_its_errors_are_those_of_the_gradient_found_by_differences():
    """Innovations are white here: cov = s^2 (psi' psi)^-1."""
    one = SYSTEMS["armax"].record(1)
    found = fit_armax(EMPTY, 2, [one])

    def innovations(theta: np.ndarray) -> np.ndarray:
        moved = replace(found, model=found.model.with_theta(theta[:5]), noise=tuple(theta[5:].tolist()))
        return moved.innovations(one)[3:]

    theta, step = np.array(found.theta), 1e-3 * np.array(found.theta_std)
    psi = np.column_stack(
        [
            (innovations(theta - move) - innovations(theta + move)) / (2.0 * size)
            for move, size in zip(np.diag(step), step, strict=True)
        ]
    )
    expected = found.residual_std_mps * np.sqrt(np.diag(np.linalg.inv(psi.T @ psi)))
    np.testing.assert_allclose(found.theta_std, expected, rtol=0.2)


def test_lags_stay_within_their_stretch():
    found = _lagged(np.arange(1.0, 7.0), 1, (slice(0, 3), slice(3, 6)))
    np.testing.assert_array_equal(found, [0.0, 1.0, 2.0, 0.0, 4.0, 5.0])


@pytest.mark.parametrize("horizon", [1, 2, 3, 8])
def test_predictions_carry_past_innovations_and_no_later_ones(horizon):
    one = SYSTEMS["armax"].record(2)[:60]
    y, u = one.output, one.input
    a_1, a_2, b_0, b_1, c_0 = TRUTH[:5]
    innovation = np.zeros(60)
    for k in range(3, 60):
        core = a_1 * y[k - 1] + a_2 * y[k - 2] + b_0 * u[k - 2] + b_1 * u[k - 3] + c_0
        innovation[k] = y[k] - core - 0.6 * innovation[k - 1] + 0.2 * innovation[k - 2]
    ahead = KNOWN.ahead(one, horizon)
    for start in (10, 30, 45):
        speeds, e = list(y[: start + 1]), [*innovation[: start + 1], *(0.0,) * horizon]
        for k in range(start + 1, start + 1 + horizon):
            speeds.append(a_1 * speeds[k - 1] + a_2 * speeds[k - 2] + b_0 * u[k - 2] + b_1 * u[k - 3] + c_0)
            speeds[k] += 0.6 * e[k - 1] - 0.2 * e[k - 2]
        assert ahead[start + horizon] == pytest.approx(speeds[-1], rel=1e-9)


def test_the_noise_model_pays_one_step_ahead_and_is_forgotten_far_ahead():
    one = SYSTEMS["armax"].record(3)
    without = replace(KNOWN, noise=())
    with_noise = replace(KNOWN, noise=(0.6,))
    assert rms(with_noise.ahead(one, 1) - one.output) < 0.9 * rms(without.ahead(one, 1) - one.output)
    np.testing.assert_allclose(with_noise.free_run(one), without.free_run(one))


def test_innovations_begin_again_after_a_hole():
    one = SYSTEMS["armax"].record(4)
    speed = one.output.copy()
    speed[300:305] = np.nan
    holed = Recording(one.time_s, {INPUT: one.input, OUTPUT: speed}, one.dt_s, "holed")
    innovation = KNOWN.innovations(holed)
    assert np.isnan(innovation[300:307]).all()
    np.testing.assert_allclose(innovation[310:], KNOWN.innovations(holed[304:])[6:], atol=1e-12)
    assert fit_armax(EMPTY, 1, [holed]).converged


def test_names_values_and_errors_go_together():
    found = fit_armax(EMPTY, 2, [SYSTEMS["armax"].record(5)])
    assert found.parameter_names[-3:] == ("c_0_mps", "noise_1", "noise_2")
    assert len(found.theta) == len(found.theta_std) == len(found.parameter_names) == 7


def test_a_noise_model_at_the_edge_is_said_to_be():
    """The difference of white noise has its root of C on the unit circle."""
    rng = np.random.default_rng(0)
    current, white = currents(rng, 800), rng.standard_normal(801)
    speed = filtered([0.0, 0.0, 3e-4, 2e-4], [1.0], current) + 0.03 * np.diff(white)
    found = fit_armax(Model(0.2, 0, 2, 2, (), (0.0,) * 3), 1, [recording(current, speed)])
    assert "edge" in found.message


def test_through_the_filter_it_goes_through_and_stays_invertible():
    found = fit_armax(EMPTY, 1, [SYSTEMS["armax"].record(6)], smoother(PreparationSettings(), 0.2))
    assert abs(found.noise[0]) < 1.0
    assert np.isfinite(found.theta_std).all()


def test_without_a_noise_model_it_is_refused():
    with pytest.raises(FitError, match="nc=0"):
        fit_armax(EMPTY, 0, [SYSTEMS["armax"].record(0)])


# -- the search


def test_a_search_that_runs_out_of_steps_or_into_the_edge_says_so():
    def edge(theta: np.ndarray) -> np.ndarray:
        return np.full(5, np.inf) if theta[0] >= 1.0 else np.full(5, 2.0 - theta[0])

    found = search([("zero", np.zeros(1))], edge, lambda theta: np.ones((5, 1)), 1.0)
    assert not found.converged
    assert found.message.startswith("not converged")
    assert found.theta[0] == pytest.approx(1.0, abs=1e-3)


def test_the_better_of_two_minima_is_taken_and_the_other_counted():
    """e = (x^2 - 1, 0.3 (x + 1)): minima near -1 (exact) and near 1."""

    def error(x: np.ndarray) -> np.ndarray:
        return np.array([x[0] ** 2 - 1.0, 0.3 * (x[0] + 1.0)])

    def gradient(x: np.ndarray) -> np.ndarray:
        return -np.array([[2.0 * x[0]], [0.3]])

    found = search([("right", np.array([2.0])), ("left", np.array([-2.0]))], error, gradient, 1.0)
    assert found.theta[0] == pytest.approx(-1.0, abs=1e-6)
    assert found.converged
    assert "1 of 2 starts in this minimum (best from left)" in found.message


def test_no_allowed_start_is_an_error():
    with pytest.raises(ValueError, match="no start"):
        search([("one", np.zeros(1))], lambda x: np.full(3, np.inf), lambda x: np.ones((3, 1)), 1.0)


def test_reflected_roots_keep_the_spectrum_and_come_inside():
    polynomial = np.array([1.0, -2.5, 1.0])  # roots 2 and 0.5
    np.testing.assert_allclose(np.sort(np.roots(reflected(polynomial))), [0.5, 0.5], atol=1e-6)
    assert np.abs(np.roots(reflected(np.array([1.0, -1.0])))).max() == pytest.approx(0.98)


@pytest.mark.parametrize("start", [STROKED, (0.0, 0.0, 0.0)])
def test_what_yields_with_the_stroke_comes_back(start):
    """Noise of what is measured alone is nearly C = A: a moving average takes it out of the drive's parameters."""
    found = fit_armax(STROKED_MODEL.with_theta(start), 1, [stroked(noise_mps=0.005)])
    assert found.model.stroke_share == STROKE_SHARE
    np.testing.assert_allclose(found.model.theta, STROKED, rtol=0.03)
