"""What is added to a model, and what has the word instead: every limit of the search, from both sides."""

import itertools
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cruise.effects import EFFECTS
from cruise.identification.structures import parse
from cruise.signals import INPUT, OUTPUT
from cruise.validation import curves, selection, tried
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import answer_of, confidence_of, margin_of_the_end
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.judged import Judged
from cruise.validation.mediator import MEDIATED
from cruise.validation.selection import LEAST_COMMAND, least_share
from cruise.validation.study import study
from cruise.validation.tried import (
    BEYOND_DOUBT,
    LEAST_GAIN,
    LOOSE,
    MUCH,
    RARE,
    RESISTANCE,
    SURE,
    WHOLE,
    Step,
    Tried,
    asked,
)
from cruise.validation.unnamed import SPEED
from tests.validation.diagnosing import PITCH, begun
from tests.validation.driving import drive


def word_of(first: Step, chosen: float, left: float, sure: float = 0.0) -> tuple[Tried | None, float]:
    """The curve that has the word where the effects leave a loss `left`, above its own by so many standard errors."""
    present = replace(first.before, raw=first.before.raw * left / first.before.loss)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curves, "sureness", lambda *_: sure)
        return curves.curve_with_the_word(first, chosen, present)


def test_a_curve_that_leaves_far_less_error_has_the_word_with_as_much_evidence(unlisted):
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    curve, rival = first.tried[0], next(one for one in first.tried if not one.name.startswith(UNNAMED))
    step = replace(first, tried=(curve, replace(rival, evidence=curve.evidence, gain=curve.gain)))

    def word(left: float) -> tuple[Tried | None, float]:
        return word_of(step, curve.evidence, left)

    loss, first.background.noise = curve.judged.loss, 0.8 * curve.judged.loss
    assert word(2.0 * loss)[0] is curve, "above the noise it leaves a sixth"
    assert word(4.0 * loss)[1] > word(2.0 * loss)[1] > 0.0, "the farther the surer"
    assert word(1.5 * loss) == (None, 0.0), "not far above the noise"
    first.background.noise = 0.99 * loss
    assert word(1.5 * loss)[0] is curve, "nothing is left above the noise"
    assert word(1.4 * loss) == (None, 0.0), "and yet it is not much less"
    fewer = replace(first, tried=(curve, replace(rival, evidence=0.85 * curve.evidence, gain=curve.gain)))
    assert word_of(fewer, 0.85 * curve.evidence, 1.4 * loss)[0] is curve, "but there is clearly more evidence"
    more = replace(first, tried=(curve, replace(rival, evidence=1.2 * curve.evidence, gain=curve.gain)))
    assert word_of(more, 0.0, 10.0 * loss) == (None, 0.0), "there is more evidence for an effect"
    assert word_of(first, 1.0, 1.25 * loss)[0] is curve, "much more evidence than for all effects"
    assert word_of(first, 1.0, 1.15 * loss) == (None, 0.0), "and yet they leave hardly more"
    moved = replace(first, tried=(replace(curve, credit=0.9), rival))
    assert word_of(moved, 0.0, 1.01 * loss / MEDIATED)[0] is not None
    assert word_of(moved, 0.0, 0.99 * loss / MEDIATED) == (None, 0.0), "soil that nobody recorded shows there"
    better = replace(rival, compared=replace(curve.judged, raw=0.99 * curve.judged.raw), sureness=SURE)
    assert word_of(replace(first, tried=(curve, better)), 0.0, 10.0 * loss) == (None, 0.0), "an effect does"


def test_a_curve_that_leaves_more_than_the_effects_together_has_no_word_where_every_force_is_known(unlisted):
    first = unlisted.steps[0]
    curve = first.tried[0]
    rival = next(one for one in first.tried if not one.name.startswith(UNNAMED))
    seeing = replace(first, forces=first.before, tried=(curve, replace(rival, compared=first.before, sureness=SURE)))
    assert word_of(seeing, 0.0, 1.01 * curve.judged.loss)[0] is curve
    assert word_of(seeing, 0.0, 0.99 * curve.judged.loss) == (None, 0.0)


