"""The test of whiteness: right as often as it claims on white noise, and a known colour is found."""

import numpy as np
import pytest
from scipy import stats

from cruise.identification.whiteness import LAGS, whiteness
from tools.benchmarks.recovery import filtered

SEEDS = 400


def test_white_noise_fails_in_one_of_twenty():
    found = [whiteness([np.random.default_rng(seed).standard_normal(600)]) for seed in range(SEEDS)]
    p = np.array([one.p_value for one in found])
    # 400 draws: 5 % +- 1.1 %
    assert 0.02 < np.mean(p < 0.05) < 0.085
    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert np.mean([one.outside_pct for one in found]) == pytest.approx(5.0, abs=0.8)
    assert found[0].bound == pytest.approx(1.96 / np.sqrt(600), rel=1e-3)


def test_what_a_fit_has_fed_back_is_taken_from_the_degrees_of_freedom():
    p = []
    for seed in range(SEEDS):
        y = filtered([1.0], [1.0, -1.2, 0.5], np.random.default_rng(seed).standard_normal(800))[200:]
        columns = np.column_stack([y[1:-1], y[:-2]])
        residual = y[2:] - columns @ np.linalg.lstsq(columns, y[2:])[0]
        p.append([whiteness([residual], fed_back).p_value for fed_back in (0, 2)])
    without, right = np.mean(np.array(p) < 0.05, axis=0)
    assert 0.02 < right < 0.085
    assert without < right


def test_a_first_order_colour_has_its_autocorrelations():
    noise = np.random.default_rng(1).standard_normal(200_000)
    found = whiteness([filtered([1.0], [1.0, -0.8], noise)])
    np.testing.assert_allclose(found.autocorrelation, 0.8 ** np.arange(1, LAGS + 1), atol=0.02)
    assert found.largest == pytest.approx(0.8, abs=0.01)
    assert found.p_value < 1e-9
    assert found.outside_pct > 60.0
    assert whiteness([filtered([1.0], [1.0, 0.8], noise)]).largest == pytest.approx(0.8, abs=0.01)


def test_the_statistic_is_ljung_s_and_box_s():
    residual = np.random.default_rng(2).standard_normal(100)
    centred = residual - residual.mean()
    r = [centred[m:] @ centred[:-m] / (centred @ centred) for m in range(1, LAGS + 1)]
    q = 100 * 102 * sum(value**2 / (100 - m) for m, value in enumerate(r, 1))
    found = whiteness([residual], 3)
    assert found.q == pytest.approx(q)
    assert found.p_value == pytest.approx(stats.chi2.sf(q, LAGS - 3))


def test_recordings_are_never_joined_and_each_has_its_mean():
    one, other = np.random.default_rng(3).standard_normal((2, 300))
    both, apart = whiteness([one, other + 50.0]), [part - part.mean() for part in (one, other)]
    power = sum(part @ part for part in apart)
    expected = [sum(part[m:] @ part[:-m] for part in apart) / power for m in range(1, LAGS + 1)]
    np.testing.assert_allclose(both.autocorrelation, expected)


def test_what_was_not_measured_is_no_residual():
    residual = np.random.default_rng(4).standard_normal(500)
    holed = residual.copy()
    holed[:100] = np.nan
    np.testing.assert_allclose(whiteness([holed]).autocorrelation, whiteness([residual[100:]]).autocorrelation)
    assert whiteness([holed]).bound == pytest.approx(whiteness([residual[100:]]).bound)


@pytest.mark.parametrize("residuals", [[], [np.full(200, np.nan)], [np.ones(200)], [np.arange(2.0 * LAGS)]])
def test_too_little_says_nothing(residuals):
    found = whiteness(residuals)
    assert np.isnan([found.largest, found.bound, found.outside_pct, found.q, found.p_value]).all()
    assert found.autocorrelation.shape == (LAGS,)
