"""tools/blind_trial: short trials come out right, sizes are found, lines are kept, and scores are as counted."""

import math
from itertools import cycle

import numpy as np
import pytest
from typer.testing import CliRunner

from cruise.effects import EFFECTS as TABLE
from tools.trial import EFFECTS, UNLISTED, run, sizing
from tools.trial.__main__ import app
from tools.trial.calibration import by_answer, calibrated, confidence, restated
from tools.trial.effects import apart
from tools.trial.plan import KINDS, Kind, Task, plan
from tools.trial.score import NEVER, Line, Share, brier_score, reliability, score
from tools.trial.sizing import MOST_STEPS, RATIOS, Miss, Point, next_size, sized
from tools.trial.trial import SECONDS, SIZES

EVERYTHING = (*EFFECTS, *UNLISTED)


def task(kind: Kind = "single", *effects: str, size: str = "large", seed: int = 3) -> Task:
    return Task(tier="clean", kind=kind, effects=effects, size=size, seed=seed)


def line(kind: Kind, true: tuple[str, ...], verdict: str, named: tuple[str, ...] = (), **more) -> Line:
    seed = more.pop("seed", 3)
    size = more.pop("size", "large")
    return Line(task=task(kind, *true, seed=seed, size=size), verdict=verdict, effects=named, **more)


@pytest.mark.parametrize(
    ("kind", "effect", "size"),
    [("single", "dead_zone", 20.0), ("unlisted", "tyre_pressure", 0.06), ("unlisted", "gear_ratio", 0.045)],
)
def test_a_short_trial_comes_out_right(kind: Kind, effect, size, monkeypatch):
    monkeypatch.setitem(SECONDS, "clean", 240.0)
    known = [Point(tier="clean", effect=effect, seed=3, size=size, ratio=4.0)]
    held = run.hold(task(kind, effect), known)
    assert held.found == ()
    assert held.line.trial is not None
    assert [one.size for one in (*held.line.trial.effects, *held.line.trial.unlisted)] == [size]
    assert held.line.right, held.line
    assert held.line.base_mps > 2.0 * held.line.true_mps > 0.0
    if kind == "single":
        assert held.line.final_mps == pytest.approx(held.line.true_mps, rel=0.03)
    assert list(TABLE)[:2] == ["rate_limit", "hysteresis"]


def test_nothing_is_missing_from_a_short_drive_without_an_effect(monkeypatch):
    monkeypatch.setitem(SECONDS, "clean", 240.0)
    held = run.hold(task("nothing", size=""), ())
    assert held.line.right, held.line
    assert held.line.final_mps == pytest.approx(held.line.true_mps, rel=0.03)


def test_the_experiments_that_an_ambiguous_verdict_names_resolve_it():
    """A speed droop, driven as an operator drives: a curve of the current leaves no larger an error."""
    known = [Point(tier="field", effect="speed_droop", seed=2710, size=0.3666, ratio=2.0)]
    asked = Task(tier="field", kind="single", effects=("speed_droop",), size="medium", seed=2710)
    held = run.hold(asked, known)
    assert (held.line.verdict, set(held.line.effects)) == ("ambiguous", {"speed_droop", "quadratic_gain"})
    assert held.line.resolved == ("speed_droop",)
    assert held.line.right


def test_the_table_is_whole_again_after_an_error():
    before = list(TABLE.items())

    def search() -> None:
        with run.table_without(("grade", "header_drag")):
            assert list(TABLE) == [name for name, _ in before if name != "grade"]
            raise KeyError("stop")

    with pytest.raises(KeyError, match="stop"):
        search()
    assert list(TABLE.items()) == before


# sizes


def test_the_next_size_lies_between_two_points_or_beyond_the_nearer_end():
    def at(size: float, ratio: float) -> Point:
        return Point(tier="clean", effect="grade", seed=1, size=size, ratio=ratio)

    assert next_size([], 2.0, 0.3) == 0.3
    # r^2 - 1 = (x / 0.1)^2: one point on it and the usual power lead to the place itself
    assert next_size([at(0.1, math.sqrt(2.0))], math.sqrt(5.0), 0.3) == pytest.approx(0.2)
    # r^2 - 1 = x^4: power from two points, between them and beyond either
    points = [at(1.0, math.sqrt(2.0)), at(2.0, math.sqrt(17.0))]
    for size in (0.5, 1.5, 3.0):
        assert next_size(points, math.sqrt(1.0 + size**4), 0.3) == pytest.approx(size)
    assert next_size([at(1.0, 1.0)], 4.0, 0.3) == pytest.approx(5.0), "no more than five times as large at once"


