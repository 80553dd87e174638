"""What is added to a model, and what is dropped again: every limit of the search, from both sides."""

import itertools
import math
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cruise.identification.structures import parse
from cruise.validation import selection, tried
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import answer_of, confidence_of, margin_of_the_end
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.judged import Judged
from cruise.validation.selection import LEAST_COMMAND, least_share
from cruise.validation.study import study
from cruise.validation.tried import (
    BEYOND_DOUBT,
    LEAST_GAIN,
    MUCH,
    RARE,
    RESISTANCE,
    WHOLE,
    Tried,
    asked,
)
from cruise.validation.unnamed import SPEED
from tests.validation.diagnosing import PITCH, begun
from tests.validation.driving import drive


@pytest.mark.parametrize("better", [False, True])
def test_a_search_that_is_begun_anew_comes_to_an_end(dead_zone, monkeypatch, better):
    """Where a core or another shape seems to make all of what was found superfluous, time and again."""
    alone, beside = dead_zone.steps[0], dead_zone.steps[1]
    rounds, slots = itertools.count(), itertools.count()
    base = replace(alone.before, raw=(0.5 if better else 0.99) * alone.before.raw)

    def tried_again(study, present, possible, chosen, *_, ends):
        assert next(rounds) < 2 * selection.MOST_STEPS, "it goes on for ever"
        return beside if chosen else alone

    def needed(search, first, chosen, present, doubted):
        return ([], base) if doubted == chosen else (chosen, present)

    monkeypatch.setattr(selection, "tried_beside", tried_again)
    monkeypatch.setattr(selection, "_needed", needed)
    monkeypatch.setattr(dead_zone.study.search, "plan", lambda _: SimpleNamespace(slots=next(slots)))
    found = selection.selected(dead_zone.study, np.random.default_rng(0), lambda *_: None)
    assert found.chosen == ("dead_zone",)
    assert found.steps[0] is not found.steps[-1]


def test_a_curve_beside_what_was_found_must_take_as_much_as_a_further_effect(dead_zone):
    last, before = dead_zone.steps[-1], dead_zone.steps[-2].before
    curve = replace(next(one for one in last.tried if one.name.startswith(UNNAMED)), gain=0.3, evidence=100.0)

    def left(share: float) -> Judged:
        return replace(last.before, raw=last.before.raw + share * before.raw)

    def word(beside: Judged = last.before, chosen: tuple[str, ...] = ("grade",), **how) -> Tried | None:
        one = replace(curve, **({"judged": left(-0.05), "sureness": 3.0, "credit": 1.0} | how))
        return selection._left_over(chosen, replace(last, before=beside, tried=(one,)), before)

    assert word() is not None
    assert word(credit=0.9) is None, "the drive itself moves it"
    assert word(name=f"{UNNAMED}pitch_deg") is None, "it is the effect's own"
    for name, own in (("dead_zone", "pump_current_ma"), ("coulomb_friction", SPEED)):
        assert word(chosen=(name,), name=f"{UNNAMED}{own}") is None
    assert word(evidence=selection.FURTHER - 1.0) is None
    assert word(gain=0.2) is None
    assert word(judged=left(-0.03)) is None
    assert word(left(0.5), judged=left(0.2)) is not None
    assert word(left(0.5), judged=left(0.3)) is None, "others take as much of it"
    assert selection._left_over(dead_zone.effects, last, before) is None


def test_a_second_effect_of_the_dynamics_must_take_more_than_a_wrong_form_leaves(dead_zone):
    before = dead_zone.steps[-2].before
    last = replace(dead_zone.steps[-1], before=replace(before, raw=0.5 * before.raw))

    def further(left: float, *chosen: str) -> bool:
        one = replace(last.tried[0], name="active_braking", gain=0.4, evidence=500.0, sureness=5.0)
        return selection._further(
            replace(one, credit=1.0, judged=replace(before, raw=left * before.raw)), last, before, chosen
        )

    little, more = (0.5 - share * selection.LEAST_DYNAMIC for share in (0.9, 1.1))
    assert further(little, "dead_zone")
    assert not further(little, "dead_zone", "rate_limit")
    assert further(more, "rate_limit")


def test_what_takes_all_that_is_left_above_the_noise_is_a_further_effect_though_its_share_is_small(dead_zone):
    before, last = (
        dead_zone.steps[-2].before,
        replace(dead_zone.steps[-1], background=copy(dead_zone.steps[-1].background)),
    )
    present = replace(before, raw=0.12 * before.raw)
    last.background.noise = 0.04 * before.loss

    def further(left: float, sureness: float) -> bool:
        one = replace(last.tried[0], name="coulomb_friction", gain=0.5, evidence=50.0, sureness=sureness, credit=1.0)
        one = replace(one, judged=replace(before, raw=left * before.raw))
        return selection._further(one, replace(last, before=present), before, ("dead_zone",))

    assert further(0.045, 1.1 * BEYOND_DOUBT), "94 % of what is left above the noise"
    assert not further(0.045, 0.9 * BEYOND_DOUBT), "not sure beyond doubt"
    assert not further(0.06, 1.1 * BEYOND_DOUBT), "three quarters may be a wrong form's"


