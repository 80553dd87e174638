"""`cruise add` and `cruise ladder` as a user meets them."""

import json
import re
import sys
from pathlib import Path

import msgspec
import pytest

from cruise import cli, settings
from cruise.cli.add import _change
from cruise.cli.places import CONFIG
from cruise.csv_file import write_csv
from cruise.model import files
from cruise.plant import PlantSettings
from cruise.report.added import absent
from cruise.service import course, demo
from cruise.service import settings as service_settings
from cruise.validation import ladder as validation
from cruise.validation.noise_floor import Bound, NoiseFloor
from cruise.validation.numbers import NO_SIGN
from tests.validation.machine import record

MODEL = "arx:na=1,nb=3,delay_s=0.4"
TERM = "custom(slope, load, -pitch_deg)"


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> Path:
    """One machine on hills, its pump curved, in two recordings."""
    folder = tmp_path_factory.mktemp("drives")
    for seed, seconds, name in ((1, 240.0, "hills.csv"), (2, 120.0, "again.csv")):
        drive = record(seed=seed, seconds=seconds, noise_mps=0.01, grade_mps_per_deg=0.03, curvature=0.3)
        write_csv(drive, folder / name)
    return folder


def known_floor(*_: object) -> NoiseFloor:
    """The noise floor of these drives; finding it takes longer than all the rest, and has tests of its own."""
    return NoiseFloor(Bound(0.005, 0.0045, 0.0055), 0.005, 2.0, 10.0, Bound(0.006, 0.005, 0.007), 1000)


@pytest.fixture
def quick(monkeypatch) -> None:
    monkeypatch.setattr(validation, "noise_floor", known_floor)