def test_a_size_is_found_once_and_known_then(monkeypatch):
    simulated = []

    class Judged:
        def __init__(self, loss: float) -> None:
            self.loss = loss

    class Study:
        def __init__(self, trial) -> None:
            (self.size,) = (one.size for one in trial.effects) if trial.effects else (0.0,)  # the twin
            self.base = Judged(1.0 + (self.size / 0.05) ** 3)

    def simulate(trial):
        simulated.append(trial)
        return trial

    monkeypatch.setattr(sizing, "simulate", simulate)
    monkeypatch.setattr(sizing, "begun", Study)
    monkeypatch.setattr(sizing, "with_truth", lambda study, effects: Judged(1.0))
    known: list[Point | Miss] = []
    for size in SIZES:
        found = sized("clean", "grade", size, 7, known)
        ratio = math.sqrt(1.0 + (found.size / 0.05) ** 3)
        assert ratio == pytest.approx(RATIOS[size], rel=sizing.TOLERANCE)
        known += found.tried
    assert {one.seed for one in simulated} == {7}
    count = len(simulated)
    assert sized("clean", "grade", "large", 7, known).miss is None
    assert len(simulated) == count, "what is known is not tried again"
    assert sized("clean", "grade", "large", 8, known).tried, "another seed is another drive"

    losses = cycle([0.25, 0.01])  # of a base that leaves 1: twice and ten times by turns, never four
    monkeypatch.setattr(Study, "__init__", lambda study, trial: setattr(study, "base", Judged(1.0)))
    monkeypatch.setattr(sizing, "with_truth", lambda study, effects: Judged(next(losses)))
    simulated.clear()
    missed = sized("clean", "grade", "large", 9)
    assert missed.miss is not None
    assert "4 times is not reached" in missed.miss.why
    assert len(simulated) == MOST_STEPS + 1, "the twin, too"
    assert sized("clean", "grade", "large", 9, [missed.miss]).miss == missed.miss
    assert len(simulated) == MOST_STEPS + 1

    wrong = [Point(tier="clean", effect="grade", seed=10, size=0.1, ratio=4.0, left=1.1 * sizing.MOST_LEFT)]
    monkeypatch.setattr(sizing, "with_truth", lambda study, effects: Judged(1.0))
    assert sized("clean", "grade", "large", 10, wrong).tried, "there the true structure is not true"


def test_an_effect_in_no_table_is_measured_by_its_twin(monkeypatch):
    class Judged:
        def __init__(self, loss: float) -> None:
            self.loss = loss

    class Study:
        def __init__(self, trial) -> None:
            self.base = Judged(0.01 + sum(one.size**2 for one in trial.unlisted))

    simulated = []
    monkeypatch.setattr(sizing, "simulate", lambda trial: simulated.append(trial) or trial)
    monkeypatch.setattr(sizing, "begun", Study)
    found = sized("clean", "tyre_pressure", "large", 7)
    assert math.sqrt(1.0 + found.size**2 / 0.01) == pytest.approx(4.0, rel=sizing.TOLERANCE)
    assert [one.unlisted for one in simulated].count(()) == 1, "one twin serves every size"


def test_a_drive_that_does_not_excite_is_drawn_anew(monkeypatch):
    def only_the_third(tier, effect, size, seed, known):
        if seed == 3 + 2 * run.NEXT_DRIVE:
            return sizing.Sized(0.1, ())
        return sizing.Sized(math.nan, (), Miss(tier=tier, effect=effect, seed=seed, size=size, why="no slope"))

    monkeypatch.setattr(run, "sized", only_the_third)
    found = run.sealed(task("single", "grade"), ())
    assert found.trial is not None
    assert (found.trial.seed, found.trial.effects[0].size) == (200003, 0.1)
    assert [why.partition(",")[0] for why in found.misses] == ["grade", "grade"]
    assert len(found.found) == 2
    never = run.hold(task("single", "grade", seed=4), ())
    assert never.line.failed == NEVER
    assert not never.line.held
    assert len(never.line.misses) == run.MOST_DRIVES
    assert not never.line.right