def test_a_further_friction_must_be_beyond_doubt_where_soil_may_pass_for_it(dead_zone):
    before, last = dead_zone.steps[-2].before, dead_zone.steps[-1]
    present = replace(before, raw=0.3 * before.raw)

    def further(name: str, sureness: float, gain: float = 0.9 * MUCH) -> bool:
        one = replace(last.tried[0], name=name, gain=gain, evidence=120.0, sureness=sureness, credit=1.0)
        one = replace(one, judged=replace(before, raw=(1.0 - gain) * present.raw))
        return selection._further(one, replace(last, before=present), before, ("dead_zone",))

    for name in RESISTANCE:
        assert further(name, 1.1 * BEYOND_DOUBT)
        assert not further(name, 0.9 * BEYOND_DOUBT)
        assert further(name, 0.9 * BEYOND_DOUBT, 1.1 * MUCH), "no soil takes so much"
    assert further("grade", 0.9 * BEYOND_DOUBT)


def test_a_further_force_needs_evidence_however_much_it_takes_of_what_is_left(dead_zone):
    before, last = dead_zone.steps[-2].before, dead_zone.steps[-1]
    present = replace(before, raw=0.3 * before.raw)

    def soil(name: str, evidence: float) -> bool:
        one = replace(last.tried[0], name=name, gain=0.45, evidence=evidence, sureness=4.0, credit=1.0)
        one = replace(one, judged=replace(before, raw=0.5 * present.raw))
        step = replace(last, before=present)
        assert selection._further(one, step, before, ("dead_zone",))
        return selection._may_be_soil(one, step)

    assert not soil("speed_droop", 0.6 * selection.FURTHER)
    assert soil("grade", 0.6 * selection.FURTHER)
    assert not soil("grade", 1.1 * selection.FURTHER)


def test_a_force_that_may_be_soil_is_none_beside_what_was_found(monkeypatch):
    both = begun(command=lambda u: np.maximum(u - 400.0, 0.0), load_mps=-1.0 * np.sin(np.radians(PITCH)))

    def chosen() -> selection.Selected:
        return selection.selected(both, np.random.default_rng(0), lambda text: None)

    first, second = chosen().chosen
    assert {first, second} == {"dead_zone", "grade"}
    monkeypatch.setattr(selection, "_may_be_soil", lambda one, step: True)
    found = chosen()
    assert found.chosen == (first,)
    assert [one.taken for one in found.steps] == [first, ""]
    assert found.final is found.steps[-1].before


def test_effects_that_take_little_in_all_are_the_little_of_everything_that_a_machine_has(dead_zone, monkeypatch):
    first = dead_zone.steps[0]
    for share, little in ((0.9, True), (1.1, False)):
        left = replace(first.before, raw=(1.0 - share * selection.LEAST_IN_ALL) * first.before.raw)
        assert selection._is_little(first, left) is little
    monkeypatch.setattr(selection, "LEAST_IN_ALL", 1.0)
    found = selection.selected(dead_zone.study, np.random.default_rng(0), lambda text: None)
    assert found.chosen == ()
    assert [one.taken for one in found.steps] == [""]
    assert found.final is found.steps[0].before


def test_what_a_far_larger_effect_hid_is_a_further_one_but_no_dynamics(dead_zone):
    before, last = (
        dead_zone.steps[-2].before,
        replace(dead_zone.steps[-1], background=copy(dead_zone.steps[-1].background)),
    )
    last = replace(last, before=replace(before, raw=0.03 * before.raw))
    last.background.noise = 0.01 * before.loss

    def further(name: str, left: float, gain: float = 0.6) -> bool:
        one = replace(last.tried[0], name=name, gain=gain, evidence=200.0, sureness=6.0, credit=1.0)
        one = replace(one, judged=replace(before, raw=left * before.raw))
        return selection._further(one, last, before, ("dead_zone",))

    assert further("coulomb_friction", 0.0115), "a fiftieth of what the dead zone takes, and all that can be explained"
    assert not further("coulomb_friction", 0.016), "two thirds of it"
    assert not further("coulomb_friction", 0.0115, 0.4), "less than half of the loss"
    assert not further("active_braking", 0.0115), "a core that is not exact leaves as much"
    assert not further("leakage", 0.0115), "soil shows in the line pressure, too"


