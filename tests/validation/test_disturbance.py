"""An autoregression is found in a residual with holes, and whitening takes it away without crossing recordings."""

import numpy as np
import pytest
from scipy import signal

from cruise.validation.disturbance import ORDER, Disturbance, disturbance_of

TRUE = (0.9, -0.3, 0.15, -0.1)


def coloured(samples: int = 6000, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A residual (N,) and the white noise behind it."""
    white = np.random.default_rng(seed).standard_normal(samples)
    return np.asarray(signal.lfilter([1.0], [1.0, *(-f for f in TRUE)], white)), white


def correlations(values: np.ndarray, last: int) -> np.ndarray:
    known = values[np.isfinite(values)]
    return np.array([np.corrcoef(known[lag:], known[:-lag])[0, 1] for lag in range(1, last + 1)])


def test_the_autoregression_is_found_and_whitens():
    residual, white = coloured()
    found = disturbance_of(residual, (0,))
    assert len(found.coefficients) == ORDER
    assert found.coefficients == pytest.approx(TRUE, abs=4.0 / np.sqrt(len(residual)))
    whitened = found.whiten(residual)
    assert np.abs(correlations(residual, 1))[0] > 0.6
    assert np.max(np.abs(correlations(whitened, 10))) < 4.0 / np.sqrt(len(residual))
    exact = Disturbance(TRUE, (0,)).whiten(residual)
    assert exact[ORDER:] == pytest.approx(white[ORDER:], abs=1e-9)


def test_of_white_noise_nothing_is_foretold():
    white = np.random.default_rng(2).standard_normal(5000)
    assert disturbance_of(white, (0,)).coefficients == pytest.approx((0.0,) * ORDER, abs=4.0 / np.sqrt(5000))


def test_no_recording_foretells_the_next_one():
    first, second = coloured(seed=1)[0], 40.0 + coloured(seed=2)[0]
    starts = (0, len(first))
    joined = np.concatenate([first, second])
    whitened = Disturbance(TRUE, starts).whiten(joined)
    unknown = np.flatnonzero(np.isnan(whitened))
    np.testing.assert_array_equal(unknown, [*range(ORDER), *range(len(first), len(first) + ORDER)])
    alone = Disturbance(TRUE, (0,)).whiten(second)
    assert whitened[len(first) + ORDER :] == pytest.approx(alone[ORDER:], abs=1e-12)


def test_learning_does_not_look_over_the_start_of_a_recording():
    """Short recordings, each with a level that nothing before foretells."""
    rng = np.random.default_rng(5)
    white = 0.1 * rng.standard_normal((200, 10))
    levels = rng.choice([-5.0, 5.0], (200, 1))
    residual = (white + levels).ravel()
    starts = tuple(range(0, 2000, 10))
    assert sum(disturbance_of(residual, starts).coefficients) == pytest.approx(1.0, abs=0.01)
    assert sum(disturbance_of(residual, (0,)).coefficients) < 0.95


def test_a_hole_is_a_hole_for_as_long_as_it_would_foretell():
    residual, _ = coloured()
    holed = residual.copy()
    holed[1000] = np.nan
    whitened = Disturbance(TRUE, (0,)).whiten(holed)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(whitened)), [*range(ORDER), *range(1000, 1001 + ORDER)])
    poor = np.where(np.random.default_rng(3).uniform(size=6000) < 0.05, np.nan, residual)
    assert disturbance_of(poor, (0,)).coefficients == pytest.approx(TRUE, abs=0.08)


def test_rows_are_whitened_as_each_alone():
    rows = np.array([coloured(300, seed)[0] for seed in range(3)])
    found = Disturbance(TRUE, (0, 100))
    kept = rows.copy()
    together = found.whiten(rows)
    np.testing.assert_array_equal(together, [found.whiten(row) for row in rows])
    np.testing.assert_array_equal(rows, kept)
    assert found.whiten(rows[0]).shape == (300,)


def test_too_little_is_taken_to_be_white():
    residual, _ = coloured(60)
    found = disturbance_of(residual, (0,))
    assert found == Disturbance((), (0,))
    np.testing.assert_array_equal(found.whiten(residual), residual)