def said(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.fixture(scope="module")
def rungs(drives) -> dict[str, str]:
    """The texts of two model files, the second one step above the first; made once."""
    paths = [drives / name for name in ("one.yaml", "two.yaml")]
    for effect, model, path in (("grade", MODEL, paths[0]), ("quadratic_gain", paths[0], paths[1])):
        words = ("cruise", "add", effect, "--model", model, drives / "hills.csv", "-o", path, "--json")
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(sys, "argv", [str(word) for word in words])
            patched.setattr(validation, "noise_floor", known_floor)
            with pytest.raises(SystemExit) as ended:
                cli.main()
        assert not ended.value.code
    return {path.name: path.read_text() for path in paths}


@pytest.fixture
def built(rungs, tmp_path) -> Path:
    """These files where the verb runs."""
    for name, text in rungs.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.fixture
def ladders(drives, built) -> Path:
    """Bad model files beside the good ones, and a recording."""
    two = (built / "two.yaml").read_text()
    a_1 = str(files.read(built / "two.yaml").parameters["a_1"])
    (built / "nonsense.yaml").write_text(two.replace("effect: grade", "effect: crop_load"))
    (built / "cut.yaml").write_text(two[: len(two) // 2])
    (built / "off.yaml").write_text(two.replace(a_1, "0.5", 1))
    (built / "plain.yaml").write_bytes((CONFIG / "factory_model.yaml").read_bytes())
    (built / "hills.csv").write_bytes((drives / "hills.csv").read_bytes())
    (built / "own.csv").write_text((drives / "hills.csv").read_text().replace("ground_speed_mps", "v", 1))
    return built


@pytest.mark.usefixtures("quick")
def test_it_says_what_the_effect_is_worth_and_writes_the_model(verb, drives, tmp_path):
    code, out, err = verb(
        "add", "grade", "--model", MODEL, drives / "hills.csv", "-o", "better.yaml", "--period", "0.1"
    )
    assert (code, err) == (0, "")
    for words in (
        f"grade added to {MODEL}",
        "1 recording, 2399 samples of 0.1 s",
        "held-out error 3 s ahead: 0.",
        "% less",
        "noise floor: at least 0.00",
        "grade.load m/s",
        "gain_mps_per_ma m/s per mA 0.00",
        "model: better.yaml; next: cruise ladder better.yaml",
    ):
        assert words in flat(out)
    assert max(map(len, out.splitlines())) <= 80
    file = files.read(tmp_path / "better.yaml")
    assert (file.period_s, file.na, list(file.effects)) == (0.1, 1, ["grade"])
    assert file.core is not None
    assert file.core.gain_mps_per_ma == pytest.approx(
        0.00325, rel=0.1
    )  # its steady gain over the range it was driven in
    assert file.provenance.made_by == f"cruise add grade --model {MODEL}"
    start, last = file.history
    assert (start.structure, start.effect, start.before) == (MODEL, "", None)
    assert last.effect == "grade"
    assert last.before is not None
    assert last.error_before_mps == start.error_after_mps
    assert last.error_before_mps is not None
    assert file.provenance.error_ahead_mps == last.error_after_mps < last.error_before_mps
    assert (last.samples, last.recordings[0].rpartition("/")[2]) == (2399, "hills.csv, 0.1 to 239.9 s")


@pytest.mark.usefixtures("quick")
def test_json_holds_every_figure(verb, drives, tmp_path):
    recordings = drives / "hills.csv", drives / "again.csv"
    code, out, err = verb("add", "quadratic_gain", "--model", f"{MODEL}+grade", *recordings, "--json")
    assert (code, err) == (0, "")
    found = said(out)
    assert (found["effect"], found["model_file"], found["period_s"], found["horizon_s"]) == (
        "quadratic_gain",
        None,
        0.2,
        3,
    )
    assert [Path(one).name for one in found["recordings"]] == ["hills.csv", "again.csv"]
    assert found["error_after_mps"] < 0.8 * found["error_before_mps"]
    assert found["noise_floor"] == {"at_least_mps": 0.005, "at_most_mps": 0.006}
    curve = found["parameters"]["quadratic_gain.curvature"]
    assert curve["before"] is None
    assert abs(curve["after"] - 0.714) < 3.0 * curve["std"]  # how soon it flattens is found along with it
    assert found["parameters"]["grade.load"]["before"] > 0.0
    assert list(tmp_path.iterdir()) == []


def test_the_ladder_shows_how_the_error_fell(verb, built):
    code, out, err = verb("ladder", "two.yaml", "--picture", "p.png")
    assert (code, err) == (0, "")
    for words in (
        "held-out error 3 s ahead, m/s",
        "+ grade",
        "+ quadratic_gain",
        "hills.csv",
        "0 %",
        "noise floor: no",
    ):
        assert words in flat(out)
    assert "Not all steps" not in out
    assert max(map(len, out.splitlines())) <= 80
    assert "…" not in out, "a structure is longer than its column"
    assert (built / "p.png").read_bytes().startswith(b"\x89PNG")
    found = said(verb("ladder", "two.yaml", "--json")[1])
    assert [one["effect"] for one in found["steps"]] == [None, "grade", "quadratic_gain"]
    errors = [one["error_after_mps"] for one in found["steps"]]
    assert errors[0] > errors[1] > errors[2]
    top, floor = errors[0], found["steps"][-1]["noise_floor"]["at_least_mps"]
    assert found["steps"][-1]["share_of_the_way_to_the_floor"] == pytest.approx((top - errors[2]) / (top - floor))
    assert found["steps"][0]["share_of_the_way_to_the_floor"] == 0.0


@pytest.mark.usefixtures("quick")
def test_steps_on_other_recordings_are_told(verb, built, drives):
    assert verb("add", "quadratic_gain", "--model", "one.yaml", drives / "again.csv", "-o", "one.yaml")[0] == 0
    out = verb("ladder", "one.yaml")[1]
    assert "Not all steps were judged on the same recordings" in flat(out)
    assert "again.csv" in out


def test_undo_goes_back_exactly(verb, built):
    two, one = (built / "two.yaml").read_text(), files.read(built / "one.yaml")
    code, out, err = verb("ladder", "two.yaml", "--undo", "-o", "back.yaml")
    assert (code, err) == (0, "")
    assert "quadratic_gain taken back" in out
    assert (built / "back.yaml").read_text() == (built / "one.yaml").read_text()
    assert (built / "two.yaml").read_text() == two
    assert said(verb("ladder", "two.yaml", "--undo", "--json")[1]) == {
        "taken_back": "quadratic_gain",
        "model_file": "two.yaml",
    }
    assert files.read(built / "two.yaml") == one
    assert verb("ladder", "two.yaml", "--undo")[0] == 0
    bare = (built / "two.yaml").read_text()
    code, out, err = verb("ladder", "two.yaml", "--undo")
    assert (code, out) == (2, "")
    assert "two.yaml: nothing to take back" in err
    assert (built / "two.yaml").read_text() == bare


@pytest.mark.usefixtures("quick")
def test_a_model_file_of_another_kind_is_what_undo_brings_back(verb, drives, tmp_path):
    assert verb("identify", drives / "hills.csv", "--model", "arx10", "-o", "m.yaml", "--picture", "p.png")[0] == 0
    assert verb("add", "grade", "--model", "m.yaml", drives / "hills.csv", "-o", "better.yaml")[0] == 0
    first = said(verb("ladder", "better.yaml", "--json")[1])["steps"][0]
    assert (first["effect"], first["structure"]) == ("grade", None)
    assert verb("ladder", "better.yaml", "--undo")[0] == 0
    assert files.read(tmp_path / "better.yaml") == files.read(tmp_path / "m.yaml")


@pytest.mark.usefixtures("quick")
def test_what_lives_in_the_core_is_taken_on(verb, drives, tmp_path):
    assert verb("add", "resonance", "--model", MODEL, drives / "hills.csv", "-o", "better.yaml")[0] == 0
    assert verb("add", "grade", "--model", "better.yaml", drives / "hills.csv", "-o", "better.yaml")[0] == 0
    core = files.read(tmp_path / "better.yaml").core
    assert core is not None
    assert (core.effects, list(core.loads_mps)) == (("resonance",), ["grade"])
    assert "+ resonance" in verb("ladder", "better.yaml")[1]


@pytest.mark.usefixtures("quick")
def test_a_term_of_ones_own_is_added_and_kept(verb, drives, tmp_path):
    code, out, err = verb("add", TERM, "--model", MODEL, drives / "hills.csv", "-o", "own.yaml")
    assert (code, err) == (0, "")
    assert "slope added to" in flat(out)
    assert (tmp_path / "own.yaml").read_text().count("expression: -pitch_deg") == 1
    assert verb("add", "quadratic_gain", "--model", "own.yaml", drives / "hills.csv", "-o", "own.yaml")[0] == 0
    steps = said(verb("ladder", "own.yaml", "--json")[1])["steps"]
    assert [one["effect"] for one in steps] == [None, "slope", "quadratic_gain"]
    assert steps[1]["error_after_mps"] < 0.7 * steps[1]["error_before_mps"]


@pytest.mark.usefixtures("quick")
def test_an_effect_that_explains_nothing_is_said_to(verb, drives):
    code, out, _ = verb("add", "engine_speed", "--model", f"{MODEL}+quadratic_gain+grade", drives / "hills.csv")
    assert code == 0
    assert "There is no sign of it in these recordings" in flat(out) or "It explains next to nothing" in flat(out)
    assert "nothing was written" in out
    code, out, _ = verb("add", "custom(lift, load, pitch_deg)", "--model", MODEL, drives / "hills.csv")
    assert code == 0
    assert "There is no sign of it in these recordings" in flat(out)
    assert "write custom(lift, load, -(pitch_deg))" in flat(out)


@pytest.mark.usefixtures("quick")
def test_a_model_that_got_worse_is_said_to_be_and_no_one_is_sent_to_drive_with_it(verb, drives):
    code, out, err = verb(
        "add", "custom(div, gain, 1/pitch_deg)", "--model", MODEL, drives / "hills.csv", "-o", "worse.yaml"
    )
    assert (code, err) == (0, "")
    assert re.search(r"held-out error 3 s ahead: \S+ -> \S+ m/s, \d+(\.\d)? times as much", flat(out))
    assert "It makes the model worse: leave it out" in flat(out)
    assert "cruise ladder worse.yaml --undo takes div out again" in flat(out)
    assert "cruise run" not in out
    code, out, _ = verb("add", "engine_speed", "--model", f"{MODEL}+grade", drives / "hills.csv", "-o", "same.yaml")
    assert code == 0
    assert "--undo takes engine_speed out again" in flat(out)
    assert "cruise run" not in out


@pytest.mark.usefixtures("quick")
def test_a_gain_that_slows_the_machine_down_is_implausible(verb, drives):
    term = "custom(against, gain, -1 + p1*pitch_deg)"  # which turns the sign of all that the current does
    code, out, _ = verb("add", term, "--model", MODEL, drives / "hills.csv")
    assert code == 0
    assert "gain_mps_per_ma is negative, which is implausible: more current would slow the machine down" in flat(out)


@pytest.mark.parametrize(
    ("less", "words"),
    [(0.467, "47 % less"), (-0.004, "as much as before"), (-0.3, "30 % more"), (-11.68, "13 times as much")],
)
def test_the_change_of_the_error_in_words(less, words):
    assert _change(less) == words


@pytest.mark.usefixtures("quick")
def test_what_the_data_can_not_separate_is_said_and_has_no_error_in_json(verb, drives):
    words = ("add", "custom(slope, load, p1*pitch_deg)", "--model", MODEL, drives / "hills.csv")
    code, out, _ = verb(*words)
    assert code == 0
    assert re.search(r"not told by the data: .*slope\.load, slope\.p1", flat(out))
    found = said(verb(*words, "--json")[1])["parameters"]
    assert (found["slope.p1"]["std"], found["slope.p1"]["remark"]) == (None, "not told by the data")


@pytest.mark.parametrize(
    ("remarks", "none"),
    [
        ({"grade.load": "", "grade.mass_share": NO_SIGN}, False),  # 48 % less, by a slope that no mass changes
        ({"grade.load": NO_SIGN, "grade.mass_share": ""}, True),
        ({"grade.threshold_ma": NO_SIGN, "grade.width_ma": NO_SIGN}, True),
        ({"grade.threshold_ma": "", "grade.width_ma": NO_SIGN}, False),
        ({"gain_mps_per_ma": NO_SIGN}, False),
    ],
)
def test_an_effect_is_there_though_a_shape_of_it_is_not(remarks, none):
    fitted = [validation.Parameter(name, "", None, 0.0, 0.0, remark) for name, remark in remarks.items()]
    assert absent("grade", fitted) is none


def test_the_file_goes_unchanged_into_the_service(built):
    """Estimator and controller take it, with its effects, and the machine is engaged with it.

    It is the model of another machine, so that current and speed may differ from it by three times as much as usual.
    """
    service = service_settings.load(CONFIG / "cruise.yaml")
    usual = service.plausibility
    wide = msgspec.structs.replace(
        usual, disturbance_mps=3.0 * usual.disturbance_mps, disturbance_share=3.0 * usual.disturbance_share
    )
    service = msgspec.structs.replace(service, model=str(built / "two.yaml"), plausibility=wide)
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    driven = demo.run(service, plant, course.load(CONFIG / "demo.yaml"), 0, 24.0)
    assert driven.node.estimator.factory == files.load(built / "two.yaml")
    assert [effect.name for effect in driven.node.estimator.factory.effects] == ["quadratic_gain", "grade"]
    assert driven.states[-1][1] == "engaged"


MISTAKES = {
    "grad --model arx10 hills.csv": "no effect is called grad; did you mean grade?",
    "Grade --model arx10 hills.csv": "did you mean grade?",
    "flux --model arx10 hills.csv": "no effect is called flux; known: rate_limit, ",
    "custom(a,load) --model arx10 hills.csv": "write custom(NAME, STAGE, EXPRESSION)",
    "custom(grade,load,-pitch_deg) --model arx10 hills.csv": "grade is an effect already",
    "custom(mud,load,-wetness) --model arx10 hills.csv": "mud can't be added: wetness is not recorded; a term can read",
    "custom(mud,load,k*pitch_deg) --model arx10 hills.csv": "_ma and speed_mps; its parameters are p1 to p9",
    "custom(mud,load,p1*pitch) --model arx10 hills.csv": "pitch is not recorded; did you mean pitch_deg?",
    "custom(mud,load,ground_speed_mps) --model arx10 hills.csv": "write speed_mps, the speed one sample ago",
    "custom(mud,load,v) --model arx10 own.csv --output v": "v is what is predicted: write speed_mps",
    "grade --model arx10+custom(mud,load,ground_speed_mps) hills.csv": "ground_speed_mps is what is predicted",
    "grade --model arx10b hills.csv": "did you mean arx10B?",
    "grade --model arx10+grade hills.csv": "the model has grade already: name another effect",
    "grade --model two.yaml hills.csv": "the model has grade already",
    "grade --model none.yaml hills.csv": "none.yaml: no such file",
    "grade --model nonsense.yaml hills.csv": "nonsense.yaml: history[1]: crop_load is said to have been added",
    "grade --model narx1 hills.csv": "a NARX model has polynomials",
    "oil_temperature --model arx10 hills.csv": "oil_temperature_c is not recorded",
    "grade --model arx10 none.csv": "none.csv: no such file",
    "grade --model arx10 hills.csv -o better.txt": "--out better.txt: let the name end in .yaml",
    "grade --model arx10 hills.csv -o hills.csv/better.yaml": "--out hills.csv/better.yaml: ",
    "grade --model arx10 hills.csv -o /proc/better.yaml": "--out /proc/better.yaml: can't be written: ",
    "grade --model arx10 hills.csv --horizon 0": "--horizon 0: give a time",
    "grade --model arx10 hills.csv --period 0": "--period 0: give a time",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_gets_one_clear_line_and_loses_nothing(verb, ladders, words):
    refused(verb, ladders, ("add", *words.split()), MISTAKES[words])


WRONG = {
    "none.yaml": "none.yaml: no such file",
    "plain.yaml": "plain.yaml: no effect was added to it yet",
    "plain.yaml --undo": "plain.yaml: nothing to take back",
    "nonsense.yaml": "nonsense.yaml: history[1]: crop_load is said to have been added to a model without effects",
    "nonsense.yaml --undo": "nonsense.yaml: history[1]: crop_load is said",
    "cut.yaml": "cut.yaml:",
    "off.yaml": "off.yaml: parameters.a_1: ",
    "two.yaml -o better.yaml": "--out: says where --undo writes",
    "two.yaml --undo -o better.txt": "--out better.txt: let the name end in .yaml",
    "two.yaml --picture p.txt": "--picture p.txt: let the name end in .png",
}


@pytest.mark.parametrize("words", WRONG)
def test_a_ladder_that_is_none_gets_one_clear_line_and_loses_nothing(verb, ladders, words):
    refused(verb, ladders, ("ladder", *words.split()), WRONG[words])


def refused(verb, folder: Path, words: tuple[str, ...], complaint: str) -> None:
    """One line on the error stream, exit code 2, and every file as it was."""
    before = {path: path.read_bytes() for path in folder.iterdir()}
    code, out, err = verb(*words)
    assert (code, out) == (2, "")
    assert complaint in err
    assert err.startswith("cruise: ")
    assert len(err.splitlines()) == 1
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