def test_a_further_effect_of_the_cores_structure_must_take_more_than_a_rough_core_leaves(dead_zone):
    before, last = dead_zone.steps[-2].before, dead_zone.steps[-1]
    present = replace(before, raw=0.2 * before.raw)

    def further(name: str, left: float, gain: float = 0.5, sureness: float = 0.9 * BEYOND_DOUBT) -> bool:
        one = replace(last.tried[0], name=name, gain=gain, evidence=500.0, sureness=sureness, credit=1.0)
        one = replace(one, judged=replace(before, raw=left * before.raw))
        return selection._further(one, replace(last, before=present), before, ("dead_zone",))

    assert further("grade", 0.1)
    assert not further("resonance", 0.08)
    assert not further("transport_delay", 0.08)
    assert further("resonance", 0.04)
    assert further("resonance", 0.08, sureness=1.1 * BEYOND_DOUBT), "most of what is left, beyond doubt"
    assert not further("resonance", 0.11, sureness=1.1 * BEYOND_DOUBT), "no core's form is exact"
    assert not further("resonance", 0.08, gain=0.45, sureness=1.1 * BEYOND_DOUBT)


def test_a_force_that_is_missing_too_does_not_hide_a_further_effect(grade):
    """What it takes counts against what is left where every force is known, if that is more."""
    before, last = grade.steps[-2].before, grade.steps[-1]

    def left(share: float) -> Judged:
        return replace(before, raw=share * before.raw, white=share * before.white)

    def further(forces: Judged | None, beside: float) -> bool:
        one = replace(grade.steps[0].tried[0], name="dead_zone", gain=0.2, evidence=500.0, sureness=5.0, credit=1.0)
        one = replace(one, judged=left(0.4), compared=left(beside))
        return selection._further(one, replace(last, before=left(0.5), forces=forces), before, ("grade",))

    assert not further(None, 0.4)
    assert further(left(0.3), 0.1)
    assert not further(left(0.3), 0.28)


def test_a_gain_that_is_not_sure_is_not_named(grade, monkeypatch):
    for name in ("SURE", "BEYOND_DOUBT", "ANYHOW"):
        monkeypatch.setattr(f"cruise.validation.tried.{name}", 2.0 * max(one.sureness for one in grade.steps[0].tried))
    monkeypatch.setattr("cruise.validation.tried.RARE", (tried.SURE, RARE[1]))
    monkeypatch.setattr("cruise.validation.tried.WHOLE", (WHOLE[0], tried.SURE))
    monkeypatch.setattr(selection, "HOPEFUL", (math.inf, 0))  # nor is it one of two
    one = diagnose(grade.study)
    assert one.untold  # a great error all the same
    assert one.effects == ()
    assert one.steps[0].tried[0].gain == grade.steps[0].tried[0].gain > LEAST_GAIN


@pytest.mark.parametrize(("share", "chosen"), [(1.05, ("grade",)), (0.9, ("grade",)), (0.8, ())])
def test_an_effect_that_is_nearly_enough_is_named_as_nothing_would_hardly_be_believed(
    grade, monkeypatch, share, chosen
):
    first = grade.steps[0]
    one = replace(first.tried[0], gain=0.4, credit=1.0, evidence=share * asked(0.4), sureness=2.0)

    def beside(study, present, everyone, so_far, *_, ends=False):
        return replace(first, before=present, tried=() if so_far else (one,), taken="")

    monkeypatch.setattr(selection, "tried_beside", beside)
    found = selection.selected(grade.study, np.random.default_rng(0), lambda text: None)
    assert found.chosen == chosen
    near = margin_of_the_end(found)
    assert 0.05 < confidence_of(near, answer_of(Verdict.MISSING if chosen else Verdict.NOTHING, chosen)) < 0.6


def test_what_acts_on_the_command_beside_hysteresis_must_be_more_than_its_form(dead_zone):
    def least(name: str, beside: str) -> float:
        return least_share(replace(dead_zone.steps[-1].tried[0], name=name), [beside])

    assert least("dead_zone", "hysteresis") == LEAST_COMMAND > least("dead_zone", "grade")
    assert least("grade", "hysteresis") == least("grade", "dead_zone") < LEAST_COMMAND
    assert least("unnamed:pump_current_ma", "hysteresis") < LEAST_COMMAND


def test_what_stood_in_for_a_better_core_is_dropped_once_that_is_there():
    """A servo of second order is looked for again beside what was found: a rate limit of 9 A/s had its place."""
    one = study([drive(400.0, 1, noise_mps=0.002, pair=(0.55, 0.7))], parse("arx:na=1,nb=3,delay_s=0.4"), None, 0.2)
    there = one.base.explanation
    assert there.core.servo_hz
    lags = replace(there.core, servo_hz=0.0, lag_s=0.3, second_lag_s=0.2)
    bare = one.search.judged("", one.search.fitted(replace(there, core=lags)))
    said = diagnose(replace(one, base=bare))
    assert (said.verdict, said.effects) == (Verdict.NOTHING, ())
    assert said.base.explanation.core.servo_hz
    assert said.base.loss < 1.05 * one.base.loss < 0.2 * bare.loss
