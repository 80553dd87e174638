"""A verdict is as sure as it is far from another one."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from cruise.validation import selection
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import (
    CURVES,
    LEAST_MARGIN,
    LEAST_UNTOLD,
    MOST_THERE,
    answer_of,
    confidence_of,
    excess,
    in_moments,
    margin_of_the_end,
    untold,
)
from cruise.validation.diagnose import Verdict
from cruise.validation.foretold import Foretold
from cruise.validation.tried import BEYOND_DOUBT, ENOUGH, RESISTS, asked

PERIOD_S = 0.2


def test_what_is_far_from_the_share_of_a_further_effect_leaves_no_doubt(dead_zone):
    last = dead_zone.steps[-1]
    rest = next(one for one in last.tried if not one.name.startswith(UNNAMED))

    def margin(share: float, name: str = "grade", sureness: float = 9.0) -> float:
        left = replace(last.before, raw=last.before.raw - share * dead_zone.steps[-2].before.raw)
        much = replace(rest, name=name, evidence=500.0, gain=0.3, credit=1.0, sureness=sureness, judged=left)
        found = selection.Selected((*dead_zone.steps[:-1], replace(last, tried=(much,))), dead_zone.effects, left, ())
        return margin_of_the_end(found)

    assert margin(0.5 * selection.LEAST_SHARE) == pytest.approx(0.5 * selection.FURTHER)
    assert margin(2.0 * selection.LEAST_SHARE) == LEAST_MARGIN
    soil = margin(2.0 * selection.LEAST_SHARE, "rolling_resistance", 0.6 * BEYOND_DOUBT)
    assert soil == pytest.approx(0.4 * selection.FURTHER), "as far from being beyond doubt as soil is"


def test_nothing_is_the_surer_the_further_from_what_is_asked_of_the_first_effect(nothing):
    (step,) = nothing.steps
    rest = next(one for one in step.tried if not one.name.startswith(UNNAMED))

    def margin(name: str, evidence: float) -> float:
        much = replace(rest, name=name, evidence=evidence, gain=0.4, credit=1.0)
        return margin_of_the_end(selection.Selected((replace(step, tried=(much,)),), (), nothing.base, ()))

    assert margin("grade", 0.5 * asked(0.4)) == pytest.approx(0.5 * ENOUGH)
    assert margin("grade", 0.99 * asked(0.4)) == LEAST_MARGIN
    assert margin("coulomb_friction", 0.5 * RESISTS * asked(0.4)) == pytest.approx(0.5 * ENOUGH), "soil is no friction"


def test_nothing_is_hardly_sure_where_what_every_force_acts_through_is_all_but_named(nothing):
    (step,) = nothing.steps
    rest = next(one for one in step.tried if not one.name.startswith(UNNAMED))

    def margin(mediated: float, evidence: float = 200.0) -> float:
        leakage = replace(rest, name="leakage", evidence=evidence, gain=0.4, credit=0.0, sureness=2.0)
        nearly = replace(step, tried=(leakage,), mediated=mediated)
        return margin_of_the_end(selection.Selected((nearly,), (), nothing.base, ()))

    assert margin(-0.1) == pytest.approx(0.1 * ENOUGH)
    assert margin(0.0) == margin(-0.1, 0.5 * ENOUGH) == ENOUGH


def test_an_effect_that_leaves_more_of_what_could_be_explained_than_it_takes_is_not_what_is_missing(grade):
    last = grade.steps[-1]

    def found_so(left: float, noise: float) -> selection.Selected:
        """It leaves so much of the first loss, where noise is so much of it."""
        background = copy(last.background)
        background.noise = noise * grade.base.loss
        final = replace(grade.final, raw=left * grade.base.loss / grade.final.loss * grade.final.raw)
        return selection.Selected((*grade.steps[:-1], replace(last, background=background)), grade.effects, final, ())

    assert untold(selection.Selected(grade.steps, grade.effects, grade.final, ()), 0.0, PERIOD_S) < 0.2
    assert untold(found_so(0.65, 0.1), 0.0, PERIOD_S) > 1.0
    assert untold(found_so(0.5, 0.1), 0.0, PERIOD_S) < 1.0
    assert untold(found_so(0.65, 0.4), 0.0, PERIOD_S) < 1.0, "most of that is noise"
    alone = replace(found_so(0.65, 0.1), chosen=())
    assert untold(alone, 0.0, PERIOD_S) == pytest.approx(np.sqrt(0.65 / 0.1) / LEAST_UNTOLD)
    assert untold(alone, 0.5 * alone.final.loss, PERIOD_S) == untold(alone, 0.0, PERIOD_S), (
        "where nothing is found, a drift is worth a word"
    )
    assert untold(found_so(0.65, 0.1), 0.4 * grade.base.loss, PERIOD_S) < 1.0, "soil that wanders hides no effect"


def test_what_is_foretold_counts_as_a_share_of_what_is_no_white_noise(nothing):
    """A memory that makes the error 1.3 times the noise is all that could be foretold: 0.4 of it."""

    def found(share: float, white: float, base: float = 1.0) -> float:
        one = replace(nothing.base, raw=base / nothing.base.loss * nothing.base.raw)
        return excess(Foretold(share, max(share, 0.0), (), left=1.0), one, one, white**0.5)

    assert found(0.29, 0.0) < 1.0 < found(0.31, 0.0)
    assert found(0.19, 0.4) > 1.0 > found(0.17, 0.4)
    assert found(0.09, 0.9) < 1.0 < found(0.11, 0.9), "trees reach as much on noise alone"
    assert found(0.19, 1.1) == found(0.19, 0.0), "more noise than error is none"
    assert found(-0.05, 0.4) < 0.0
    assert found(0.19, 0.4, base=3.0) < 1.0, "little of what there was at first"


def test_an_error_that_stands_in_few_moments_is_neither_noise_nor_soil(nothing):
    noise = np.random.default_rng(7).normal(size=3000)
    assert in_moments(noise, PERIOD_S) < 0.15
    assert in_moments(np.cumsum(noise[:600]), PERIOD_S) < MOST_THERE
    moments = noise.copy()
    moments[1000:1060] += 12.0  # 2 % of the time
    assert in_moments(moments, PERIOD_S) > MOST_THERE
    assert in_moments(np.append(moments, np.nan), PERIOD_S) == in_moments(moments, PERIOD_S)
    assert in_moments(moments[:200], PERIOD_S) == 0.0, "too short to speak of a twentieth"

    assert in_moments(0.0 * moments, PERIOD_S) == 0.0

    def so(error_mps: np.ndarray, times: float) -> float:
        """Its RMS is so many times the noise."""
        raw = times**2 * nothing.steps[-1].background.noise / nothing.final.loss * nothing.final.raw
        final = replace(nothing.final, raw=raw, fit=replace(nothing.final.fit, error_mps=error_mps))
        return untold(selection.Selected(nothing.steps, (), final, ()), 0.0, PERIOD_S)

    assert so(noise, 2.5) < 1.0 < so(moments, 2.5) == in_moments(moments, PERIOD_S) / MOST_THERE
    assert so(moments, 1.4) < 1.0, "little more than noise: a recording that has hardly any"


@pytest.mark.parametrize("answer", CURVES)
def test_confidence_rises_with_the_margin_towards_one(answer):
    values = [confidence_of(margin, answer) for margin in (-1.0, 0.0, 1.0, 10.0, 60.0, 1e30)]
    assert values == sorted(values)
    assert values[0] == values[1] > 0.0
    assert values[-1] == pytest.approx(1.0, abs=1e-3)


def test_what_is_left_beside_the_effects_takes_from_the_confidence_in_them():
    said = [confidence_of(60.0, "inferred", left) for left in (-0.3, 0.0, 0.1, 0.4, 0.8)]
    assert said[0] == said[1] == confidence_of(60.0, "inferred")
    assert said == sorted(said, reverse=True)
    assert said[-1] == pytest.approx(0.5 * said[0])


def test_several_effects_at_once_are_another_answer_than_one():
    named = ("grade",), ("dead_zone",), ("wheel_slip",), ("grade", "dead_zone")
    answers = [answer_of(Verdict.MISSING, names) for names in named]
    assert answers == ["measured", "inferred", "smooth", "several"]
    assert {answer_of(verdict, ()) for verdict in set(Verdict) - {Verdict.MISSING}} | set(answers) == set(CURVES)
