"""The diagnosis names what was hidden in a drive, says nothing of nothing, and says the same when it is asked again."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import EFFECTS, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.effects.oil_temperature import OilTemperature
from cruise.identification.structures import parse
from cruise.report.diagnosis import look_alikes, sentence
from cruise.report.diagnosis_figures import report
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import (
    LEAST_FORETOLD,
    answer_of,
    confidence_of,
)
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose
from cruise.validation.foretold import CHANCE
from cruise.validation.study import study
from cruise.validation.tried import (
    ALIKE,
    LEAST_GAIN,
    LOOSE,
    MUCH,
    enough,
)
from tests.validation.diagnosing import DT_S, HEADER, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, begun, found
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
    assert np.sqrt(grade.final.loss) < 0.2 * np.sqrt(grade.base.loss)


def test_a_dead_zone_is_found_by_the_current_alone(dead_zone):
    assert dead_zone.verdict is Verdict.MISSING
    assert dead_zone.effects == ("dead_zone",)
    (effect,) = dead_zone.final.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.threshold_ma == pytest.approx(400.0, abs=6.0)


def test_a_detent_is_a_dead_zone_that_gives_all_that_was_asked_for_beyond_it():
    one = found(command=lambda u: np.where(np.abs(u) > 400.0, u, 0.0))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("dead_zone",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, DeadZone)
    currents_ma = np.abs(one.study.recordings[0].input)
    least_ma, most_ma = currents_ma[currents_ma < 400.0].max(), currents_ma[currents_ma > 400.0].min()
    assert least_ma - 3.0 < effect.threshold_ma < most_ma + 3.0, (
        "anywhere between what it stops and what it lets through"
    )
    assert effect.jump_share == 1.0


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


# -- line pressure holds every force


MASS_KG = 15000.0 + wander(SAMPLES, DT_S, 14, 2500.0, 6.0)


def pressed(
    pressure_bar: np.ndarray, load_mps: np.ndarray, mass_kg: np.ndarray | None = None, pitched: bool = True, **hidden
) -> Diagnosis:
    columns = {"header_height_mm": HEADER, "line_pressure_bar": pressure_bar}
    columns |= {"pitch_deg": PITCH} if pitched else {}
    columns |= {} if mass_kg is None else {"machine_mass_kg": mass_kg}
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


def test_where_no_slope_is_recorded_what_the_pressure_costs_is_leakage():
    """Any ground has slopes: that nothing foretells the force is no news of it."""
    slope_mps = -0.05 * PITCH
    one = pressed(120.0 - 300.0 * slope_mps, slope_mps, pitched=False)
    assert not one.unrecorded
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))


def test_what_the_pressure_costs_whoever_moves_it_is_leakage():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.004 * (pressure_bar - 120.0))
    assert not one.unrecorded
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))


def test_leakage_is_one_cause_where_two_forces_would_act_in_just_the_proportion_that_the_pressure_shows():
    slope, weight = np.sin(np.radians(PITCH)), (MASS_KG - MASS_KG.mean()) / 15000.0
    in_proportion = 120.0 + 800.0 * slope + 150.0 * weight
    one = pressed(in_proportion, -0.002 * (in_proportion - 120.0), MASS_KG)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))
    assert any(step.taken == "leakage" and step.mediated > 0.0 for step in one.steps)
    two = pressed(120.0 + 800.0 * slope + 15.0 * weight, -0.002 * (in_proportion - 120.0), MASS_KG)
    assert (two.verdict, set(two.effects)) == (Verdict.MISSING, {"grade", "rolling_resistance"})


def test_leakage_is_one_cause_where_the_slope_is_most_of_the_pressure_and_nobody_recorded_the_rest():
    slope_bar = 800.0 * np.sin(np.radians(PITCH))
    other_bar = wander(SAMPLES, DT_S, 13, 0.6 * float(np.std(slope_bar)), 4.0)
    one = pressed(120.0 + slope_bar + other_bar, -0.004 * (slope_bar + other_bar))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))
    alone = pressed(120.0 + slope_bar + other_bar, -0.004 * slope_bar)
    assert (alone.verdict, alone.effects) == (Verdict.MISSING, ("grade",))
    soil = pressed(120.0 + slope_bar + 0.25 * other_bar, -0.004 * (slope_bar + 0.25 * other_bar))
    assert (soil.verdict, soil.effects) == (Verdict.MISSING, ("grade",))


def test_one_recorded_signal_that_foretells_the_pressures_force_is_what_nobody_lists():
    pull_mps = 0.3 * np.cos((HEADER - 300.0) / 60.0)
    one = pressed(120.0 - 300.0 * (pull_mps + 0.1 * wander(SAMPLES, DT_S, 13, 0.2, 4.0)), pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("header_height_mm",))
    assert not one.unrecorded


def test_the_pressures_force_is_that_of_one_recorded_signal_though_no_smooth_curve_has_its_form():
    pull_mps = -0.6 * np.clip((250.0 - HEADER) / 60.0, 0.0, 0.4)
    one = pressed(120.0 - 300.0 * pull_mps, pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("header_height_mm",))


# -- nothing recorded shows it


def test_an_error_far_above_the_noise_that_nothing_foretells_has_a_cause_that_nobody_recorded():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.3, 4.0))
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ())
    assert one.untold
    assert not one.unrecorded
    assert not one.explained
    assert "record what else" in one.next_experiment
    assert "Something is missing that nobody recorded" in sentence(one)


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


def waiting(current_ma: np.ndarray) -> np.ndarray:
    """A current that comes 0.4 s late for 25 s of every 50."""
    later = DT_S * np.arange(SAMPLES) % 50.0 < 25.0
    return np.where(later, np.concatenate([current_ma[:4], current_ma[:-4]]), current_ma)


def test_a_dead_time_that_changes_is_said_with_how_early_and_how_late_the_answer_comes():
    one = found(command=waiting)
    assert (one.verdict, one.effects, one.signals) == (Verdict.MISSING, ("transport_delay",), ())
    assert one.confidence > 0.5
    assert one.left.dead_time is not None
    assert one.left.dead_time.late_s - one.left.dead_time.early_s == pytest.approx(0.4, abs=0.15)
    assert one.worth_adding == ()
    assert not one.explained
    assert "when every command is sent" in one.next_experiment
    assert "`transport_delay` is missing: " in sentence(one)
    assert f"later ({one.left.dead_time.late_s:+.2f} s)" in sentence(one)
    assert look_alikes(one) == []
    told = report(one, "a.yaml", "arx")
    late = one.left.dead_time
    assert told["dead_time_changes"] == {
        "early_s": late.early_s,
        "late_s": late.late_s,
        "share": late.share,
        "signal": None,
    }
    assert told["worth_adding"] == []


def test_a_dead_time_that_changes_is_found_beside_another_effect():
    one = found(command=waiting, load_mps=-0.05 * PITCH)
    assert (one.verdict, set(one.effects)) == (Verdict.MISSING, {"grade", "transport_delay"})
    assert one.worth_adding == ("grade",)
    assert one.explained
    assert "`grade` and `transport_delay` are missing: with `grade` the error" in sentence(one)


def test_a_dead_time_that_changes_with_a_signal_is_one_though_the_signal_foretells_it():
    low = np.where(DT_S * np.arange(SAMPLES) % 50.0 < 25.0, 1.0, 0.0)
    columns = {"pitch_deg": PITCH, "bus_load_pct": 20.0 + 60.0 * low}
    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.02, columns=columns, command=waiting)], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("transport_delay",))
    assert one.left.foretold == 0.0
    assert one.left.dead_time is not None
    assert one.left.dead_time.signal == "bus_load_pct"
    assert one.next_experiment.startswith("hold everything else and move bus_load_pct")
    assert "than the model, as bus_load_pct has it" in sentence(one)


def test_a_drive_that_cold_oil_slows_down_is_told_by_the_oil():
    """Its dead time seems to change as well: that is what is left of the oil's, which acts before the vehicle."""
    oil_c = 30.0 + 35.0 * np.linspace(0.0, 1.0, SAMPLES) + wander(SAMPLES, DT_S, 14, 3.0, 8.0)
    columns = {"pitch_deg": PITCH, "oil_temperature_c": oil_c}

    def slow(current_ma: np.ndarray) -> np.ndarray:
        lags_s = 0.35 * np.exp((50.0 - oil_c) / 33.0)
        place, places = current_ma[0], []
        for now, lag_s in zip(current_ma.tolist(), lags_s.tolist(), strict=True):
            place += (1.0 - np.exp(-DT_S / lag_s)) * (now - place)
            places.append(place)
        return np.array(places)

    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.01, columns=columns, command=slow)], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("oil_temperature",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, OilTemperature)
    assert effect.pace_exponent > 0.2
    assert abs(effect.loss_share) < 0.01


def test_what_sticks_until_it_breaks_away_is_a_dead_zone():
    def sticking(current_ma: np.ndarray) -> np.ndarray:
        is_open, through = False, []
        for now in current_ma.tolist():
            is_open = abs(now) > (450.0 if is_open else 650.0)
            through.append(now if is_open else 0.0)
        return np.array(through)

    one = found(command=sticking)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("dead_zone",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.jump_share == 1.0
    assert effect.threshold_ma == pytest.approx(650.0, abs=15.0)
    assert effect.release_share * effect.threshold_ma == pytest.approx(450.0, abs=15.0)


def test_soil_that_nobody_recorded_is_no_effect():
    one = found(load_mps=wander(SAMPLES, DT_S, 13, 0.03, 4.0))
    assert one.verdict is Verdict.NOTHING
    assert not one.untold
    assert not one.momentary
    assert np.isnan(one.left.swing_s)
    assert one.left.dead_time is None
    told = report(one, "a.yaml", "arx")
    assert (told["swing_s"], told["dead_time_changes"]) == (None, None)
