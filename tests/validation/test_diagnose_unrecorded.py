"""What no recorded signal shows: an error far above the noise, in few moments, or one that swings."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from cruise.report.diagnosis import sentence
from cruise.report.diagnosis_figures import report
from cruise.validation.confidence import LEAST_UNTOLD, confidence_of, untold
from cruise.validation.diagnose import Verdict
from cruise.validation.selection import Selected
from cruise.validation.verdict import answered
from tests.validation.diagnosing import DT_S, SAMPLES, found
from tests.validation.driving import wander


def test_an_error_far_above_the_noise_that_nothing_foretells_has_a_cause_that_nobody_recorded():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.3, 4.0))
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ())
    assert one.untold
    assert not one.unrecorded
    assert not one.explained
    assert "record what else" in one.next_experiment
    assert "Something is missing that nobody recorded" in sentence(one)


def test_an_error_that_is_nearly_as_far_above_it_is_not_called_nothing():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.3, 4.0))
    times = np.sqrt(one.base.loss / one.steps[0].background.noise)
    for far, verdict in ((0.95, Verdict.UNLISTED), (0.8, Verdict.NOTHING)):
        background = copy(one.steps[0].background)
        background.noise = one.base.loss / (far * LEAST_UNTOLD) ** 2
        searched = Selected((replace(one.steps[0], background=background),), (), one.base, ())
        left = replace(one.left, foretold=0.0, untold=untold(searched, 0.0, 0.2))
        answer = answered(searched, left, ())
        assert answer.verdict is verdict
        assert 0.05 < confidence_of(answer.margin, verdict) < 0.9
    assert times > LEAST_UNTOLD


def test_an_error_in_few_moments_has_a_cause_though_it_is_not_great():
    at = np.zeros(SAMPLES)
    at[np.random.default_rng(3).integers(0, SAMPLES, 2)] = 1.0
    moments = np.convolve(at, np.ones(round(2.0 / DT_S)))[:SAMPLES].clip(0.0, 1.0)
    one = found(load_mps=-0.3 * moments)
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ())
    assert one.momentary
    assert "drive the moments again" in one.next_experiment
    assert "acts in few moments" in sentence(one)
    assert "of its square in 5 % of the time" in sentence(one)


def test_something_that_swings_at_a_pace_of_its_own_is_said_with_its_period():
    pace = 2.0 * np.pi * DT_S / 8.0 * (1.0 + wander(SAMPLES, DT_S, 5, 0.03, 20.0))
    one = found(load_mps=0.05 * np.sin(np.cumsum(pace)))
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ())
    assert one.left.swing_s == pytest.approx(8.0, rel=0.06)
    assert not one.momentary
    assert f"once in {one.left.swing_s:.1f} s" in one.next_experiment
    assert f"swings with a period of {one.left.swing_s:.1f} s" in sentence(one)


def test_soil_that_nobody_recorded_is_no_effect():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.03, 4.0))
    assert one.verdict is Verdict.NOTHING
    assert not one.untold
    assert not one.momentary
    assert np.isnan(one.left.swing_s)
    assert one.left.dead_time is None
    told = report(one, "a.yaml", "arx")
    assert (told["swing_s"], told["dead_time_changes"]) == (None, None)