def test_a_cause_that_no_effect_knows_has_the_word_before_the_witness_of_all_that_happens_at_the_wheel(unlisted):
    first = unlisted.steps[0]
    curve, rival = first.tried[0], next(one for one in first.tried if not one.name.startswith(UNNAMED))
    loss = curve.judged.loss

    def word(name: str = "sensor_bias", times: float = 1.1, left: float = 1.01, curve: Tried = curve) -> Tried | None:
        beside = replace(rival, name=name, evidence=times * curve.evidence, gain=curve.gain, sureness=SURE, credit=1.0)
        beside = replace(beside, compared=replace(curve.judged, raw=left * curve.judged.raw))
        return word_of(replace(first, tried=(curve, beside)), 0.0, 1.05 * loss)[0]

    assert word() is curve
    assert word("wheel_slip") is curve
    assert word("grade") is None, "that is a cause itself"
    assert word(left=0.99) is None, "the witness knows more"
    assert word(times=1.2) is None, "there is much more evidence for it"
    assert word(curve=replace(curve, name=f"{UNNAMED}oil_temperature_c")) is None, "the table has an effect of it"


def test_a_curve_that_explains_less_needs_evidence_that_no_soil_has(unlisted):
    least, evidence, sure = curves.PLAINLY_CURVED
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    curve = replace(first.tried[0], gain=1.01 * least, evidence=1.01 * evidence, sureness=1.01 * sure, credit=1.0)
    first.background.noise = 0.9 * curve.judged.loss

    def word(**less: float) -> Tried | None:
        return word_of(replace(first, tried=(replace(curve, **less),)), 0.0, first.before.loss)[0]

    assert word() is not None
    for less in ({"gain": 0.99 * least}, {"evidence": 0.99 * evidence}, {"sureness": 0.99 * sure}):
        assert word(**less) is None
    assert word(gain=1.01 * curves.LEAST_CURVED, evidence=0.99 * evidence, sureness=0.99 * sure) is not None


def test_a_curve_that_leaves_nothing_but_noise_need_not_leave_much_less_than_effects_that_surely_leave_more(unlisted):
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    curve = first.tried[0]
    loss, apart = curve.judged.loss, tried.APART
    first.background.noise = 0.99 * loss
    assert word_of(first, 1.0, 1.1 * loss, apart)[0] is curve
    assert word_of(first, 1.0, 1.1 * loss, 0.99 * apart) == (None, 0.0)
    assert word_of(first, 1.0, 0.99 * loss, apart) == (None, 0.0), "they leave less"
    assert word_of(replace(first, tried=(replace(curve, credit=0.9),)), 1.0, 1.1 * loss, apart) == (None, 0.0)
    first.background.noise = 0.9 * loss
    assert word_of(first, 1.0, 1.1 * loss, apart) == (None, 0.0), "something else is left, such as soil"


def test_a_curve_that_leaves_nothing_but_noise_need_not_explain_much(unlisted):
    """A stop that is seldom reached: a few blocks hold all of it."""
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    _, evidence, sure = curves.PLAINLY_CURVED
    little = replace(first.tried[0], gain=1.01 * curves.WHITE_GAIN, evidence=0.6 * evidence, sureness=0.5 * sure)
    loss = little.judged.loss

    def word(noise: float, **less: float) -> Tried | None:
        first.background.noise = noise * loss
        return word_of(replace(first, tried=(replace(little, **less),)), 0.0, first.before.loss)[0]

    assert word(0.99) is not None
    assert word(0.9) is None, "something else is left, such as soil"
    assert word(0.99, gain=0.99 * curves.WHITE_GAIN) is None
    assert word(0.99, evidence=0.3 * evidence) is None, "a little of everything brings as much"
    assert word(0.99, credit=0.9) is None, "soil that nobody recorded shows there"


def test_of_curves_that_leave_nothing_but_noise_the_one_that_leaves_least_has_the_word(unlisted):
    """With a little less evidence, too: a curve of the speed takes much of what bends with the current."""
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    best = first.tried[0]
    first.background.noise = 0.99 * best.judged.loss
    less = 0.9 * best.judged.raw
    other = replace(best, name=f"{UNNAMED}{SPEED}", evidence=0.9 * best.evidence)
    other = replace(other, judged=replace(best.judged, raw=less), compared=replace(best.compared, raw=less))
    found, margin = word_of(replace(first, tried=(best, other)), 0.0, first.before.loss)
    assert found is other
    assert margin > 0.0


