"""The diagnosis names what was hidden in a drive, says nothing of nothing, and says the same when it is asked again."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import EFFECTS, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.identification.structures import parse
from cruise.report.diagnosis import sentence
from cruise.validation import selection, tried
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import (
    CURVES,
    LEAST_FORETOLD,
    LEAST_MARGIN,
    LEAST_UNTOLD,
    answer_of,
    confidence_of,
    margin_of_the_end,
    untold,
)
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose
from cruise.validation.foretold import CHANCE
from cruise.validation.mediator import MEDIATED
from cruise.validation.search import Judged
from cruise.validation.study import Study, study
from cruise.validation.tried import (
    ALIKE,
    ANYHOW,
    BEYOND_DOUBT,
    FEW,
    LEAST_GAIN,
    LOOSE,
    MUCH,
    RARE,
    RESISTANCE,
    RESISTS,
    SOME,
    SURE,
    WHOLE,
    Tried,
    asked,
    enough,
    may_be_soil,
    whole,
)
from tests.validation.driving import GRAVITY_MPS2, drive, wander
from tools.trial.run import table_without

SECONDS, DT_S, PERIOD_S = 160.0, 0.1, 0.2
SAMPLES = round(SECONDS / DT_S)
STRUCTURE = parse("arx:na=1,nb=3,delay_s=0.4")
PITCH = wander(SAMPLES, DT_S, 11, 2.5, 5.0)
HEADER = 300.0 + wander(SAMPLES, DT_S, 12, 60.0, 2.0)


def begun(**hidden) -> Study:
    columns = {"pitch_deg": PITCH, "header_height_mm": HEADER}
    return study([drive(SECONDS, 4, DT_S, 0.02, columns=columns, **hidden)], STRUCTURE, None, PERIOD_S)


def found(**hidden) -> Diagnosis:
    return diagnose(begun(**hidden))


@pytest.fixture(scope="module")
def nothing() -> Diagnosis:
    return found()


@pytest.fixture(scope="module")
def grade() -> Diagnosis:
    return found(load_mps=-0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH)))


@pytest.fixture(scope="module")
def dead_zone() -> Diagnosis:
    return found(command=lambda u: np.maximum(u - 400.0, 0.0))


@pytest.fixture(scope="module")
def unlisted() -> Diagnosis:
    return found(load_mps=0.3 * np.cos((HEADER - 300.0) / 60.0))


def test_where_nothing_is_missing_nothing_is_named(nothing):
    assert nothing.verdict is Verdict.NOTHING
    assert nothing.effects == nothing.signals == nothing.look_alikes == ()
    assert nothing.next_experiment == ""
    assert nothing.final is nothing.base
    assert len(nothing.steps) == 1
    (step,) = nothing.steps
    assert all(one.gain < LEAST_GAIN for one in step.tried)
    assert nothing.margin > 0.0


def test_a_slope_that_costs_speed_is_grade(grade):
    assert grade.verdict is Verdict.MISSING
    assert grade.effects == ("grade",)
    assert grade.signals == ()
    assert grade.next_experiment == EFFECTS["grade"].about.experiment
    (load,) = grade.final.explanation.loads
    assert load == pytest.approx(0.35, abs=0.02)
    assert np.sqrt(grade.final.loss) < 0.2 * np.sqrt(grade.base.loss)


def test_a_dead_zone_is_found_by_the_current_alone(dead_zone):
    assert dead_zone.verdict is Verdict.MISSING
    assert dead_zone.effects == ("dead_zone",)
    (effect,) = dead_zone.final.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.threshold_ma == pytest.approx(400.0, abs=6.0)


def test_what_depends_on_a_column_that_no_effect_reads_is_unlisted(unlisted):
    assert unlisted.verdict is Verdict.UNLISTED
    assert unlisted.effects == ()
    assert unlisted.signals == ("header_height_mm",)
    assert "header_height_mm alone" in unlisted.next_experiment
    assert unlisted.steps[0].tried[0].name == f"{UNNAMED}header_height_mm"
    assert np.sqrt(unlisted.final.loss) < 0.8 * np.sqrt(unlisted.base.loss)


EVERY = pytest.mark.parametrize("which", ["nothing", "grade", "dead_zone", "unlisted"])


def test_a_curve_that_leaves_far_less_error_has_the_word_with_as_much_evidence(unlisted):
    first = replace(unlisted.steps[0], background=copy(unlisted.steps[0].background))
    curve, rival = first.tried[0], next(one for one in first.tried if not one.name.startswith(UNNAMED))
    step = replace(first, tried=(curve, replace(rival, evidence=curve.evidence, gain=curve.gain)))

    def word(left: float) -> tuple[Tried | None, float]:
        return selection._curve(step, curve.evidence, left)

    loss, first.background.noise = curve.judged.loss, 0.8 * curve.judged.loss
    assert word(2.0 * loss)[0] is curve, "above the noise it leaves a sixth"
    assert word(4.0 * loss)[1] > word(2.0 * loss)[1] > 0.0, "the farther the surer"
    assert word(1.5 * loss) == (None, 0.0), "not far above the noise"
    first.background.noise = 0.99 * loss
    assert word(1.5 * loss)[0] is curve, "nothing is left above the noise"
    assert word(1.4 * loss) == (None, 0.0), "and yet it is not much less"
    fewer = replace(first, tried=(curve, replace(rival, evidence=0.85 * curve.evidence, gain=curve.gain)))
    assert selection._curve(fewer, 0.85 * curve.evidence, 1.4 * loss)[0] is curve, "but there is clearly more evidence"
    more = replace(first, tried=(curve, replace(rival, evidence=1.2 * curve.evidence, gain=curve.gain)))
    assert selection._curve(more, 0.0, 10.0 * loss) == (None, 0.0), "there is more evidence for an effect"
    assert selection._curve(first, 0.0, 1.25 * loss)[0] is curve, "much more evidence than for all effects"
    assert selection._curve(first, 0.0, 1.15 * loss) == (None, 0.0), "and yet they leave hardly more"
    moved = replace(first, tried=(replace(curve, credit=0.9), rival))
    assert selection._curve(moved, 0.0, 1.01 * loss / MEDIATED)[0] is not None
    assert selection._curve(moved, 0.0, 0.99 * loss / MEDIATED) == (None, 0.0), "soil that nobody recorded shows there"
    better = replace(rival, compared=replace(curve.judged, raw=0.99 * curve.judged.raw), sureness=SURE)
    assert selection._curve(replace(first, tried=(curve, better)), 0.0, 10.0 * loss) == (None, 0.0), "an effect does"


def test_a_curve_that_explains_less_needs_evidence_that_no_soil_has(unlisted):
    least, evidence, sure = selection.PLAINLY_CURVED
    first = unlisted.steps[0]
    curve = replace(first.tried[0], gain=1.01 * least, evidence=1.01 * evidence, sureness=1.01 * sure, credit=1.0)

    def word(**less: float) -> Tried | None:
        return selection._curve(replace(first, tried=(replace(curve, **less),)), 0.0, first.before.loss)[0]

    assert word() is not None
    for less in ({"gain": 0.99 * least}, {"evidence": 0.99 * evidence}, {"sureness": 0.99 * sure}):
        assert word(**less) is None
    assert word(gain=1.01 * selection.LEAST_CURVED, evidence=0.99 * evidence, sureness=0.99 * sure) is not None


def test_what_stands_in_for_an_effect_that_nobody_listed_is_seen_by_what_a_curve_takes_beside_it():
    with table_without(["dead_zone"]):
        one = found(command=lambda u: np.maximum(u - 400.0, 0.0))
    assert one.steps[0].taken == "coulomb_friction"
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ("pump_current_ma",))
    assert "a free curve of `pump_current_ma` lowers the error" in sentence(one), "alone it leaves hardly more"
    assert one.final.loss < LOOSE * one.steps[1].tried[0].judged.loss


def test_what_depends_on_another_signal_beside_an_effect_that_is_needed_does_not_take_its_name():
    one = found(command=lambda u: np.maximum(u - 500.0, 0.0), load_mps=0.1 * np.cos((HEADER - 300.0) / 60.0))
    assert (one.verdict, one.effects, one.signals) == (Verdict.MISSING, ("dead_zone",), ())
    assert one.beside == "header_height_mm"
    assert "most of what is left depends on header_height_mm" in sentence(one)


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
    for name, own in (("dead_zone", "pump_current_ma"), ("coulomb_friction", "speed_mps")):
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


def test_what_is_far_from_the_share_of_a_further_effect_leaves_no_doubt(dead_zone):
    last = dead_zone.steps[-1]
    rest = next(one for one in last.tried if not one.name.startswith(UNNAMED))

    def margin(share: float) -> float:
        left = replace(last.before, raw=last.before.raw - share * dead_zone.steps[-2].before.raw)
        much = replace(rest, evidence=500.0, gain=0.3, credit=1.0, judged=left)
        found = selection.Selected((*dead_zone.steps[:-1], replace(last, tried=(much,))), dead_zone.effects, left, ())
        return margin_of_the_end(found)

    assert margin(0.5 * selection.LEAST_SHARE) == pytest.approx(0.5 * selection.FURTHER)
    assert margin(2.0 * selection.LEAST_SHARE) == LEAST_MARGIN


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


def test_an_effect_that_leaves_more_of_what_could_be_explained_than_it_takes_is_not_what_is_missing(grade):
    last = grade.steps[-1]

    def found_so(left: float, noise: float) -> selection.Selected:
        """It leaves so much of the first loss, where noise is so much of it."""
        background = copy(last.background)
        background.noise = noise * grade.base.loss
        final = replace(grade.final, raw=left * grade.base.loss / grade.final.loss * grade.final.raw)
        return selection.Selected((*grade.steps[:-1], replace(last, background=background)), grade.effects, final, ())

    assert untold(selection.Selected(grade.steps, grade.effects, grade.final, ()), 0.0) < 0.2
    assert untold(found_so(0.65, 0.1), 0.0) > 1.0
    assert untold(found_so(0.5, 0.1), 0.0) < 1.0
    assert untold(found_so(0.65, 0.4), 0.0) < 1.0, "most of that is noise"
    alone = replace(found_so(0.65, 0.1), chosen=())
    assert untold(alone, 0.0) == pytest.approx(np.sqrt(0.65 / 0.1) / LEAST_UNTOLD)
    drift = 0.5 * alone.final.loss
    assert untold(alone, drift) == pytest.approx(np.sqrt(0.5) * untold(alone, 0.0)), "soil that wanders is no effect"
    assert untold(found_so(0.65, 0.1), 0.4 * grade.base.loss) < 1.0, "and it hides no effect that explains the rest"


@EVERY
def test_every_candidate_was_tried_or_refused(which, request):
    one = request.getfixturevalue(which)
    tried = {each.name for each in one.steps[0].tried}
    refused = {each.effect: each.reason for each in one.refused}
    assert {name for name in tried if not name.startswith(UNNAMED)} | set(refused) == set(EFFECTS)
    assert {name for name in tried if name.startswith(UNNAMED)} == {
        f"{UNNAMED}{name}" for name in ("pump_current_ma", "pitch_deg", "header_height_mm", "speed_mps")
    }
    assert refused["engine_speed"] == "engine_speed_rpm is not recorded"
    counted = [each.counted for each in one.steps[0].tried]
    assert counted == sorted(counted, reverse=True)


@EVERY
def test_the_ranking_is_of_errors_ahead_and_its_confidences_are_shares(which, request):
    one = request.getfixturevalue(which)
    assert {line.effect for line in one.ranking} == {
        t.name for t in one.steps[0].tried if not t.name.startswith(UNNAMED)
    }
    (before,) = {line.error_before_mps for line in one.ranking}
    assert before == pytest.approx(np.sqrt(one.base.loss))
    assert 0.0 < one.confidence < 1.0
    assert one.confidence == confidence_of(one.margin, answer_of(one.verdict, one.effects))
    others = sum(line.confidence for line in one.ranking if line.effect not in one.effects)
    named = [line for line in one.ranking if line.effect in one.effects]
    assert all(line.confidence == one.confidence for line in named)
    assert others <= 1.0 - one.confidence + 1e-9
    if one.verdict is Verdict.MISSING:
        assert one.ranking[0].effect == one.effects[0]
        assert min(one.ranking, key=lambda line: line.error_after_mps).effect == one.effects[0]
        assert one.ranking[0].error_after_mps < 0.6 * before


@EVERY
def test_verdicts_as_clear_as_these_are_sure(which, request):
    one = request.getfixturevalue(which)
    if one.verdict is Verdict.NOTHING:
        assert one.confidence > 0.5
        return
    assert one.confidence > 0.8
    assert one.margin > 2.0 * ALIKE
    best = one.steps[0].tried[0]
    rivals = [each for each in one.steps[0].tried[1:] if not each.name.startswith(UNNAMED)]
    assert one.margin <= best.counted - rivals[0].counted
    assert best.sureness > 4.0


def test_it_says_the_same_twice_and_what_it_is_doing(unlisted):
    heard: list[str] = []
    again = diagnose(begun(load_mps=0.3 * np.cos((HEADER - 300.0) / 60.0)), heard.append)
    assert {"tried dead_zone", "tried any dependence on header_height_mm"} <= set(heard)
    assert again.ranking == unlisted.ranking
    assert (again.verdict, again.signals, again.margin) == (unlisted.verdict, unlisted.signals, unlisted.margin)
    for one, other in zip(again.steps[0].tried, unlisted.steps[0].tried, strict=True):
        assert (one.name, one.gain, one.sureness) == (other.name, other.gain, other.sureness)
    np.testing.assert_array_equal(again.final.fit.vector, unlisted.final.fit.vector)


def test_what_the_model_has_is_not_missing_again():
    """The same drive, given the dead zone."""
    with_it = parse("arx:na=1,nb=3,delay_s=0.4+dead_zone")
    recording = drive(SECONDS, 4, DT_S, 0.02, lambda u: np.maximum(u - 400.0, 0.0), columns={"pitch_deg": PITCH})
    one = diagnose(study([recording], with_it, None, PERIOD_S))
    assert one.verdict is Verdict.NOTHING
    assert "dead_zone" not in {each.name for each in one.steps[0].tried} | {each.effect for each in one.refused}


def test_two_things_that_are_missing_are_both_named():
    one = found(command=lambda u: np.maximum(u - 400.0, 0.0), load_mps=-0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH)))
    assert one.verdict is Verdict.MISSING
    assert set(one.effects) == {"grade", "dead_zone"}
    assert len(one.steps) >= 2
    assert one.steps[1].before.loss < one.steps[0].before.loss
    assert np.sqrt(one.final.loss) == pytest.approx(0.02 / np.sqrt(2.0), rel=0.35)


def test_two_things_of_which_none_is_enough_alone_are_both_named():
    """On soil that nobody recorded each hides what the other explains."""
    one = found(
        command=lambda u: 0.5 * u + 0.5 * u**2 / 900.0,
        load_mps=-0.2 * GRAVITY_MPS2 * np.sin(np.radians(PITCH)) + wander(SAMPLES, DT_S, 77, 0.03, 4.0),
    )
    assert not any(enough(tried) for tried in one.steps[0].tried if tried.name in EFFECTS)
    assert one.verdict is Verdict.MISSING
    assert set(one.effects) == {"grade", "quadratic_gain"}
    assert {step.taken for step in one.steps} == {"grade", "quadratic_gain", ""}
    assert one.final.loss < (1.0 - MUCH) * one.base.loss
    assert one.confidence < 0.8


def test_two_signals_that_move_as_one_are_not_told_apart():
    """Oil that warms and an engine that slows by the same curve: either explains the drive."""
    slow = wander(SAMPLES, DT_S, 21, 1.0, 5.0)
    gain = 1.0 - 0.08 * slow
    columns = {"engine_speed_rpm": 2100.0 * gain, "oil_temperature_c": 50.0 + 33.0 * np.log1p((1.0 - gain) / 0.3)}
    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.02, gain=gain, columns=columns)], STRUCTURE, None, PERIOD_S))
    assert one.verdict is Verdict.AMBIGUOUS
    assert {"engine_speed", "oil_temperature"} <= set(one.effects)
    assert set(one.look_alikes[0]) == set(one.effects)
    assert all(f"{name}: {EFFECTS[name].about.experiment}." in one.next_experiment for name in one.effects)
    assert one.margin < ALIKE
    assert one.confidence < confidence_of(2.0 * ALIKE, "ambiguous")


def test_a_gain_that_is_not_sure_is_not_named(grade, monkeypatch):
    for name in ("SURE", "BEYOND_DOUBT", "ANYHOW"):
        monkeypatch.setattr(f"cruise.validation.tried.{name}", 2.0 * max(one.sureness for one in grade.steps[0].tried))
    monkeypatch.setattr("cruise.validation.tried.RARE", (tried.SURE, RARE[1]))
    monkeypatch.setattr("cruise.validation.tried.WHOLE", (WHOLE[0], tried.SURE))
    one = diagnose(grade.study)
    assert one.untold  # a great error all the same
    assert one.effects == ()
    assert one.steps[0].tried[0].gain == grade.steps[0].tried[0].gain > LEAST_GAIN


def test_what_few_blocks_hold_needs_more_evidence(grade):
    one, (rare, times) = replace(grade.steps[0].tried[0], gain=0.4, credit=1.0), RARE
    assert enough(replace(one, evidence=1.1 * times * asked(0.4), sureness=1.1 * rare))
    assert not enough(replace(one, evidence=0.9 * times * asked(0.4), sureness=1.1 * rare))
    assert not enough(replace(one, evidence=1e4, sureness=0.9 * rare))


@pytest.mark.parametrize("name", sorted(RESISTANCE))
def test_what_soil_looks_like_needs_more_of_everything_where_it_takes_little(grade, name):
    one = replace(grade.steps[0].tried[0], name=name, gain=0.4, credit=1.0, sureness=SURE)
    asks = RESISTS * asked(0.4)
    assert may_be_soil(replace(one, evidence=0.9 * asks))
    assert not may_be_soil(replace(one, evidence=1.1 * asks))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, sureness=ANYHOW))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, gain=1.01 * FEW))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, name="grade"))


def test_what_takes_all_that_can_be_explained_is_named_with_little_evidence(grade):
    step = replace(grade.steps[0], background=copy(grade.steps[0].background))
    before, (gain, sure) = step.before, WHOLE
    step.background.noise = 0.5 * before.loss
    one = replace(step.tried[0], gain=1.1 * gain, credit=1.0, evidence=1.1 * SOME, sureness=1.1 * sure)

    def takes(share: float) -> Tried:
        return replace(one, judged=replace(before, raw=(1.0 - 0.5 * share) * before.raw))

    assert not enough(takes(0.95))
    assert whole(takes(0.95), step)
    assert not whole(takes(0.85), step), "soil that looks like friction takes as much"
    for less in ({"gain": 0.9 * gain}, {"evidence": 0.9 * SOME}, {"sureness": 0.9 * sure}):
        assert not whole(replace(takes(0.95), **less), step)


def test_little_evidence_needs_more_standard_errors(grade):
    one = replace(grade.steps[0].tried[0], gain=0.4, credit=1.0)
    assert enough(replace(one, evidence=SOME, sureness=BEYOND_DOUBT))
    assert not enough(replace(one, evidence=0.9 * SOME, sureness=BEYOND_DOUBT))
    assert enough(replace(one, evidence=0.9 * SOME, sureness=ANYHOW))
    assert not enough(replace(one, evidence=-SOME, sureness=ANYHOW))


def test_a_memory_of_the_current_that_no_effect_has_is_unlisted():
    def play(current_ma: np.ndarray) -> np.ndarray:
        result = current_ma.copy()
        for i in range(1, len(current_ma)):
            result[i] = min(max(result[i - 1], current_ma[i] - 60.0), current_ma[i] + 60.0)
        return result

    with table_without(["hysteresis"]):
        one = found(command=play)
    assert one.verdict is Verdict.UNLISTED
    assert one.signals[0] == "pump_current_ma"
    assert one.effects == ()
    assert not one.untold
    assert not replace(one, signals=()).untold  # foretold by several together, and by none alone
    assert "by no one signal" in sentence(replace(one, signals=()))
    assert one.hidden.loss > LEAST_FORETOLD * one.base.loss


def test_beside_what_was_found_the_catch_all_finds_little(grade, dead_zone, nothing):
    for one in (grade, dead_zone, nothing):
        assert one.hidden.loss < 0.5 * LEAST_FORETOLD * one.base.loss or one.hidden.share < CHANCE


@pytest.mark.parametrize("answer", CURVES)
def test_confidence_rises_with_the_margin_towards_one(answer):
    values = [confidence_of(margin, answer) for margin in (-1.0, 0.0, 1.0, 10.0, 60.0, 1e30)]
    assert values == sorted(values)
    assert values[0] == values[1] > 0.0
    assert values[-1] == pytest.approx(1.0, abs=1e-3)


def test_several_effects_at_once_are_another_answer_than_one():
    named = ("grade",), ("dead_zone",), ("wheel_slip",), ("grade", "dead_zone")
    answers = [answer_of(Verdict.MISSING, names) for names in named]
    assert answers == ["measured", "inferred", "smooth", "several"]
    assert {answer_of(verdict, ()) for verdict in set(Verdict) - {Verdict.MISSING}} | set(answers) == set(CURVES)


# -- line pressure holds every force


def pressed(pressure_bar: np.ndarray, load_mps: np.ndarray, **hidden) -> Diagnosis:
    columns = {"pitch_deg": PITCH, "header_height_mm": HEADER, "line_pressure_bar": pressure_bar}
    one = drive(SECONDS, 4, DT_S, 0.02, columns=columns, load_mps=load_mps, **hidden)
    return diagnose(study([one], STRUCTURE, None, PERIOD_S))


def bent(current_ma: np.ndarray) -> np.ndarray:
    """A characteristic that rises ever more steeply, as behind a dead zone whose edge is worn."""
    return np.maximum(current_ma - 350.0, 0.0)


def test_what_acts_on_the_command_is_weighed_where_the_pressure_shows_every_force():
    soil_mps = wander(SAMPLES, DT_S, 13, 0.06, 4.0)
    blind, seeing = found(load_mps=soil_mps, command=bent), pressed(120.0 - 300.0 * soil_mps, soil_mps, command=bent)
    assert (seeing.verdict, seeing.effects) == (Verdict.MISSING, ("dead_zone",))
    first = seeing.steps[0]
    mine = next(one for one in first.tried if one.name == "dead_zone")
    alone = next(one for one in blind.steps[0].tried if one.name == "dead_zone")
    assert mine.compared is not mine.judged
    assert mine.compared.loss < 0.2 * mine.judged.loss
    assert mine.evidence > 3.0 * alone.evidence
    assert first.forces is not None
    assert blind.steps[0].forces is None


def test_a_force_that_the_pressure_shows_is_nothing_that_acts_on_the_command():
    pull_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = pressed(120.0 - 300.0 * pull_mps, pull_mps)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("grade",))
    first = one.steps[0]
    assert first.forces is None
    assert {"dead_zone", "quadratic_gain", "saturation"} <= set(first.refuted)
    assert all(one.credit == 0.0 for one in first.tried if one.name in first.refuted)
    assert EFFECTS["grade"].stage is Stage.LOAD
    assert "grade" not in first.refuted


def test_a_force_that_the_pressure_does_not_show_is_found_all_the_same():
    pull_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = pressed(wander(SAMPLES, DT_S, 13, 60.0, 4.0), pull_mps)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("grade",))
    assert one.steps[0].refuted == ()


def test_leakage_is_found_beside_what_acts_on_the_command():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.002 * (pressure_bar - 120.0), command=bent)
    assert (one.verdict, set(one.effects)) == (Verdict.MISSING, {"leakage", "dead_zone"})


def test_a_force_that_nobody_recorded_shows_in_the_pressure_and_is_no_leakage():
    wind_mps = wander(SAMPLES, DT_S, 13, 0.2, 4.0)
    one = pressed(120.0 - 300.0 * wind_mps, wind_mps)
    assert one.unrecorded
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ("line_pressure_bar",))
    assert one.explained
    assert one.final.loss < 0.1 * one.base.loss
    assert "a force that nobody recorded. It shows in `line_pressure_bar`" in sentence(one)


def test_what_the_pressure_costs_whoever_moves_it_is_leakage():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.004 * (pressure_bar - 120.0))
    assert not one.unrecorded
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))


def test_one_recorded_signal_that_foretells_the_pressures_force_is_what_nobody_lists():
    pull_mps = 0.3 * np.cos((HEADER - 300.0) / 60.0)
    one = pressed(120.0 - 300.0 * (pull_mps + 0.1 * wander(SAMPLES, DT_S, 13, 0.2, 4.0)), pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("header_height_mm",))
    assert not one.unrecorded


# -- nothing recorded shows it


def test_an_error_far_above_the_noise_that_nothing_foretells_has_a_cause_that_nobody_recorded():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.3, 4.0))
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ())
    assert one.untold
    assert not one.unrecorded
    assert not one.explained
    assert "record what else" in one.next_experiment
    assert "Something is missing that nobody recorded" in sentence(one)


def test_soil_that_nobody_recorded_is_no_effect():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.03, 4.0))
    assert one.verdict is Verdict.NOTHING
    assert not one.untold
