"""A machine that stands at half of its current: what turns its drive is found where it turns it."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.structures import parse
from cruise.signals import INPUT
from cruise.validation.diagnose import diagnose
from cruise.validation.study import Study, study
from cruise.validation.unnamed import RestCurrent
from cruise.validation.verdict import Verdict
from tests.validation.diagnosing import tried
from tests.validation.driving import drive, levels, wander

PERIOD_S, DT_S = 0.2, 0.1
SECONDS, MIDDLE_MA, FULL_MA = 160.0, 1000.0, 700.0


def about(middle_ma: float) -> Study:
    """A drive both ways about this current, with two gears that are nearly the same."""
    samples = round(SECONDS / DT_S)
    lever_ma = levels(samples, DT_S, 3, -FULL_MA, FULL_MA)
    gear = 1.0 + (np.arange(samples) // 200 % 2)
    one = drive(SECONDS, gain=np.where(gear == 1.0, 0.9, 1.0), columns={"gear": gear}, current_ma=lever_ma)
    one = replace(one, columns={**one.columns, INPUT: middle_ma + lever_ma})
    return study([one], parse("arx:na=1,nb=3,delay_s=0.4"), None, PERIOD_S)


@pytest.mark.parametrize("middle_ma", [0.0, MIDDLE_MA])
def test_a_gain_is_as_good_wherever_the_machine_stands(middle_ma):
    one = about(middle_ma)
    found = next(it.judged for it in tried(one, one.base).tried if it.name == "gear_ratio")
    assert found.loss < 0.4 * one.base.loss
    at_ma = [it.rest_ma for it in found.explanation.effects if isinstance(it, RestCurrent)]
    assert at_ma == ([pytest.approx(MIDDLE_MA, abs=60.0)] if middle_ma else [])


def test_what_has_one_size_at_every_speed_is_no_gain_about_a_current_far_beyond_what_was_driven():
    """A radar whose zero follows the temperature, and no second speed that would show it."""
    samples = round(SECONDS / DT_S)
    oil_c = 50.0 + wander(samples, DT_S, 5, 12.0, 20.0)
    lever_ma, zero_mps = levels(samples, DT_S, 3, 0.0, FULL_MA), 0.004 * (oil_c - 50.0)
    one = drive(SECONDS, load_mps=zero_mps, columns={"oil_temperature_c": oil_c}, current_ma=lever_ma)
    beside = study([one], parse("arx:na=1,nb=3,delay_s=0.4"), None, PERIOD_S)
    found = next(it.judged for it in tried(beside, beside.base).tried if it.name == "oil_temperature")
    assert not [it for it in found.explanation.effects if isinstance(it, RestCurrent)]
    assert diagnose(beside).verdict is not Verdict.MISSING
