"""Sandwich standard errors against what is known: white noise, coloured noise, stretches far apart."""

import numpy as np
import pytest

from cruise.identification.covariance import standard_errors
from tools.benchmarks.recovery import filtered


def mean_error(residual: np.ndarray, pieces=()) -> float:
    """The standard error of a mean."""
    count = len(residual)
    ones = np.ones((count, 1))
    return float(standard_errors(ones, residual - residual.mean(), np.array([[1.0 / count]]), pieces)[0])


def test_white_residuals_give_the_textbook_covariance():
    rng = np.random.default_rng(0)
    matrix, residual = rng.standard_normal((20_000, 3)), 0.3 * rng.standard_normal(20_000)
    inverse = np.linalg.inv(matrix.T @ matrix)
    found = standard_errors(matrix, residual, inverse)
    np.testing.assert_allclose(found, 0.3 * np.sqrt(np.diag(inverse)), rtol=0.03)


def test_residuals_that_grow_with_the_column_count_where_they_are_large():
    """Heteroscedastic: var(e) = x^2, so that cov = E x^4 / (N E^2 x^2) = 3 / N."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal(40_000)
    found = standard_errors(x[:, None], x * rng.standard_normal(40_000), np.array([[1.0 / (x @ x)]]))
    assert found[0] ** 2 == pytest.approx(3.0 / 40_000, rel=0.1)


@pytest.mark.parametrize("pole", [-0.5, 0.0, 0.5, 0.9])
def test_the_error_of_a_mean_of_coloured_noise(pole):
    """AR(1): std of the mean = sigma / (1 - pole) / sqrt(N); averaged over seeds."""
    found = []
    for seed in range(40):
        white = np.random.default_rng(seed).standard_normal(1200)
        found.append(mean_error(filtered([1.0], [1.0, -pole], white)[200:]))
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0 / (1.0 - pole) / np.sqrt(1000), rel=0.15)


def test_stretches_are_never_joined():
    """The end of one stretch and the beginning of the next are alike by chance of where the cut is, not by time."""
    rng = np.random.default_rng(2)
    level = rng.standard_normal(500)
    joined = np.repeat(level, 2)
    pieces = tuple(slice(k, k + 1) for k in range(1000))
    apart = mean_error(joined, pieces)
    assert apart == pytest.approx(joined.std() / np.sqrt(1000), rel=0.01)
    assert mean_error(joined) > 1.2 * apart


def test_a_variance_is_never_negative():
    """Few samples, many parameters, strong colour: where a flat top alone turns out negative for some seeds."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        matrix = np.column_stack([filtered([1.0], [1.0, -0.95], rng.standard_normal(80)) for _ in range(6)])
        residual = filtered([1.0], [1.0, -0.95], rng.standard_normal(80))
        residual = residual - matrix @ np.linalg.lstsq(matrix, residual)[0]
        assert (standard_errors(matrix, residual, np.linalg.inv(matrix.T @ matrix)) > 0.0).all()


def test_nearly_collinear_columns_keep_their_errors():
    """b and b + 1e-6 c: the errors are those of an exact transformation of b and c."""
    rng = np.random.default_rng(4)
    apart, residual = rng.standard_normal((2000, 2)), rng.standard_normal(2000)
    mixing = np.array([[1.0, 1.0], [0.0, 1e-6]])
    inverse = np.linalg.inv(mixing) @ np.linalg.inv(apart.T @ apart) @ np.linalg.inv(mixing).T
    found = standard_errors(apart @ mixing, residual, inverse)
    np.testing.assert_allclose(found[1], 1e6 * standard_errors(apart, residual, np.linalg.inv(apart.T @ apart))[1])


def test_a_perfect_fit_has_no_error():
    matrix = np.random.default_rng(3).standard_normal((50, 2))
    np.testing.assert_array_equal(standard_errors(matrix, np.zeros(50), np.eye(2)), 0.0)