# plan


def test_the_plan_holds_every_effect_in_every_size():
    tasks = plan("clean", KINDS, EVERYTHING, SIZES, range(5))
    assert len({one.key for one in tasks}) == len(tasks)
    kinds = {kind: [one for one in tasks if one.kind == kind] for kind in KINDS}
    assert len(kinds["single"]) == len(EFFECTS) * 3 * 5
    assert len({one.seed for one in kinds["nothing"]}) == 150
    assert {one.effects[0] for one in kinds["unlisted"]} == set(EVERYTHING)
    assert all(len(set(one.effects)) == 2 for one in kinds["two"])
    assert all(len(set(one.effects)) == 3 for one in kinds["three"])
    assert not any(apart(one.effects[0], one.effects[1]) for one in kinds["two"])
    assert {one.seed for one in tasks}.isdisjoint({one.seed for one in plan("clean", KINDS, EVERYTHING, SIZES, [5])})
    assert not plan("clean", ["two"], ["engine_speed", "engine_droop"], SIZES, [0]), "these exclude each other"
    assert tasks[: len(tasks) // 5] == plan("clean", KINDS, EVERYTHING, SIZES, [0]), "seed by seed"


# score


@pytest.mark.parametrize(
    ("held", "right", "first", "said"),
    [
        (line("single", ("grade",), "missing", ("grade",)), True, True, "grade"),
        (line("single", ("grade",), "missing", ("grade", "leakage")), False, True, "grade"),
        (line("single", ("grade",), "missing", ("leakage", "grade")), False, False, "leakage"),
        (line("single", ("grade",), "nothing"), False, False, "nothing"),
        (line("single", ("grade",), "unlisted"), False, False, "unlisted"),
        (line("single", ("grade",), "ambiguous", ("leakage", "grade"), resolved=("grade",)), True, True, "grade"),
        (line("single", ("grade",), "ambiguous", ("leakage", "grade")), False, False, "ambiguous"),
        (
            line("single", ("grade",), "ambiguous", ("leakage", "grade"), resolved=("leakage",)),
            False,
            False,
            "ambiguous",
        ),
        (line("single", ("grade",), "ambiguous", ("leakage", "crop_load")), False, False, "ambiguous"),
        (
            line("single", ("grade",), "ambiguous", ("grade", "leakage", "crop_load"), resolved=("grade",)),
            False,
            False,
            "ambiguous",
        ),
        (line("single", ("grade",), "missing", ("grade",), failed="boom"), False, False, "failed"),
        (line("nothing", (), "nothing"), True, True, "nothing"),
        (line("nothing", (), "missing", ("grade",)), False, False, "grade"),
        (line("unlisted", ("header_drag",), "unlisted", signals=("header_height_mm",)), True, True, "unlisted"),
        (
            line("unlisted", ("header_drag",), "unlisted", signals=("pitch_deg",)),
            False,
            False,
            "unlisted, other signal",
        ),
        (line("unlisted", ("wind",), "unlisted"), True, True, "unlisted"),
        (line("unlisted", ("grade",), "unlisted", signals=("gear", "pitch_deg")), True, True, "unlisted"),
        (line("unlisted", ("grade",), "unlisted", signals=("gear",)), False, False, "unlisted, other signal"),
        (line("unlisted", ("dead_zone",), "unlisted", signals=("pump_current_ma",)), True, True, "unlisted"),
        (line("unlisted", ("grade",), "missing", ("leakage",)), False, False, "leakage"),
        (line("two", ("grade", "gear_ratio"), "missing", ("gear_ratio", "grade")), True, True, "gear_ratio"),
        (line("two", ("grade", "gear_ratio"), "missing", ("gear_ratio",)), False, False, "gear_ratio"),
        (
            line("two", ("grade", "gear_ratio"), "missing", ("gear_ratio", "grade", "leakage")),
            False,
            False,
            "gear_ratio",
        ),
        (line("two", ("grade", "gear_ratio"), "ambiguous", ("gear_ratio", "grade")), False, False, "ambiguous"),
    ],
)
def test_what_is_right(held, right, first, said):
    assert (held.right, held.first, held.said) == (right, first, said)


def test_wilsons_interval():
    # E. B. Wilson's by hand: 3 of 150 -> 0.68 .. 5.71 %; 0 of 10 -> 0 .. 27.75 %
    assert Share(3, 150).interval == pytest.approx((0.0068, 0.0571), abs=1e-4)
    assert Share(0, 10).interval == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert Share(10, 10).interval == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert Share(0, 0).interval == (0.0, 1.0)
    assert math.isnan(Share(0, 0).value)


def test_a_score_counted_by_hand():
    def grade(verdict: str, *named: str, **more) -> Line:
        return line("single", ("grade",), verdict, named, base_mps=4.0, final_mps=2.0, true_mps=2.0, **more)

    lines = [
        grade("missing", "grade", confidence=0.9, size="small", diagnosis_s=1.0, misses=("a", "b")),
        grade("missing", "grade", "leakage", confidence=0.8, diagnosis_s=2.0),
        grade("missing", "leakage", confidence=0.6, diagnosis_s=3.0),
        line("nothing", (), "nothing", confidence=0.95, diagnosis_s=9.0),
        line("nothing", (), "missing", ("grade",), confidence=0.3, seed=4, diagnosis_s=4.0),
        line("unlisted", ("grade",), "unlisted", confidence=0.5, signals=("pitch_deg",), diagnosis_s=4.0),
        line("unlisted", ("wind",), "nothing", confidence=0.5, diagnosis_s=4.0),
        line("two", ("grade", "gear_ratio"), "missing", ("gear_ratio", "grade"), confidence=1.0, diagnosis_s=4.0),
        line("three", ("grade", "gear_ratio", "leakage"), "missing", ("grade",), confidence=0.2, diagnosis_s=4.0),
        line("single", ("dead_zone",), "", failed="boom", size="small"),
        line("single", ("dead_zone",), "", failed=NEVER, misses=("c",), size="large"),
    ]
    found = score(lines)
    assert (found.trials, found.failed, found.misses, found.never) == (10, 1, 3, 1)
    assert found.first == {"small": Share(1, 2), "large": Share(1, 2)}
    assert found.exact == {"small": Share(1, 2), "large": Share(0, 2)}
    assert found.extras == Share(1, 2)
    assert found.false_alarms == Share(1, 2)
    assert found.unlisted == {"never in it": Share(0, 1), "left out": Share(1, 1)}
    assert (found.two, found.three, found.ambiguous) == (Share(1, 1), Share(0, 1), Share(0, 9))
    assert found.resolved == Share(0, 0)
    squares = [0.1, 0.8, 0.6, 0.05, 0.3, 0.5, 0.5, 0.0, 0.2]
    assert found.brier == pytest.approx(sum(x**2 for x in squares) / 9)
    assert found.base_rate == pytest.approx(4 / 9)
    assert found.skill == pytest.approx(1.0 - found.brier / (4 / 9 * 5 / 9))
    assert found.confusion["grade", "leakage"] == 1
    assert found.confusion["grade", "grade"] == 2
    assert found.confusion["unlisted", "nothing"] == 1
    assert sum(found.confusion.values()) == 8
    assert found.fell == {"median": 1.0, "90 %": 1.0, "worst": 1.0}
    assert found.diagnosis_s == {"median": 4.0, "worst": 9.0}


def test_the_error_that_is_left_is_told_by_its_spread():
    ratios = [1.0, 1.0, 1.0, 1.0, 1.5]
    lines = [line("single", ("grade",), "missing", ("grade",), final_mps=2.0 * r, true_mps=2.0) for r in ratios]
    assert score(lines).fell == {"median": 1.0, "90 %": pytest.approx(1.3), "worst": 1.5}


def test_tenths_hold_their_lower_bound():
    lines = [line("nothing", (), verdict, confidence=c) for verdict, c in [("nothing", 0.9), ("missing", 0.95)]]
    lines += [line("nothing", (), "nothing", confidence=1.0), line("nothing", (), "unlisted", confidence=0.3)]
    low, high = reliability(lines)
    assert (low.low, low.stated, low.right) == (0.3, 0.3, Share(0, 1))
    assert (high.low, high.right) == (0.9, Share(2, 3))
    assert high.stated == pytest.approx(0.95)


# calibration


def test_calibration_finds_the_curve_that_made_the_answers():
    rng = np.random.default_rng(5)
    margins = 1.0 + rng.exponential(15.0, 3000)
    right = rng.uniform(size=3000) < 1.0 / (1.0 + (6.0 / margins) ** 2.5)
    lines = [
        line("nothing", (), "nothing" if hit else "unlisted", margin=m, confidence=0.5, seed=n)
        for n, (m, hit) in enumerate(zip(margins.tolist(), right.tolist(), strict=True))
    ]
    curve = calibrated(lines)
    assert curve.half_margin == pytest.approx(6.0, rel=0.1)
    assert curve.steepness == pytest.approx(2.5, rel=0.1)
    assert curve.brier_before == pytest.approx(0.25)
    assert curve.brier_after == pytest.approx(brier_score(restated(lines, {"nothing": curve, "unlisted": curve})))
    assert curve.brier_after < 0.15
    assert confidence(6.0, 6.0, 2.5) == pytest.approx(0.5)
    assert confidence(12.0, 6.0, 2.5) == pytest.approx(1.0 / (1.0 + 0.5**2.5))


def test_a_few_right_answers_are_no_certainty():
    few = [line("nothing", (), "nothing", margin=0.5 * n, confidence=0.5, seed=n) for n in range(1, 6)]
    assert 0.75 < calibrated(few).confidence(1.5) < 0.99


def test_every_kind_of_answer_has_its_own_curve():
    right = [line("nothing", (), "nothing", margin=30.0, confidence=0.5, seed=n) for n in range(20)]
    wrong = [line("single", ("grade",), "missing", ("leakage", "grade"), margin=30.0, confidence=0.5)] * 10
    curves = by_answer([*right, *wrong])
    assert list(curves) == ["nothing", "several"]
    assert curves["several"].confidence(30.0) < 0.2 < 0.9 < curves["nothing"].confidence(30.0)


# run


def test_a_run_goes_on_where_it_stopped(tmp_path):
    done, bad = task("nothing", size=""), task("single", "no_such_effect")
    lines, sizes = tmp_path / "a" / run.LINES, tmp_path / "b" / "sizes.jsonl"
    lines.parent.mkdir()
    run.append(lines, [Line(task=done, verdict="nothing")])
    with lines.open("ab") as file:
        file.write(b'{"task": {"tier": "cle')
    shown: list[Line] = []

    def stop(one: Line) -> None:
        shown.append(one)
        raise KeyboardInterrupt

    tasks, under_way = [done, bad, task("single", "nor_this")], []
    with pytest.raises(KeyboardInterrupt):
        run.go(tasks, lines.parent, sizes, 1, stop, under_way.append)
    assert under_way == [0]
    assert [one.task for one in shown] == [bad], "the one that is done is not held again, the next is not begun"
    assert "no effect no_such_effect" in shown[0].failed
    assert [one.task for one in run.lines_of(lines.parent)] == [done, bad]
    run.append(lines, [Line(task=bad, verdict="nothing")])
    assert [one.failed for one in run.lines_of(lines.parent)] == ["", ""]
    assert run.go([done], lines.parent, sizes, 1, stop) == [Line(task=done, verdict="nothing")]


def test_commands_report_calibrate_and_draw(tmp_path):
    lines = [line("nothing", (), "nothing", margin=0.2, confidence=0.9, seed=n) for n in range(5)]
    lines += [line("single", ("grade",), "missing", ("leakage",), margin=0.1, confidence=0.8)]
    lines += [line("single", ("grade",), "ambiguous", ("leakage", "crop_load"), margin=0.3, confidence=0.8, seed=9)]
    run.append(tmp_path / run.LINES, lines)
    for command, wanted in (
        (["report"], "7 trials"),
        (["report", "--json"], '"false alarms on nothing"'),
        (["calibrate"], "M = "),
        (["picture", "--out", str(tmp_path)], "clean.png"),
    ):
        said = CliRunner().invoke(app, [command[0], str(tmp_path), *command[1:]])
        assert said.exit_code == 0, said.output
        assert wanted in said.output
    assert (tmp_path / "clean.png").stat().st_size > 10_000
    (tmp_path / run.LINES).unlink()
    for command in ("report", "calibrate", "picture"):
        assert CliRunner().invoke(app, [command, str(tmp_path)]).exit_code == 2
    said = CliRunner().invoke(app, ["score", "--out", str(tmp_path), "--effects", "magic"])
    assert said.exit_code == 2
    assert "no magic" in said.output
