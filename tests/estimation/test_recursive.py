"""Recursive least squares against its definition in batch form, and what forgetting may not do."""

import numpy as np
import pytest

from cruise.estimation.recursive import SquareRootRls

STD = np.array([0.5, 1.0, 0.2])
PRIOR = np.array([0.1, -0.2, 0.3])


def data(count=200, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((count, 3)) * [1.0, 0.3, 2.0]
    return x, x @ [0.7, 0.4, -0.1] + 0.05 * rng.standard_normal(count)


def run(rls, x, y, forgetting):
    for row, value in zip(x, y, strict=True):
        rls.update(row[: rls.free], float(value - row @ rls.theta), forgetting)


def test_without_forgetting_it_is_the_regularised_batch_solution():
    x, y = data()
    rls = SquareRootRls(PRIOR, STD, 0.05)
    run(rls, x, y, 1.0)
    information = x.T @ x / 0.05**2 + np.diag(STD**-2)
    expected = np.linalg.solve(information, x.T @ y / 0.05**2 + PRIOR / STD**2)
    np.testing.assert_allclose(rls.theta, expected, rtol=1e-8)
    np.testing.assert_allclose(rls.root @ rls.root.T, np.linalg.inv(information), rtol=1e-6, atol=1e-12)


def test_forgetting_weights_the_past_and_feeds_the_prior_in_again():
    x, y = data()
    forgetting = 0.98
    rls = SquareRootRls(PRIOR, STD, 0.05)
    run(rls, x, y, forgetting)
    information, vector, turn = np.diag(STD**-2), PRIOR / STD**2, 0
    for row, value in zip(x, y, strict=True):
        information = forgetting * (information + np.outer(row, row) / 0.05**2)
        vector = forgetting * (vector + row * value / 0.05**2)
        turn = (turn + 1) % 3
        pull = 3 * (1 - forgetting) / STD[turn] ** 2
        information[turn, turn] += pull
        vector[turn] += pull * PRIOR[turn]
    np.testing.assert_allclose(rls.theta, np.linalg.solve(information, vector), rtol=1e-7)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
def test_no_wind_up_whatever_is_not_excited(direction):
    forgetting = 0.98
    rls = SquareRootRls(PRIOR, STD, 0.05)
    x, y = data()
    run(rls, x, y, forgetting)
    rows = np.tile(direction, (20_000, 1))
    run(rls, rows, rows @ [0.7, 0.4, -0.1], forgetting)
    # n - 1 updates at most lie between two feeds of one parameter's prior
    assert np.linalg.eigvalsh((rls.root / STD[:, None]) @ (rls.root / STD[:, None]).T).max() <= forgetting**-3
    if not any(direction):
        np.testing.assert_allclose(rls.theta, PRIOR, atol=1e-3)


def test_held_parameters_stay_and_do_not_move_with_the_others():
    x, y = data()
    rls = SquareRootRls(PRIOR, STD, 0.05)
    run(rls, x, y, 0.99)
    held = rls.theta[2]
    covariance = (rls.root @ rls.root.T)[:2, :2]
    rls.hold_after(2)
    np.testing.assert_allclose(rls.root @ rls.root.T, covariance, rtol=1e-9)
    run(rls, x, y + 1.0, 0.99)
    assert rls.theta[2] == held
    assert rls.free == 2
    learned = rls.theta[:2].copy()
    rls.hold_after(3)
    assert rls.std()[2] == pytest.approx(STD[2])
    np.testing.assert_array_equal(rls.theta[:2], learned)


def test_it_stays_accurate_over_a_million_badly_scaled_updates_worth_of_rounding():
    rng = np.random.default_rng(3)
    rls = SquareRootRls(np.zeros(3), np.array([1.0, 1e-3, 1e-3]), 0.01)
    rows = rng.standard_normal((50_000, 3)) * [1.0, 1e3, 1e3]
    rows[:, 2] = rows[:, 1] * (1 + 1e-6 * rng.standard_normal(50_000))
    run(rls, rows, rows @ [0.5, 2e-3, -1e-3], 0.999)
    covariance = rls.root @ rls.root.T
    assert np.isfinite(covariance).all()
    assert np.linalg.eigvalsh(covariance).min() >= -1e-18
    assert rls.theta[0] == pytest.approx(0.5, abs=1e-6)
    assert rls.theta[1] + rls.theta[2] == pytest.approx(1e-3, rel=1e-4)


def test_what_is_certain_stays_as_it_is():
    x, y = data()
    rls = SquareRootRls(PRIOR, np.array([0.5, 0.0, 0.2]), 0.05)
    run(rls, x, y, 0.98)
    assert rls.theta[1] == PRIOR[1]
    assert np.isfinite(rls.theta).all()
