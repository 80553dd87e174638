"""When a curve without physics has the word instead of the effects: every limit, from both sides."""

from copy import copy
from dataclasses import replace

import pytest

from cruise.effects import EFFECTS
from cruise.signals import INPUT, OUTPUT
from cruise.validation import curves, tried
from cruise.validation.candidates import UNNAMED
from cruise.validation.left_over import LeftOver
from cruise.validation.mediator import MEDIATED
from cruise.validation.selection import Selected
from cruise.validation.swing import Swing
from cruise.validation.tried import (
    LOOSE,
    SURE,
    Step,
    Tried,
)
from cruise.validation.unnamed import SPEED
from cruise.validation.verdict import Verdict, answered


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


def test_an_effect_that_takes_nearly_all_of_a_curve_of_the_current_is_the_curve(dead_zone):
    """An overlap that leaks is a dead zone still, though a curve leaves far less than a corner does."""
    first = replace(dead_zone.steps[0], background=copy(dead_zone.steps[0].background))
    effect = replace(next(one for one in first.tried if one.name == "dead_zone"), compared=first.before)
    base = first.before.loss
    first.background.noise = 0.009 * base
    curve = replace(effect, name=f"{UNNAMED}{INPUT}", gain=0.99)
    curve = replace(curve, judged=replace(effect.judged, raw=0.01 * first.before.raw))
    curve = replace(curve, compared=curve.judged)

    def word(share: float, **other) -> Tried | None:
        left = base - share * (base - curve.judged.loss)
        raw = left / base * first.before.raw
        mine = replace(effect, judged=replace(effect.judged, raw=raw), evidence=curve.evidence, **other)
        return word_of(replace(first, tried=(curve, mine)), curve.evidence, left)[0]

    least = curves.OF_THE_CURRENT
    assert word(least + 0.002) is None
    assert word(least - 0.002) is curve
    assert word(least + 0.002, name="grade") is curve, "that is no law of the current"
    assert word(least + 0.002, gain=0.0) is curve, "nor is it enough"


def test_a_curve_of_the_speed_is_the_effects_that_are_a_law_of_the_speed_alone():
    mine = {name for name in EFFECTS if curves.of_the_same(name, SPEED)}
    assert mine == {"coulomb_friction", "speed_droop"}
    assert {name for name in EFFECTS if curves.of_the_same(name, "engine_load_pct")} == {
        "engine_droop",
        "crop_load",
    }
    assert not any(curves.of_the_same(name, OUTPUT) for name in EFFECTS)


def test_a_curve_that_takes_too_little_for_the_word_says_what_an_error_that_nothing_explains_depends_on(unlisted):
    first = replace(unlisted.steps[0], taken="")
    seldom = replace(first.tried[0], gain=0.4, evidence=200.0, credit=1.0, sureness=3.0)
    rival = next(one for one in first.tried if not one.name.startswith(UNNAMED))
    left = replace(unlisted.left, foretold=0.0, untold=1.5, swing=Swing())

    def shown(curve: Tried = seldom, beside: float = 20.0, left: LeftOver = left) -> tuple[str, ...]:
        step = replace(first, tried=(curve, replace(rival, evidence=beside, credit=1.0)))
        answer = answered(Selected((step,), (), step.before, ()), left, ())
        assert answer.verdict is Verdict.UNLISTED
        assert (answer.final is curve.judged) == bool(answer.signals)
        return answer.signals

    assert shown() == ("header_height_mm",)
    assert shown(beside=150.0) == (), "nearly as much speaks for an effect"
    assert shown(replace(seldom, gain=0.25)) == ()
    assert shown(replace(seldom, credit=0.6)) == (), "the drive itself moves it"
    assert shown(replace(seldom, evidence=50.0)) == ()
    assert shown(left=replace(left, swing=Swing(8.0, 100.0, 1.0))) == (), "it goes by its own pace"
