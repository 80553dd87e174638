"""Figures of a prediction, by hand."""

import numpy as np
import pytest

from cruise.identification.accuracy import accuracy, persistence

SPEED = np.array([1.0, 2.0, 3.0, 2.0, 1.0, 3.0])  # mean 2, variance 4 / 6


def test_a_perfect_prediction_explains_everything():
    found = accuracy([SPEED], [SPEED])
    assert (found.explained_pct, found.nrmse_pct, found.rmse_mps, found.mean_error_mps, found.samples) == (
        100.0,
        100.0,
        0.0,
        0.0,
        6,
    )


def test_a_bias_costs_nothing_of_the_variance_and_stands_in_the_mean_error():
    found = accuracy([SPEED], [SPEED - 0.25])
    assert found.explained_pct == pytest.approx(100.0)
    assert found.mean_error_mps == pytest.approx(0.25)
    assert found.rmse_mps == pytest.approx(0.25)
    assert found.nrmse_pct == pytest.approx(100.0 * (1.0 - 0.25 / np.sqrt(4.0 / 6.0)))


def test_an_error_of_half_the_deviation_leaves_three_quarters_explained():
    found = accuracy([SPEED], [SPEED + 0.5 * (SPEED - 2.0)])
    assert found.explained_pct == pytest.approx(75.0)
    assert found.nrmse_pct == pytest.approx(50.0)
    assert found.rmse_mps == pytest.approx(0.5 * np.sqrt(4.0 / 6.0))


def test_the_mean_explains_nothing():
    found = accuracy([SPEED], [np.full(6, 2.0)])
    assert (found.explained_pct, found.nrmse_pct) == pytest.approx((0.0, 0.0))


def test_every_recording_has_its_own_mean_and_counts_by_its_samples():
    # what differs between recordings is no variation that a model could take credit for
    apart = accuracy([SPEED, SPEED + 100.0], [np.full(6, 2.0), np.full(6, 102.0)])
    assert apart.explained_pct == pytest.approx(0.0)
    biased = accuracy([SPEED, SPEED], [SPEED - 0.5, SPEED + 0.5])
    assert biased.explained_pct == pytest.approx(100.0)
    assert biased.mean_error_mps == pytest.approx(0.0)
    assert biased.rmse_mps == pytest.approx(0.5)
    weighed = accuracy([SPEED, SPEED[:3]], [SPEED - 0.3, SPEED[:3]])
    assert weighed.rmse_mps == pytest.approx(0.3 * np.sqrt(6.0 / 9.0))
    assert weighed.samples == 9


def test_only_samples_with_a_speed_and_a_prediction_count():
    measured, predicted = SPEED.copy(), SPEED.copy()
    measured[0], predicted[1], predicted[2] = np.nan, np.nan, np.inf
    assert accuracy([measured], [predicted]).samples == 3
    assert accuracy([measured], [predicted]).rmse_mps == 0.0


def test_without_samples_or_movement_there_are_no_figures():
    nothing = accuracy([SPEED], [np.full(6, np.nan)])
    assert nothing.samples == 0
    assert np.isnan([nothing.explained_pct, nothing.nrmse_pct, nothing.rmse_mps, nothing.mean_error_mps]).all()
    still = accuracy([np.ones(5)], [np.full(5, 1.1)])
    assert np.isnan([still.explained_pct, still.nrmse_pct]).all()
    assert still.rmse_mps == pytest.approx(0.1)


def test_measured_and_predicted_must_be_as_many():
    with pytest.raises(ValueError, match="zip"):
        accuracy([SPEED], [])


def test_persistence_is_the_speed_of_a_while_ago():
    ramp = np.arange(50) / 10.0
    found = persistence([ramp], [ramp], 15)
    assert found.samples == 35
    assert found.mean_error_mps == pytest.approx(1.5)
    assert found.explained_pct == pytest.approx(100.0)
    assert persistence([ramp], [np.where(ramp < 2.0, np.nan, ramp)], 15).samples == 30