def test_a_curve_that_errs_less_only_by_a_little_of_something_else_has_no_word(dead_zone):
    """A curve of the current knows the direction, too, and so the dry friction that every drive has a little of."""
    last = replace(dead_zone.steps[-1], background=copy(dead_zone.steps[-1].background))
    rest = next(one for one in last.tried if not one.name.startswith(UNNAMED))
    last.background.noise = 0.9 * rest.compared.loss

    def more(signal: str, left: float, credit: float = 1.0, of_curve: float = 1.0) -> bool:
        curve = replace(rest, name=f"{UNNAMED}{signal}", judged=replace(rest.judged, raw=of_curve * rest.judged.raw))
        friction = replace(rest, credit=credit, judged=replace(rest.judged, raw=left * rest.judged.raw))
        return curves.effects_are_more(curve, ("dead_zone",), replace(last, tried=(friction,)))

    assert more(INPUT, LOOSE - 0.01)
    assert not more(INPUT, LOOSE + 0.01)
    assert more(INPUT, 0.5, of_curve=0.5)
    assert not more(INPUT, 0.5, of_curve=0.5, credit=0.0), "what counts for nothing explains nothing"
    assert not more("header_height_mm", LOOSE - 0.01), "no effect that was found acts through that"
    last.background.noise = rest.judged.loss
    assert more(INPUT, curves.WHITE - 0.01), "noise is all that the curve leaves"
    assert not more(INPUT, curves.WHITE + 0.01)


@pytest.mark.parametrize("better", [False, True])
def test_a_search_that_is_begun_anew_comes_to_an_end(dead_zone, monkeypatch, better):
    """Where a core or another shape seems to make all of what was found superfluous, time and again."""
    alone, beside = dead_zone.steps[0], dead_zone.steps[1]
    rounds, slots = itertools.count(), itertools.count()
    base = replace(alone.before, raw=(0.5 if better else 0.99) * alone.before.raw)

    def tried_again(study, present, possible, chosen, rng, show):
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

    def further(name: str, left: float) -> bool:
        one = replace(last.tried[0], name=name, gain=0.5, evidence=500.0, sureness=5.0, credit=1.0)
        one = replace(one, judged=replace(before, raw=left * before.raw))
        return selection._further(one, replace(last, before=present), before, ("dead_zone",))

    assert further("grade", 0.1)
    assert not further("resonance", 0.1)
    assert not further("transport_delay", 0.1)
    assert further("resonance", 0.04)


def test_a_force_that_is_missing_too_does_not_hide_a_further_effect(grade):
    """What it takes counts against what is left where every force is known, if that is more."""
    before, last = grade.steps[-2].before, grade.steps[-1]

    def left(share: float) -> Judged:
        return replace(before, raw=share * before.raw, white=share * before.white)

    def further(forces: Judged | None, beside: float) -> bool:
        one = replace(last.tried[0], name="dead_zone", gain=0.2, evidence=500.0, sureness=5.0, credit=1.0)
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

    def beside(study, present, everyone, so_far, *_):
        return replace(first, before=present, tried=() if so_far else (one,), taken="")

    monkeypatch.setattr(selection, "tried_beside", beside)
    found = selection.selected(grade.study, np.random.default_rng(0), lambda text: None)
    assert found.chosen == chosen
    near = margin_of_the_end(found)
    assert 0.05 < confidence_of(near, answer_of(Verdict.MISSING if chosen else Verdict.NOTHING, chosen)) < 0.6


def test_a_curve_of_the_speed_is_the_effects_that_are_a_law_of_the_speed_alone():
    mine = {name for name in EFFECTS if curves.of_the_same(name, SPEED)}
    assert mine == {"coulomb_friction", "speed_droop"}
    assert {name for name in EFFECTS if curves.of_the_same(name, "engine_load_pct")} == {
        "engine_droop",
        "crop_load",
    }
    assert not any(curves.of_the_same(name, OUTPUT) for name in EFFECTS)


def test_what_acts_on_the_command_beside_hysteresis_must_be_more_than_its_form():
    assert least_share("dead_zone", ["hysteresis"]) == LEAST_COMMAND > least_share("dead_zone", ["grade"])
    assert least_share("grade", ["hysteresis"]) == least_share("grade", ["dead_zone"]) < LEAST_COMMAND
    assert least_share("unnamed:pump_current_ma", ["hysteresis"]) < LEAST_COMMAND


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
