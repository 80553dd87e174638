"""What speaks against driving with a fitted model."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from cruise.identification.doubts import doubts
from cruise.identification.identify import identify
from cruise.identification.preparation import PreparationSettings
from cruise.identification.structures import parse
from tools.benchmarks.recovery import SYSTEMS


@pytest.fixture(scope="module")
def found():
    """A good fit."""
    structure = parse("arx:na=1,nb=2,delay_s=0.4+dead_zone")
    return identify(structure, [SYSTEMS["hammerstein"].record(1)], PreparationSettings())


def test_a_good_fit_has_none(found):
    assert doubts(found) == []


def test_an_error_that_is_missing_or_far_greater_on_what_it_had_not_seen(found):
    assert doubts(replace(found, held_out=None)) == ["nothing shows how well it predicts what it had not seen"]
    worse = replace(found.training, rmse_mps=4.0 * found.training.rmse_mps)
    assert worse.rmse_mps < found.persistence.rmse_mps
    assert doubts(replace(found, held_out=worse)) == ["held out, it errs 4 times as much as in training"]
    still = replace(found.persistence, rmse_mps=0.9 * found.held_out.rmse_mps)
    (said,) = doubts(replace(found, persistence=still))
    assert said.startswith("held out, it errs by ")
    assert f"; persistence errs by {still.rmse_mps:.3g} m/s" in said


def test_a_shape_at_its_bound(found):
    (dead_zone,) = found.effects
    high = dead_zone.parameters["threshold_ma"].high
    effects = (replace(dead_zone, threshold_ma=high),)
    (said,) = doubts(replace(found, effects=effects))
    assert said.startswith("dead_zone.threshold_ma is at its bound")
    assert doubts(replace(found, effects=effects, looked_for=())) == []


def test_an_unstable_predictor_is_said_alone(found):
    unstable = SimpleNamespace(unstable="pole at 1.02")
    assert doubts(replace(found, fitted=unstable, held_out=None)) == ["its predictor is unstable: pole at 1.02"]
