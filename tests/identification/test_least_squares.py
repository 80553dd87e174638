"""Batch least squares: it recovers a known truth with honest standard errors, and refuses what it can't know."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.least_squares import FitError, fit, regression_over
from cruise.recording import Recording
from cruise.signals import OUTPUT
from tests.identification.truth import MODEL, THETA, currents, recording

UNKNOWN = MODEL.with_theta((0.0,) * 4)


def without(source: Recording, name: str) -> Recording:
    columns = {key: values for key, values in source.columns.items() if key != name}
    return Recording(source.time_s, columns, source.dt_s, source.source)


def changed(source: Recording, name: str, where, value: float) -> Recording:
    values = source.columns[name].copy()
    values[where] = value
    return Recording(source.time_s, {**source.columns, name: values}, source.dt_s, source.source)


def test_without_noise_the_truth_comes_back():
    found = fit(UNKNOWN, [recording(noise_mps=0.0)])
    np.testing.assert_allclose(found.theta, THETA, rtol=1e-7)
    assert found.residual_std_mps < 1e-9
    assert (found.effects, found.delay) == (MODEL.effects, MODEL.delay)


@pytest.mark.parametrize("na", [0, 1])
def test_with_white_noise_the_truth_lies_within_three_standard_errors(na):
    """At 3 standard errors 0.3 % may miss; standard errors twice too small would miss 13 % of the time."""
    structure = replace(UNKNOWN, na=na, theta=(0.0,) * (na + 3))
    truth = THETA if na else THETA[1:]
    ratios = []
    for seed in range(40):
        found = fit(structure, [recording(seed=seed, a=0.7 if na else 0.0)])
        ratios.append((np.array(found.theta) - truth) / found.theta_std)
    ratios = np.array(ratios)
    assert (np.abs(ratios) < 3.0).all(axis=1).mean() >= 0.95
    assert (np.abs(ratios) < 3.0).mean() >= 0.98
    assert 0.8 < ratios.std() < 1.25  # neither too small nor too large
    assert np.abs(ratios.mean(axis=0)).max() < 0.6


def test_the_residual_is_the_noise():
    assert fit(UNKNOWN, [recording(5000, noise_mps=0.03)]).residual_std_mps == pytest.approx(0.03, rel=0.05)


def test_recordings_are_never_joined():
    """Two drives far apart: a sample that takes its past from the other drive would not fit."""
    slow = recording(300, 1, 0.0, current_ma=currents(300, 1, 420.0, 500.0))
    fast = recording(300, 2, 0.0, current_ma=currents(300, 2, 900.0, 1000.0))
    found = fit(UNKNOWN, [slow, fast, slow])
    np.testing.assert_allclose(found.theta, THETA, rtol=1e-6)
    counts = [len(regression_over(MODEL, part)[1]) for part in (slow, fast)]
    assert counts == [297, 297]  # delay and order leave three out


def test_a_hole_costs_its_samples_and_nothing_else():
    whole = recording(noise_mps=0.0)
    holed = changed(whole, OUTPUT, slice(200, 210), np.nan)
    holed = changed(holed, "engine_speed_rpm", 400, np.nan)
    assert len(regression_over(MODEL, whole)[1]) - len(regression_over(MODEL, holed)[1]) == 11 + 1
    np.testing.assert_allclose(fit(UNKNOWN, [holed]).theta, THETA, rtol=1e-7)


def test_a_recording_without_a_needed_signal_is_refused_by_name():
    with pytest.raises(FitError, match=r"truth\.csv: the model needs engine_speed_rpm"):
        fit(UNKNOWN, [without(recording(), "engine_speed_rpm")])


def test_another_rate_is_refused_with_the_remedy():
    source = recording()
    fast = Recording(source.time_s / 4.0, source.columns, 0.05, source.source)
    with pytest.raises(FitError, match=r"every 0\.05 s, the model runs every 0\.2 s: resample"):
        fit(UNKNOWN, [fast])


@pytest.mark.parametrize("samples", [1, 2, 3, 5, 14])
def test_too_short_a_recording_is_refused(samples):
    with pytest.raises(FitError, match="usable samples for 4 parameters: record for longer"):
        fit(UNKNOWN, [recording(600)[:samples]])


@pytest.mark.parametrize("current_ma", [0.0, 350.0, 700.0])
def test_a_current_that_never_changes_is_refused(current_ma):
    with pytest.raises(FitError, match="the input does not excite the drive"):
        fit(UNKNOWN, [recording(current_ma=np.full(600, current_ma))])


def test_no_recording_is_refused():
    with pytest.raises(FitError, match="no recording"):
        fit(UNKNOWN, [])
