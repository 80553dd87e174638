"""Batch least squares: it recovers a known truth with honest standard errors, and refuses what it can't know."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.arx import fit_arx
from cruise.identification.least_squares import FitError, fit, regression_over, solve
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.identification.regressors import Smooth, model_rows
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import OUTPUT
from tests.identification.truth import (
    MODEL,
    STROKED,
    STROKED_MODEL,
    THETA,
    currents,
    recording,
    stroked,
)

UNKNOWN = MODEL.with_theta((0.0,) * 4)


def without(source: Recording, name: str) -> Recording:
    columns = {key: values for key, values in source.columns.items() if key != name}
    return Recording(source.time_s, columns, source.dt_s, source.source)


def changed(source: Recording, name: str, where, value: float | np.ndarray) -> Recording:
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


def test_recordings_of_two_rates_are_refused_by_name():
    source = recording()
    fast = Recording(source.time_s / 4.0, source.columns, 0.05, "fast.csv")
    with pytest.raises(FitError, match=r"fast\.csv is sampled every 0\.05 s"):
        fit(UNKNOWN, [source, fast])


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


def test_a_constant_current_is_named_with_its_value():
    with pytest.raises(FitError, match="the current is 700 mA throughout; drive steps"):
        fit(UNKNOWN, [recording(current_ma=np.full(600, 700.0))])


def test_a_drive_signal_that_never_leaves_the_dead_zone_is_told_from_a_constant_current():
    low = currents(600, 3, 100.0, 390.0)
    with pytest.raises(FitError, match=r"changes from 1\d\d\.?\d* to 3\d\d\.?\d* mA, but the effects leave"):
        fit(UNKNOWN, [recording(current_ma=low)])


def test_columns_that_can_replace_each_other_are_named():
    """A ramp: every lag is the one before and a constant."""
    ramp = np.linspace(400.0, 1000.0, 600)
    structure = Model(0.2, 0, 2, 0, (), (0.0,) * 3)
    with pytest.raises(FitError, match=r"only 2 of 3 .*b_0_mps_per_ma and b_1_mps_per_ma can replace each other"):
        fit(structure, [recording(current_ma=ramp)])


def test_what_has_no_effect_is_named():
    matrix = np.column_stack([np.zeros(50), np.arange(50.0)])
    with pytest.raises(FitError, match=r"only 1 of 2 .*grade has no effect on the prediction"):
        solve(matrix, np.arange(50.0), ("grade", "b"))


@pytest.mark.parametrize("nearly", [1.0, 1e-3, 3e-5, 3e-6, 1e-7, 1e-9])
def test_the_solution_is_that_of_numpy_however_alike_the_columns(nearly):
    """Normal equations down to a condition of 1e5, QR beyond."""
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, 400))
    matrix = np.column_stack([first, 1e3 * (first + nearly * second), np.ones(400)])
    target = rng.standard_normal(400)
    found = solve(matrix, target, ("a", "b", "c"))
    expected = np.linalg.lstsq(matrix, target)[0]
    np.testing.assert_allclose(matrix @ found.theta, matrix @ expected, atol=1e-14 / nearly + 1e-10)
    np.testing.assert_allclose(found.theta, expected, rtol=1e-14 / nearly + 1e-8)
    assert found.condition == pytest.approx(2.0 / nearly, rel=1.0)
    np.testing.assert_allclose(found.inverse @ (matrix.T @ matrix), np.eye(3), atol=1e-2 * (1e3 / nearly) ** 2 * 1e-12)


def test_a_model_without_a_drive_is_an_autoregression():
    found = fit(Model(0.2, 2, 0, 0, (), (0.0,) * 3), [recording(current_ma=np.full(600, 700.0))])
    assert len(found.theta) == 3


# -- filtered


def paper_filter(period_s: float = 0.2) -> Smooth:
    smooth = smoother(PreparationSettings(), period_s)
    assert smooth is not None
    return smooth


SMOOTH = paper_filter()


def test_the_filter_keeps_every_row_of_every_stretch_and_joins_none():
    holed = changed(recording(), OUTPUT, 300, np.nan)
    plain, filtered = model_rows(MODEL, [holed, holed]), model_rows(MODEL, [holed, holed], SMOOTH)
    assert len(plain.pieces) == 4
    assert filtered.pieces == plain.pieces
    for piece in plain.pieces:
        np.testing.assert_allclose(filtered.target[piece], SMOOTH(plain.target[piece]), rtol=1e-9)


def test_a_stretch_too_short_for_the_filter_is_left_out():
    holed = changed(recording(), OUTPUT, slice(500, None, 12), np.nan)
    assert len(model_rows(MODEL, [holed], SMOOTH).pieces) == 1
    with pytest.raises(FitError, match=r"0 usable samples .* before the filter, for which"):
        fit(MODEL, [holed[500:]], SMOOTH)


def test_the_filter_acts_on_finished_columns_and_leaves_the_constant():
    plain, filtered = model_rows(MODEL, [recording()]), model_rows(MODEL, [recording()], SMOOTH)
    np.testing.assert_allclose(filtered.matrix[:, 1], SMOOTH(plain.matrix[:, 1]), rtol=1e-9)
    np.testing.assert_allclose(filtered.target, SMOOTH(plain.target), rtol=1e-9)
    single = Model(0.2, 0, 1, 0, (), (0.0,) * 2)
    assert (model_rows(single, [recording()], SMOOTH).matrix[:, -1] == 1.0).all()


def test_without_noise_the_truth_comes_back_through_the_filter():
    steady = replace(MODEL, effects=MODEL.effects[:2])
    source = recording(noise_mps=0.0)
    v = np.maximum(source.input - 400.0, 0.0) * (1.0 + 0.6 * np.maximum(source.input - 400.0, 0.0) / 1000.0)
    y = np.zeros(len(v))
    for k in range(3, len(v)):
        y[k] = 0.7 * y[k - 1] + 3e-4 * v[k - 2] + 4e-4 * v[k - 3] - 0.04
    found = fit_arx(steady, [changed(source, OUTPUT, slice(None), y)], SMOOTH)
    np.testing.assert_allclose(found.theta, THETA, rtol=1e-4)
    assert found.unstable == ""
    assert "condition" not in found.message


def test_an_ill_conditioned_fit_goes_through_and_says_so():
    rng = np.random.default_rng(1)
    current = 700.0 + 150.0 * rng.standard_normal(6000)
    speed = np.convolve(current, np.full(20, 5e-5))[:6000] + 0.01 * rng.standard_normal(6000)
    fast = Recording(0.05 * np.arange(6000), {"pump_current_ma": current, OUTPUT: speed}, 0.05, "fast")
    found = fit_arx(Model(0.05, 0, 10, 0, (), (0.0,) * 11), [fast], paper_filter(0.05))
    assert "judge the predictions" in found.message


def test_an_unstable_fit_is_named():
    time_s = 0.2 * np.arange(300)
    current = currents(300, 0)
    growing = 0.01 * np.exp(0.05 * time_s) + 1e-5 * current
    source = Recording(time_s, {"pump_current_ma": current, OUTPUT: growing}, 0.2, "growing")
    found = fit_arx(Model(0.2, 1, 1, 0, (), (0.0,) * 3), [source])
    assert found.unstable.startswith("pole at 1.0")


def test_what_yields_with_the_stroke_is_fitted_from_anywhere():
    for pole in (0.0, 0.3, 0.95):
        model = STROKED_MODEL.with_theta((pole, 0.0, 0.0))
        np.testing.assert_allclose(fit(model, [stroked()]).theta, STROKED, rtol=1e-4)
        np.testing.assert_allclose(fit_arx(model, [stroked()]).model.theta, STROKED, rtol=1e-4)
