"""A model against measurements: what has parameters is taken as it is, what has none is judged on unseen samples."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.accuracy import accuracy
from cruise.identification.arx import fit_arx
from cruise.identification.held_out import folds
from cruise.identification.preparation import PreparationSettings
from cruise.identification.regressors import FitError
from cruise.identification.structures import Family, parse
from cruise.model.model import Model
from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.comparison import HELD_OUT, NOT_HELD_OUT, TAKEN, compare, of_parameters
from tests.validation.machine import record

STRUCTURE = parse("arx:na=1,nb=3,delay_s=0.4")
PLAIN = PreparationSettings(cutoff_hz=0.0)
FILE = Model(0.2, 1, 3, 2, (), (0.7, 3e-4, 2e-4, 2e-4, 0.05))


@pytest.fixture(scope="module")
def machine() -> Recording:
    return record(seconds=120.0, noise_mps=0.02)


def test_a_model_with_parameters_is_taken_as_it_is(machine):
    found = compare((STRUCTURE, of_parameters(Family.ARX, FILE)), [machine], PLAIN, 2.0)
    assert found.how == TAKEN
    assert found.fitted.theta == FILE.theta
    (at_period,) = found.recordings
    y, u = at_period.output, at_period.input
    by_hand = np.full(len(y), np.nan)
    for k in range(20, len(y)):
        speed = y[k - 10]
        for m in range(k - 9, k + 1):
            speed = 0.7 * speed + 3e-4 * u[m - 2] + 2e-4 * u[m - 3] + 2e-4 * u[m - 4] + 0.05
        by_hand[k] = speed
    assert found.ahead_mps[0][20:] == pytest.approx(by_hand[20:], abs=1e-9)
    assert found.errors_mps[0][20:] == pytest.approx(y[20:] - by_hand[20:], abs=1e-9)
    assert found.horizon == 10


def test_a_structure_is_judged_by_fits_that_had_not_seen_the_sample(machine):
    found = compare(STRUCTURE, [machine], PLAIN)
    assert found.how == HELD_OUT
    fold, unseen = folds(found.recordings)[2], folds(found.recordings)[2].unseen[0]
    part = fit_arx(STRUCTURE.model(0.2), fold.training)
    assert part.theta != pytest.approx(found.fitted.theta, rel=1e-6)
    for predicted, mine in (
        (found.ahead_mps[0], part.ahead(found.recordings[0], 15)),
        (found.free_run_mps[0], part.free_run(found.recordings[0])),
    ):
        assert predicted[unseen] == pytest.approx(mine[unseen], abs=1e-12)


def test_persistence_is_judged_on_the_samples_of_the_model(machine):
    found = compare((STRUCTURE, of_parameters(Family.ARX, FILE)), [machine], PLAIN)
    y = found.recordings[0].output
    shown = np.where(np.isfinite(found.ahead_mps[0]), lagged(y, 15), np.nan)
    assert found.persistence == accuracy([y], [shown])
    assert found.persistence.samples == found.ahead.samples


def test_what_can_not_be_held_out_is_said(machine):
    found = compare(parse("arx:na=1,nb=5,delay_s=0"), [machine[:150]], PLAIN)
    assert found.how.startswith(NOT_HELD_OUT)
    assert "usable samples" in found.how
    assert found.ahead.samples > 10


def test_noise_of_a_file_is_part_of_its_predictions(machine):
    with_noise = compare((STRUCTURE, of_parameters(Family.ARMAX, FILE, (0.5,))), [machine], PLAIN, 0.2)
    without = compare((STRUCTURE, of_parameters(Family.ARX, FILE)), [machine], PLAIN, 0.2)
    assert np.nanmax(np.abs(with_noise.ahead_mps[0] - without.ahead_mps[0])) > 1e-3


def test_output_error_of_a_file_predicts_by_its_free_run(machine):
    found = compare((STRUCTURE, of_parameters(Family.OUTPUT_ERROR, FILE)), [machine], PLAIN)
    assert np.array_equal(found.ahead_mps[0], found.free_run_mps[0], equal_nan=True)


def test_clear_words_for_what_can_not_be_compared(machine):
    poor = Recording(machine.time_s, {name: machine.columns[name] for name in (INPUT, OUTPUT)}, 0.05, "poor.csv")
    with pytest.raises(FitError, match=r"poor.csv: the model needs engine_speed_rpm"):
        compare(parse("arx10+engine_speed"), [poor], PLAIN)
    needing = parse("arx:na=1,nb=3,delay_s=0.4+engine_speed")
    model = replace(FILE, effects=needing.model(0.2).effects)
    with pytest.raises(FitError, match=r"poor.csv: the model needs engine_speed_rpm"):
        compare((needing, of_parameters(Family.ARX, model)), [poor], PLAIN)
    with pytest.raises(FitError, match=r"every 0.2 s, not every 0.1 s: leave out --period"):
        compare((STRUCTURE, of_parameters(Family.ARX, FILE)), [machine], PreparationSettings(period_s=0.1))
    unstable = replace(FILE, theta=(1.01, *FILE.theta[1:]))
    with pytest.raises(FitError, match=r"unstable predictor, pole at 1.01"):
        compare((STRUCTURE, of_parameters(Family.ARX, unstable)), [machine], PLAIN)
    with pytest.raises(FitError, match="no sample has 500 s"):
        compare(STRUCTURE, [machine], PLAIN, 500.0)
    with pytest.raises(FitError, match="polynomials are not kept in files"):
        of_parameters(Family.NARX, FILE)
