"""`cruise diagnose` as a user meets it."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cruise import cli
from cruise.cli import diagnose_words
from cruise.csv_file import write_csv
from cruise.effects import EFFECTS, Stage
from cruise.recording import Recording
from cruise.report import diagnosis, diagnosis_picture, evidence
from cruise.report.diagnosis_figures import report
from cruise.signals import INPUT, OUTPUT
from cruise.validation import verdict
from cruise.validation.candidates import Refused
from cruise.validation.dead_time import DeadTime
from cruise.validation.diagnose import Diagnosis, Verdict
from cruise.validation.numbers import Number
from cruise.validation.tried import LEAST_GAIN
from cruise.validation.unnamed import SPEED
from tests.cli.diagnose.drives import DELAY_S, DT_S, FLOOR, MODEL, PULL, TRIED, ambiguous, drive, unlisted


def said(capsys: pytest.CaptureFixture[str], found: Diagnosis, *options: str) -> str:
    diagnose_words.say(found, FLOOR, MODEL, ["drive.csv"], options, "p.png")
    out = capsys.readouterr().out
    assert max(map(len, (line for line in out.splitlines() if not line.startswith("  cruise ")))) <= 80
    assert not re.search(r"\bnan\b", out)
    assert " -0 " not in out, "no evidence has no sign"
    return " ".join(out.split())


def test_the_verb_prints_the_object_of_the_design_and_nothing_else(verb, tmp_path):
    write_csv(drive(1, PULL), tmp_path / "drive.csv")
    assert "diagnose" in cli.VERBS
    code, out, err = verb("diagnose", "drive.csv", "--model", MODEL, "--json", "--picture", "p.svg")
    assert (code, err) == (0, "")
    found = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    design = ["verdict", "effects", "signals", "ranking", "look_alikes", "next_experiment"]
    assert list(found)[:6] == design
    assert (found["verdict"], found["effects"], found["signals"]) == ("missing", ["grade"], [])
    first = found["ranking"][0]
    assert set(first) == {"effect", "error_before_mps", "error_after_mps", "confidence"}
    assert first["effect"] == "grade"
    assert first["error_after_mps"] < 0.8 * first["error_before_mps"]
    assert 0.0 < first["confidence"] < 1.0
    assert found["error_before_mps"] == first["error_before_mps"]
    assert found["error_after_mps"] == pytest.approx(first["error_after_mps"], rel=0.02)  # fitted on, in the last step
    load = next(one for one in found["parameters"]["grade"] if one["name"] == "load")
    assert abs(load["value"] - PULL) < 4.0 * load["standard_error"] < PULL
    assert load["plausible"]
    delay = next(one for one in found["moved"] if one["name"] == "delay_s")
    assert (delay["of"], delay["unit"]) == ("core", "s")
    assert delay["after"] == pytest.approx(DELAY_S, abs=0.15)
    assert [one["added"] for one in found["steps"]] == [["grade"]]
    refused = {one["effect"]: one["reason"] for one in found["refused"]}
    assert "never moves" in refused["engine_speed"]
    assert "is not recorded" in refused["gear_ratio"]
    assert (found["picture"], found["seed"]) == ("p.svg", 20051)
    assert (tmp_path / "p.svg").read_text().startswith("<?xml")
    assert not (tmp_path / "out").exists()


def test_the_verdict_comes_first_and_everything_that_follows_from_it(hills, capsys):
    out = said(capsys, hills, "--period", "0.2")
    first = hills.ranking[0]
    last = evidence.error_mps(hills.final)
    before, after = (diagnosis.figure(value) for value in (first.error_before_mps, last))
    assert out.startswith(
        f"`grade` is missing: with it the error 3 s ahead falls from {before} to {after} m/s on data that the "
        f"fit has not seen (confidence {diagnosis.confidence(hills.confidence)})."
    )
    for words in (
        "a part of the machine's weight pulls along the ground",
        "phi = -(9.81 m/s2",
        "noise floor 3 s ahead: at least 0.0100 m/s, at most 0.0120 m/s",
        "m/s per phi above 0 plausible",
        "what moved in the rest of the model",
        "each effect alone beside the model, 3 s ahead, held out",
        "any curve of",
        "`grade` or `rolling_resistance`: not ruled out, machine_mass_kg is not recorded",
        "`grade` or `leakage`: not ruled out, line_pressure_bar is not recorded",
        "constant current over a hill",
        "`engine_speed`: engine_speed_rpm never moves: it stays at 2100 rpm - not excited, not absent",
        "`gear_ratio`: gear is not recorded - it can't be blamed",
        f"cruise add grade --model {MODEL} drive.csv --period 0.2 -o better.yaml add judges the discrete",
        "picture: p.png",
    ):
        assert words in out


def test_where_nothing_is_missing_it_says_what_could_have_hidden(flat, capsys):
    out = said(capsys, flat)
    assert out.startswith("Nothing is missing: no effect that these recordings can speak of lowers the error 3 s ahead")
    before = flat.ranking[0].error_before_mps
    assert f"ahead by less than {diagnosis.figure(np.sqrt(0.15) * before)} m/s RMS would not have been named" in out
    assert "at its best fit moves it by" in out
    assert "cruise add" not in out
    assert json.loads(json.dumps(report(flat, MODEL, MODEL), allow_nan=False))["effects"] == []


def test_no_effect_of_the_table_takes_more_than_what_is_said_to_be_the_most(flat):
    step, gains = flat.steps[0], {"unnamed:pitch_deg": 0.4, "grade": 0.1, TRIED[0]: 0.2, TRIED[1]: 0.23}
    tried = tuple(replace(one, gain=gains[one.name]) for one in step.tried if one.name in gains)
    for order in (tried, tried[::-1]):
        found = replace(flat, steps=(replace(step, tried=order),))
        assert diagnosis.hidden_share(found) == 0.23
        assert "m/s, by as much as 13 % (" in diagnosis.sentence(found), "1 - 0.77^0.5 is 12.3 %"
    assert diagnosis.hidden_share(replace(flat, steps=(replace(step, tried=()),))) == LEAST_GAIN


def test_what_is_not_in_the_table_is_named_by_its_signal_and_its_curve(hills, capsys):
    found = unlisted(hills)
    out = said(capsys, found)
    assert out.startswith("Something is missing that is none of the effects that cruise knows: a free curve of `pitch_")
    assert "the likeliest effect, `grade`, leaves" in out
    assert "what depends on pitch_deg" in out
    assert "cruise add 'custom(of_pitch_deg, gain, 1 + p1 * (pitch_deg" in out
    assert "cruise add 'custom(of_pitch_deg, load, -(pitch_deg" in out
    (dependence,) = report(found, MODEL, MODEL)["dependence"]
    slope = np.polyfit(dependence["values"], dependence["curve"], 1)[0]
    assert slope == pytest.approx(-PULL * 9.81 * np.pi / 180.0, rel=0.25)


def test_the_first_by_evidence_is_called_likeliest_though_another_leaves_less(hills, monkeypatch, capsys):
    step = hills.steps[0]
    grade, rival = [one for one in step.tried if not one.name.startswith("unnamed:")][:2]
    less = replace(rival, judged=replace(grade.judged, raw=0.9 * grade.judged.raw))
    tried = tuple(less if one is rival else one for one in step.tried)
    found = replace(unlisted(hills), steps=(replace(step, tried=tried),))
    leaves = diagnosis.figure(evidence.error_mps(grade.judged))
    assert f"; the likeliest effect, `grade`, leaves {leaves} m/s (" in diagnosis.sentence(found)
    monkeypatch.setattr(diagnose_words, "LINES", 1)
    assert f"and {len(found.ranking) - 1} effects more, with no more evidence" in said(capsys, found)


def test_a_drive_that_is_as_quick_as_a_core_may_be_is_said_to_be(hills):
    (said_of_it,) = diagnosis.of_the_core(with_core(hills, lag_s=0.0201, second_lag_s=0.005, time_constant_s=0.0301))
    assert said_of_it.startswith("the drive answers within 0.055 s, as quickly as a core may be here: ")
    assert diagnosis.of_the_core(hills) == []


def test_of_a_quick_drive_a_shorter_period_is_advised_where_it_comes_to_rest(hills):
    found = replace(hills, effects=("dead_zone",))
    (advice,) = diagnosis.of_the_core(with_core(found, lag_s=0.1, second_lag_s=0.1, time_constant_s=0.1))
    assert advice.startswith("the drive answers within 0.3 s, hardly two samples of 0.2 s: `--period 0.1` tells ")
    assert "`coulomb_friction` and `dead_zone` apart" in advice
    assert diagnosis.of_the_core(with_core(found, lag_s=0.25, second_lag_s=0.1, time_constant_s=0.1)) == []
    assert diagnosis.of_the_core(with_core(hills, lag_s=0.1, second_lag_s=0.1, time_constant_s=0.1)) == []


def with_core(found: Diagnosis, **parts: float) -> Diagnosis:
    fit = found.base.fit
    layout = replace(fit.layout, start=replace(fit.explanation, core=replace(fit.explanation.core, **parts)), slots=())
    return replace(found, base=replace(found.base, fit=replace(fit, layout=layout, vector=np.zeros(0))))


def test_a_curve_that_takes_much_and_is_not_believed_comes_with_what_it_would_have_to_take(hills, capsys):
    first = hills.steps[0]
    why = "it is believed only where it leaves clearly less than every effect and takes 45 % or more, or 30 % with an"
    for gain, verdict_of in ((0.34, "nothing"), (0.1, "nothing"), (0.34, "missing")):
        tried = tuple(replace(one, gain=gain) if "unnamed" in one.name else one for one in first.tried)
        found = replace(hills, steps=(replace(first, tried=tried), *hills.steps[1:]))
        if verdict_of == "nothing":
            found = replace(found, verdict=Verdict.UNLISTED, effects=(), final=hills.base, steps=found.steps[:1])
        assert (why in said(capsys, found)) == (gain > 0.3 and verdict_of == "nothing")


def test_the_recordings_own_names_of_current_and_speed_are_said(hills, capsys):
    (recording,) = hills.study.recordings
    found = replace(hills, study=replace(hills.study, recordings=(replace(recording, input_unit="per cent"),)))
    called = {INPUT: "throttle", OUTPUT: "vx_mps"}
    diagnose_words.say(found, FLOOR, MODEL, ["drive.csv"], [], "p.png", called=called)
    assert (
        "as the recordings have it, pump_current_ma is `throttle`, 1 of it 10 mA; ground_speed_mps is `vx_mps`"
    ) in " ".join(capsys.readouterr().out.split())
    diagnose_words.say(found, FLOOR, MODEL, ["drive.csv"], [], "p.png", called={INPUT: INPUT, OUTPUT: OUTPUT})
    assert "as the recordings have it" not in capsys.readouterr().out


def test_the_models_own_speed_is_called_so_and_is_no_column(hills, capsys):
    curve = next(one for one in hills.steps[0].tried if one.name == f"unnamed:{SPEED}")
    found = replace(unlisted(hills), signals=(SPEED,), final=curve.judged)
    first = replace(hills.steps[0], tried=tuple(one for one in hills.steps[0].tried if "unnamed" not in one.name))
    with_curve = replace(first, tried=(curve, *first.tried))
    out = said(capsys, replace(found, steps=(with_curve,), next_experiment=""))
    for words in ("a free curve of the model's own speed lowers", "what depends on the model's own speed", "any curve"):
        assert words in out
    assert SPEED not in out
    assert diagnosis_picture._called([curve.name]) == "a curve of the model's own speed"
    assert "move the speed alone" in verdict._vary((SPEED,))


def test_what_can_not_be_told_apart_comes_with_every_experiment(hills, capsys):
    out = said(capsys, ambiguous(hills))
    assert out.startswith("`grade` or `coulomb_friction` is missing, and these recordings can't tell which")
    assert "`grade` or `coulomb_friction`: can't be told apart" in out
    assert out.count("can't be told apart") == 1
    experiments = out[out.index("next experiment") :]
    assert "`grade`: constant current over a hill" in experiments
    assert "`coulomb_friction`: " in experiments
    assert "cruise add" not in out
    assert f"cruise diagnose drive.csv NEW.csv --model {MODEL} picture:" in out


def test_what_was_taken_back_is_neither_drawn_nor_reported(hills):
    """Where a curve comes in and makes an effect superfluous, the model is the one with the curve alone."""
    first = hills.steps[0]
    curve_fit, other = (
        next(one.judged for one in first.tried if one.name == name) for name in ("unnamed:pitch_deg", TRIED[0])
    )
    found = replace(unlisted(hills), steps=(first, replace(first, before=other)))
    assert [one.dropped for one in evidence.rungs(found)] == [(), (TRIED[0],)]
    said = report(found, MODEL, MODEL)
    assert said["parameters"] == {}
    assert said["error_after_mps"] == evidence.error_mps(curve_fit)
    shown = diagnosis_picture._shown(found)
    assert [one.added for one in shown] == [("unnamed:pitch_deg",)]
    assert [label for label, _, _ in diagnosis_picture._models(found, shown)][1:] == ["with a curve of pitch_deg"]


def test_commands_can_be_copied_and_what_hardly_moves_is_not_excited(hills, capsys):
    hardly = Refused("engine_speed", "engine_speed_rpm hardly moves: it stays at 2100 rpm", still=True)
    refused = (Refused("gear_ratio", "gear never moves: it stays at 2", still=True), hardly)
    diagnose_words.say(replace(hills, refused=refused), FLOOR, "my model.yaml", ["drive.csv"], [], "p.png")
    out = capsys.readouterr().out
    assert "cruise add grade --model 'my model.yaml' drive.csv -o better.yaml" in out
    assert "`gear_ratio`: gear never moves: it stays at 2 - not excited, not absent" in out
    assert "2100 rpm - not excited, not absent" in " ".join(out.split())


def test_a_model_whose_own_parameters_are_wrong_lacks_no_effect_and_is_fitted_anew(verb, tmp_path):
    late = drive(2, 0.0)
    current = late.columns[INPUT]
    early = replace(late, columns={**late.columns, INPUT: np.concatenate([current[:1].repeat(3), current[:-3]])})
    write_csv(early, tmp_path / "drive.csv")  # as if the machine answered 0.3 s earlier
    write_csv(late, tmp_path / "late.csv")
    assert verb("identify", "drive.csv", "--model", MODEL, "-o", "known.yaml")[0] == 0
    figures = {}
    for name in ("drive", "late"):
        code, out, _ = verb("diagnose", f"{name}.csv", "--model", "known.yaml", "--json")
        assert code == 0
        figures[name] = json.loads(out)
    own = {name: one["own_parameters"] for name, one in figures.items()}
    assert own["drive"]["error_mps"] < 1.1 * own["drive"]["refitted_error_mps"]
    assert own["late"]["error_mps"] > diagnose_words.STALE * own["late"]["refitted_error_mps"]
    _, out, _ = verb("diagnose", "late.csv", "--model", "known.yaml")
    assert "its parameters are wrong here, no effect is missing" in " ".join(out.split())
    assert "cruise identify late.csv --model known.yaml -o refitted.yaml" in out


def test_why_its_own_parameters_can_not_be_judged_is_said(flat, capsys):
    own = diagnose_words.Own(refused="unstable predictor")
    assert not own.stale
    assert own.figures == {"refused": "unstable predictor"}
    diagnose_words.say(flat, FLOOR, MODEL, ["drive.csv"], [], "p.png", own)
    assert "how well its own parameters fit can't be said: unstable predictor" in capsys.readouterr().out


def test_a_rival_as_good_is_not_called_beaten(hills, capsys):
    first = hills.steps[0]
    grade, rival = [one for one in first.tried if not one.name.startswith("unnamed:")][:2]
    tied = tuple(
        replace(one, judged=grade.judged, compared=grade.compared) if one is rival else one for one in first.tried
    )
    out = said(capsys, replace(hills, steps=(replace(first, tried=tied), *hills.steps[1:])))
    assert f"`grade` or `{rival.name}`: leaves" in out
    assert "too close for the errors to decide (+0.0 standard errors)" in out


def test_a_dead_time_that_only_the_models_taps_can_hold_is_said(flat, capsys):
    core = flat.final.explanation.core
    assert flat.study.delay_s == 0.5
    assert core.delay_s < 0.7
    assert "the dead time is" not in said(capsys, flat)
    short = replace(flat, study=replace(flat.study, delay_s=core.delay_s - 0.25))
    assert f"the dead time is {core.delay_s:.2f} s, and the model's is" in said(capsys, short)
    assert f"compare says whether delay_s={core.delay_s - 0.05:.3g} errs less" in said(capsys, short)
    assert report(short, MODEL, MODEL)["dead_time_s"] == {
        "model": core.delay_s - 0.25,
        "found": pytest.approx(core.delay_s, rel=1e-3),
    }


def test_a_rival_that_errs_less_is_said_to(hills, capsys):
    first = hills.steps[0]
    grade, rival = [one for one in first.tried if not one.name.startswith("unnamed:")][:2]
    assert f"`grade` or `{rival.name}`: leaves" in said(capsys, hills)
    assert "standard errors more" in said(capsys, hills)
    better = replace(grade.compared, raw=0.5 * grade.compared.raw, white=0.5 * grade.compared.white)
    tried = tuple(replace(one, compared=better) if one is rival else one for one in first.tried)
    assert "standard errors less" in said(capsys, replace(hills, steps=(replace(first, tried=tried), *hills.steps[1:])))


def test_an_effect_that_stands_for_every_force_is_mentioned_where_it_does_as_well_alone(hills, capsys):
    first = hills.steps[0]

    def with_pressure(judged):
        tried = (*first.tried, replace(first.tried[0], name="leakage", judged=judged))
        return replace(hills, steps=(replace(first, tried=tried), *hills.steps[1:]))

    as_well = with_pressure(hills.final)
    assert "can't say whether that force slows the machine through it" in said(capsys, as_well)
    assert "through it. To tell" not in said(capsys, with_pressure(hills.base))
    no_force = next(name for name, kind in EFFECTS.items() if kind.stage is not Stage.LOAD)
    assert not any("through it. To tell" in one for one in diagnosis.forces(replace(as_well, effects=(no_force,))))


def test_what_does_not_count_in_full_is_said_to(hills, capsys):
    first = hills.steps[0]
    rival = [one for one in first.tried if not one.name.startswith("unnamed:")][1]
    tried = tuple(replace(one, credit=0.25) if one is rival else one for one in first.tried)
    counted = replace(hills, steps=(replace(first, tried=tried), *hills.steps[1:]))
    why = "for its signal answers to the drive itself, or its best fit has a shape that no such effect has"
    out = said(capsys, counted)
    assert f"*: only what counts of it, {why} " in out
    assert f"it counts for 25 %, {why} " in out
    assert "pressure speaks against it" not in out, "none was recorded"
    in_full = replace(first, tried=tuple(replace(one, credit=1.0) for one in first.tried))
    assert "only what counts of it" not in said(capsys, replace(hills, steps=(in_full, *hills.steps[1:])))
    (recording,) = hills.study.recordings
    columns = {**recording.columns, "line_pressure_bar": np.full(len(recording), 150.0)}
    shown = replace(hills.study, recordings=(replace(recording, columns=columns),))
    assert f"{why}, or the line pressure speaks against it" in said(capsys, replace(counted, study=shown))


def test_several_effects_are_added_one_after_the_other(hills, capsys):
    first, second = [one for one in hills.steps[0].tried if not one.name.startswith("unnamed:")][:2]
    steps = (hills.steps[0], replace(hills.steps[0], before=first.judged, tried=(second, first)))
    found = replace(hills, effects=(first.name, second.name), steps=steps, final=second.judged)
    out = said(capsys, found)
    assert out.startswith(f"`{first.name}` and `{second.name}` are missing: with them the error")
    assert "how the error 3 s ahead fell, held out" in out
    assert f"+ {second.name}" in out
    assert f"--model {MODEL} drive.csv -o better.yaml" in out
    assert f"cruise add {second.name} --model better.yaml drive.csv -o better_2.yaml" in out


def test_a_dead_time_that_changes_is_no_step_and_why_is_said(hills, capsys):
    names = ("grade", "coulomb_friction", "transport_delay")
    first, second = (evidence.first_tried(hills, name) for name in names[:2])
    assert first is not None
    assert second is not None
    steps = (hills.steps[0], replace(hills.steps[0], before=first.judged))
    late = replace(hills.left, dead_time=DeadTime(0.3, -0.1, 0.2))
    found = replace(hills, effects=names, steps=steps, final=second.judged, left=late)
    out = said(capsys, found)
    assert "without transport_delay: it changes, and a constant one lowers the error by little" in out
    assert "step 2" in out
    assert "step 3" not in out
    assert "without transport_delay" not in said(capsys, replace(found, left=hills.left, effects=names[:2]))


def test_what_is_not_told_or_at_its_bound_is_said_below_the_tables(hills, monkeypatch, capsys):
    def fitted(study, judged):
        delay = Number("core", "delay_s", "s", 0.1, 40.0, 0.0, 2.0, math.nan, "")
        gain = Number("core", "gain_mps_per_ma", "m/s per mA", 0.1, 0.01, 0.0, math.inf, math.nan, "")
        return [delay, gain, Number("grade", "load", "m/s per phi", 0.5, 0.01, 0.0, 0.5, 0.0, "")]

    monkeypatch.setattr(diagnose_words, "numbers", fitted)
    out = said(capsys, hills)
    assert "at its bound: load; what the recordings ask for lies beyond what is plausible" in out
    assert "nothing moved beyond its errors not told by the data, before or after: delay_s each effect" in out


def test_a_curve_that_answers_to_the_drive_has_the_mark_of_what_does_not_count_in_full(hills, capsys):
    first = hills.steps[0]
    curve = evidence.best_unnamed(hills)
    assert curve is not None
    whole = replace(curve, evidence=908.0, credit=1.0)
    for one, words in ((replace(whole, credit=0.25), " 227* "), (whole, " 908 ")):
        tried = tuple(one if other is curve else replace(other, credit=1.0) for other in first.tried)
        out = said(capsys, replace(hills, steps=(replace(first, tried=tried), *hills.steps[1:])))
        assert words in out
        assert ("only what counts of it" in out) == (one.credit < 1.0)


MISTAKES = {
    "none.csv --model arx1": "none.csv: no such file",
    "short.csv --model arx1": "s of the recordings can be judged, too little",
    "still.csv --model arx1": "the current never changes",
    "short.csv --model arx10b": "did you mean arx10B?",
    "short.csv --model narx1": "NARX",
    "short.csv --model arx:na=1,nb=0,delay_s=0": "a model without the current",
    "short.csv --model arx1 --horizon 0": "--horizon 0: give a time",
    "short.csv --model arx1 --period -1": "--period -1: give a time",
    "short.csv --model arx1 --picture p.txt": "--picture p.txt: let the name end in .png",
    "short.csv --model arx1 --output nothing": "nothing",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_gets_one_clear_line(verb, tmp_path, words):
    short = drive(1, 0.0, seconds=20.0)
    write_csv(short, tmp_path / "short.csv")
    long = drive(1, 0.0, seconds=120.0)
    still = {**long.columns, INPUT: np.full(len(long), 512.0)}
    write_csv(Recording(long.time_s, still, DT_S, "still"), tmp_path / "still.csv")
    code, out, err = verb("diagnose", *words.split())
    assert (code, out) == (2, "")
    assert MISTAKES[words] in err
    assert err.startswith("cruise: ")
    assert len(err.splitlines()) == 1
    assert not Path("out/diagnose.png").exists()
