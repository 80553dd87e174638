"""The diagnosis names what was hidden in a drive, says nothing of nothing, and says the same when it is asked again."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import EFFECTS
from cruise.effects.dead_zone import DeadZone
from cruise.identification.structures import parse
from cruise.report.diagnosis import sentence
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import (
    LEAST_FORETOLD,
    answer_of,
    confidence_of,
)
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.exchange import Place
from cruise.validation.foretold import CHANCE
from cruise.validation.selection import Selected
from cruise.validation.study import study
from cruise.validation.tried import (
    ALIKE,
    LEAST_GAIN,
    LOOSE,
    MUCH,
    enough,
)
from cruise.validation.unnamed import SPEED
from cruise.validation.verdict import answered
from tests.validation.diagnosing import DT_S, HEADER, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, begun, few, found
from tests.validation.driving import GRAVITY_MPS2, drive, wander
from tools.trial.run import table_without

EVERY = pytest.mark.parametrize("which", ["nothing", "grade", "dead_zone", "unlisted"])


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
    (effect,) = grade.final.explanation.effects
    assert effect.idle == set(effect.spare), "nothing is won by what it does not need"
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


@EVERY
def test_every_candidate_was_tried_or_refused(which, request):
    one = request.getfixturevalue(which)
    tried = {each.name for each in one.steps[0].tried}
    refused = {each.effect: each.reason for each in one.refused}
    assert {name for name in tried if not name.startswith(UNNAMED)} | set(refused) == set(EFFECTS)
    assert {name for name in tried if name.startswith(UNNAMED)} == {
        f"{UNNAMED}{name}" for name in ("pump_current_ma", "pitch_deg", "header_height_mm", SPEED)
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
    left = one.left.missing if one.effects else 0.0
    assert one.confidence == confidence_of(one.margin, answer_of(one.verdict, one.effects), left)
    others = sum(line.confidence for line in one.ranking if line.effect not in one.effects)
    named = [line for line in one.ranking if line.effect in one.effects]
    assert all(line.confidence == one.confidence for line in named)
    assert others <= 1.0 - one.confidence + 1e-9
    if one.verdict is Verdict.MISSING:
        assert one.ranking[0].effect == one.effects[0]
        assert min(one.ranking, key=lambda line: line.error_after_mps).effect == one.effects[0]
        assert one.ranking[0].error_after_mps < 0.6 * before


def test_an_effect_that_was_found_and_leaves_too_much_is_no_more_likely_than_its_evidence(grade, monkeypatch):
    monkeypatch.setattr("cruise.validation.diagnose.left_over", lambda study, found: replace(grade.left, foretold=1.5))
    one = diagnose(grade.study)
    assert (one.verdict, one.effects, one.steps[0].taken) == (Verdict.UNLISTED, (), "grade")
    assert sum(line.confidence for line in one.ranking) == pytest.approx(1.0 - one.confidence)


@EVERY
def test_verdicts_as_clear_as_these_are_sure(which, request):
    one = request.getfixturevalue(which)
    if one.verdict is Verdict.NOTHING:
        assert one.confidence > 0.5
        return
    assert one.confidence > (0.75 if one.verdict is Verdict.UNLISTED else 0.8)
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
    said = []
    slope_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = diagnose(begun(command=lambda u: np.maximum(u - 400.0, 0.0), load_mps=slope_mps), said.append)
    assert one.verdict is Verdict.MISSING
    assert set(one.effects) == {"grade", "dead_zone"}
    assert len(one.steps) >= 2
    assert one.steps[1].before.loss < one.steps[0].before.loss
    assert np.sqrt(one.final.loss) == pytest.approx(0.02 / np.sqrt(2.0), rel=0.35)
    first, last = one.effects
    assert said.count(f"tried {last} beside {first}") == 1  # what the last one is exchanged for was tried in its place


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


def test_a_droop_that_the_recorded_engine_speed_does_not_show_is_named_beside_what_that_does():
    engine = wander(SAMPLES, DT_S, 15, 0.06, 5.0)
    load_pct = 55.0 + wander(SAMPLES, DT_S, 16, 20.0, 4.0)
    gain = (1.0 + engine) * (1.0 - 0.0025 * np.maximum(load_pct - 30.0, 0.0))
    columns = {"engine_speed_rpm": 2000.0 * (1.0 + engine), "engine_load_pct": load_pct}
    with few():
        one = diagnose(study([drive(SECONDS, 4, DT_S, 0.01, gain=gain, columns=columns)], STRUCTURE, None, PERIOD_S))
    assert one.effects == ("engine_speed", "engine_droop")
    assert one.final.loss < 0.01 * one.base.loss
    assert "engine_droop" not in {other.effect for other in one.refused}, "it was, before the speed was there"


def test_two_signals_that_move_as_one_are_not_told_apart():
    """Oil that warms and an engine that slows by the same curve: either explains the drive."""
    slow = wander(SAMPLES, DT_S, 21, 1.0, 5.0)
    gain = 1.0 - 0.08 * slow
    columns = {"engine_speed_rpm": 2100.0 * gain, "oil_temperature_c": 50.0 + 33.0 * np.log1p((1.0 - gain) / 0.3)}
    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.02, gain=gain, columns=columns)], STRUCTURE, None, PERIOD_S))
    assert one.verdict is Verdict.AMBIGUOUS
    assert {"engine_speed", "oil_temperature"} <= set(one.effects)
    assert set(one.look_alikes[0]) == set(one.effects)
    told = {line.effect: line.confidence for line in one.ranking}
    assert [told[name] for name in one.effects] == [0.5 * one.confidence] * 2, "either is it, and nobody knows which"
    assert all(f"{name}: {EFFECTS[name].about.experiment}." in one.next_experiment for name in one.effects)
    assert one.margin < ALIKE
    assert one.confidence < confidence_of(2.0 * ALIKE, "ambiguous")


def test_the_first_of_two_that_look_alike_is_the_one_that_the_model_holds(grade):
    step = grade.steps[0]
    mine, other = (next(one for one in step.tried if one.name == name) for name in ("grade", "coulomb_friction"))
    less = replace(mine.compared, raw=0.9 * mine.compared.raw)
    steps = (replace(step, tried=(mine, replace(other, compared=less))), *grade.steps[1:])
    answer = answered(
        Selected(steps, ("grade",), grade.final, ()), grade.left, [Place("grade", 1.0, ("coulomb_friction",))]
    )
    assert (answer.verdict, answer.effects) == (Verdict.AMBIGUOUS, ("grade", "coulomb_friction"))
    assert answer.final is grade.final
    assert answer.next_experiment.startswith("grade: ")


def test_a_memory_of_the_current_that_no_effect_has_is_unlisted():
    def play(current_ma: np.ndarray) -> np.ndarray:
        result = current_ma.copy()
        for i in range(1, len(current_ma)):
            result[i] = min(max(result[i - 1], current_ma[i] - 60.0), current_ma[i] + 60.0)
        return result

    with table_without(["hysteresis"]):
        assert found(command=play).verdict is Verdict.UNLISTED
    with table_without(["hysteresis", "dead_zone"]):  # what sticks has a memory, too
        one = found(command=play)
    assert one.verdict is Verdict.UNLISTED
    assert one.signals[0] == "pump_current_ma"
    assert one.effects == ()
    assert not one.untold
    assert not replace(one, signals=()).untold  # foretold by several together, and by none alone
    assert "by no one signal" in sentence(replace(one, signals=()))
    assert one.left.hidden.loss > LEAST_FORETOLD * one.base.loss


def test_beside_what_was_found_the_catch_all_finds_little(grade, dead_zone, nothing):
    for one in (grade, dead_zone, nothing):
        assert one.left.hidden.loss < 0.5 * LEAST_FORETOLD * one.base.loss or one.left.hidden.share < CHANCE
