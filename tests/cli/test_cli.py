"""The command line as a user meets it: what it prints, where it writes, and what it says when something is wrong."""

import json
import math
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from cruise import cli
from cruise.can.log import read_log
from cruise.cli.places import CONFIG
from cruise.service import replay


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A short demo, twice with the same seed and once with another: folder and the three JSON texts."""
    driven = []
    for name, seed in (("one", "4"), ("two", "4"), ("other", "5")):
        folder, texts = tmp_path_factory.mktemp(name), []
        words = ["demo", "--headless", "--seconds", "40", "--seed", seed, "--json", "--out", str(folder)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["cruise", *words])
            patch.setattr("builtins.print", lambda text, kept=texts, **_: kept.append(text))
            with pytest.raises(SystemExit) as ended:
                cli.main()
        assert not ended.value.code
        driven.append((folder, texts[0]))
    return driven


def test_the_same_seed_gives_the_same_json_and_the_same_log(driven):
    (first, one), (second, two), (_, other) = driven
    assert one == two
    assert one != other
    assert (first / "demo-4.log").read_bytes() == (second / "demo-4.log").read_bytes()


def test_the_json_holds_the_figures_and_no_nan(driven):
    report = json.loads(driven[0][1], parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    for key in ("rms_error_mps", "overshoot_pct", "command_above_1hz_rms_pct", "accel_max_mps2", "steady_error_mps"):
        assert key in report
    assert report["seed"] == 4
    assert report["states"][-1]["state"] == "engaged"
    assert report["frame_faults"] == {}


def test_the_demo_leaves_a_picture_and_a_log(verb, tmp_path):
    code, out, err = verb("demo", "--headless", "--seconds", "25", "--out", tmp_path)
    assert code == 0
    assert (tmp_path / "demo-1.png").read_bytes().startswith(b"\x89PNG")
    assert "rms_error_mps" in out
    assert "engaged" in err
    assert "last exit" not in out
    assert sum(1 for _ in read_log(tmp_path / "demo-1.log")) > 5000


def test_the_demo_says_why_it_let_go_last(verb, tmp_path):
    drive = yaml.safe_load((CONFIG / "demo.yaml").read_text())
    drive["operator"] = [row for row in drive["operator"] if row["at_s"] < 24.0] + [{"at_s": 24.0, "brake_pedal": 1.0}]
    (tmp_path / "brake.yaml").write_text(yaml.safe_dump(drive))
    words = ("demo", "--headless", "--seconds", "26", "--drive", tmp_path / "brake.yaml", "--out", tmp_path)
    assert "last exit: brake (ISO exit reason 3, override)" in verb(*words)[1].splitlines()
    assert json.loads(verb(*words, "--json")[1])["last_exit"] == "brake (ISO exit reason 3, override)"


@pytest.mark.parametrize(("written", "named"), [("demo-1.log", "out/demo-1.log"), ("demo-1.png", "demo")])
def test_a_full_disk_gets_one_clear_line(verb, tmp_path, written, named):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / written).symlink_to("/dev/full")
    code, _, err = verb("demo", "--headless", "--seconds", "5", "--out", "out")
    assert code == 2
    assert err.splitlines()[-1] == f"cruise: {named}: No space left on device"
    assert "Traceback" not in err


def test_a_full_disk_names_the_model_that_could_not_be_written(verb, driven, tmp_path):
    (tmp_path / ".learned.yaml.tmp").symlink_to("/dev/full")
    code, _, err = verb("replay", driven[0][0] / "demo-4.log", "--save", "learned.yaml")
    assert (code, err) == (2, "cruise: learned.yaml: No space left on device\n")


def test_a_replayed_log_teaches_what_the_drive_taught(verb, driven):
    folder, text = driven[0]
    code, out, _ = verb("replay", folder / "demo-4.log", "--json")
    assert code == 0
    report = json.loads(out)
    assert report["learned"] is True
    assert report["gate_share"]["open"] > 0.2
    replayed, drove = report["parameters"], json.loads(text)["parameters"]
    # A candump log rounds time to a microsecond; nothing else may differ.
    assert replayed == pytest.approx(drove, rel=1e-3, abs=1e-7)


@pytest.mark.parametrize("step_s", [3.0e8, -3600.0, 7200.0])
def test_a_clock_that_was_set_in_the_middle_of_a_log_is_a_pause(verb, driven, tmp_path, step_s):
    lines = (driven[0][0] / "demo-4.log").read_text().splitlines()
    moved = []
    for k, line in enumerate(lines):
        stamp, rest = line[1:].split(")", 1)
        moved.append(f"({float(stamp) + 5000.0 + (step_s if k > len(lines) // 2 else 0.0):.6f}){rest}")
    (tmp_path / "set.log").write_text("\n".join(moved) + "\n")
    code, out, _ = verb("replay", tmp_path / "set.log", "--json")
    assert code == 0
    report = json.loads(out)
    assert "taken as a pause of 5 s" in report["notes"][0]
    assert len(report["notes"]) == 1
    assert 200 <= report["samples"] <= 240  # 40 s and the pause, at 5 Hz


def test_what_was_learned_can_be_saved_and_started_from(verb, driven, tmp_path):
    log, saved = driven[0][0] / "demo-4.log", tmp_path / "learned.yaml"
    assert verb("replay", log, "--save", saved)[0] == 0
    code, out, _ = verb("replay", log, "--model", saved, "--test", log, "--json")
    assert code == 0
    judged = json.loads(out)["test"]
    assert judged["online_mps"] < 0.5 * judged["persistence_mps"]
    for words in (("ladder", saved), ("ladder", saved, "--undo")):
        code, out, err = verb(*words)
        assert (code, out) == (2, "")
        assert f"learned.yaml: no history in this file, learned online by cruise replay, from {CONFIG}" in err


def test_a_replayed_table_is_read_in_the_unit_of_the_model_that_it_teaches(verb, tmp_path):
    """A pedal that goes to 90 is per cent; one that was pressed to 2.5 alone would be a share of all."""

    def pedal(name: str, most: float) -> Path:
        wave = [0.5 * (1.0 - math.cos(0.3 * k / 10)) for k in range(3000)]
        rows = [f"{k / 10:.1f},{most * one:.4f},{2.0 * most / 100.0 * one:.4f}" for k, one in enumerate(wave)]
        (tmp_path / name).write_text("\n".join(["time_s,pedal,ground_speed_mps", *rows]))
        return tmp_path / name

    full, slow, saved = pedal("full.csv", 90.0), pedal("slow.csv", 2.5), tmp_path / "learned.yaml"
    words = ("--config", CONFIG / "dart.yaml", "--input", "pedal", "--json")
    code, out, err = verb("replay", full, "--test", slow, "--save", saved, *words)
    assert code == 0, err
    assert "input_unit: per cent" in saved.read_text()
    code, out, err = verb("replay", slow, "--model", saved, *words)
    assert code == 0, err
    assert any("pedal: read as per cent like that of learned.yaml" in note for note in json.loads(out)["notes"])


def _table(path: Path, step_s: float, current: float) -> Path:
    """A table of 60 s at one current."""
    rows = [f"{step_s * k:.1f},{current},{current / 800.0}" for k in range(round(60.0 / step_s))]
    path.write_text("\n".join(["time_s,pump_current_ma,ground_speed_mps", *rows]))
    return path


def test_a_table_that_is_too_slow_for_the_model_is_not_replayed(verb, tmp_path):
    slow = _table(tmp_path / "slow.csv", 1.0, 700.0)
    code, out, err = verb("replay", slow, "--config", CONFIG / "dart.yaml")
    assert (code, out) == (2, "")
    assert "slow.csv is sampled every 1 s, too slowly for a model of 0.1 s: record faster, or give a model of" in err


def test_where_nothing_was_learned_that_is_said_and_nothing_is_written(verb, tmp_path):
    still, saved = _table(tmp_path / "still.csv", 0.1, 700.0), tmp_path / "learned.yaml"
    words = ("replay", still, "--config", CONFIG / "dart.yaml", "--save", saved)
    code, out, err = verb(*words)
    assert code == 1
    assert "nothing was learned: no sample" in out
    assert "gate: no excitation 9" in out
    assert "a_1" not in out
    assert err == f"cruise: {saved}: not written, nothing was learned\n"
    assert not saved.exists()
    report = json.loads(verb(*words, "--json")[1])
    assert report["learned"] is False
    assert report["gate_share"]["no excitation"] > 0.9


def test_what_could_not_be_judged_is_no_nan(verb, driven, monkeypatch):
    judged = replay.Judged(0.1, float("nan"), 0.2, 0.3, 3.0, 10)
    monkeypatch.setattr(replay, "judge", lambda *_: judged)
    log = driven[0][0] / "demo-4.log"
    code, out, _ = verb("replay", log, "--test", log, "--json")
    assert code == 0
    test = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))["test"]
    assert (test["online_mps"], test["batch_mps"]) == (0.1, None)


def test_errors_that_differ_are_shown_to_differ(verb, driven, monkeypatch):
    judged = replay.Judged(0.01119, 0.01156, 0.01118, 0.3, 3.0, 10)
    monkeypatch.setattr(replay, "judge", lambda *_: judged)
    log = driven[0][0] / "demo-4.log"
    out = " ".join(verb("replay", log, "--test", log)[1].split())
    assert "3 s ahead on 1 unseen recording RMS" in out
    for words in ("online 0.01119", "batch 0.01156", "factory 0.01118"):
        assert words in out


@pytest.mark.parametrize("module", ["typer", "cruise.settings", "cruise.cli.ladder"])
def test_ctrl_c_ends_a_verb_silently_while_it_still_loads(tmp_path, module):
    code = f"""
import sys
class Interrupted:
    def find_spec(self, name, *_):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
sys.argv = ["cruise", "ladder", "none.yaml"]
from cruise.cli import main
main()
"""
    ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def table(path: Path, rows: str) -> Path:
    path.write_text("time_s,amps,speed\n" + rows)
    return path


GOOD = "".join(f"{k / 10},{500 + 10 * k},{k / 100}\n" for k in range(60))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("replay", "missing.csv"), "missing.csv: no such file"),
        (("replay", "missing.csv", "--save", "m.txt"), "--save m.txt: let the name end in .yaml or .yml"),
        (("replay", "missing.log"), "missing.log: no such file"),
        (("replay", "t.csv"), "choose with --input NAME"),
        (("replay", "t.csv", "--input", "amps"), "choose with --output NAME"),
        (("replay", "t.csv", "--input", "amps", "--output", "speed"), "the model needs engine_speed_rpm, gear"),
        (("replay", "back.csv", "--input", "amps", "--output", "speed"), "back.csv:62: time runs backwards"),
        (("replay", "short.csv", "--input", "amps", "--output", "speed"), "too few"),
        (("replay", "text.log"), "text.log:1: cannot be read"),
        (("replay", "foreign.log"), "no frame of DriveFeedback"),
        (("run", "misspelt.yaml"), "misspelt.yaml:2: modle: unknown setting; did you mean model?"),
        (("run", "nofile.yaml"), "nofile.yaml: no such file"),
        (("run", "database.yaml"), "MachineState"),
        (("run", "model.yaml"), "effects.dead_zon: no such effect; did you mean dead_zone?"),
        (("demo", "--headless", "--drive", "bad_drive.yaml"), "bad_drive.yaml:3"),
        (
            ("demo", "--headless", "--drive", "button.yaml"),
            "button.yaml:3: operator[0].press: expected one of \"\", set, resume, accelerate, coast, got 'sett'",
        ),
        (("record", "text.log", "--config", "virtual.yaml", "--seconds", "-1"), "Invalid value for '--seconds'"),
        (("record", "text.log", "--config", "virtual.yaml", "--seconds", "nan"), "Invalid value for '--seconds'"),
        (("run", "zero.yaml"), "zero.yaml:4: control.frame_s"),
        (("run", "frame.yaml"), "must be a multiple of it"),
        (("run", "limits.yaml"), "below current_max_ma"),
        (("record", "drive.txt", "--config", "virtual.yaml"), "let the name end in .log"),
        (("record", "text.log", "--config", "virtual.yaml"), "text.log: is there already and is not overwritten"),
    ],
)
def test_a_mistake_gets_one_clear_line(verb, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    table(tmp_path / "t.csv", GOOD)
    table(tmp_path / "back.csv", GOOD + "1.0,500,0.1\n")
    table(tmp_path / "short.csv", "0,500,0.1\n0.1,500,0.1\n")
    (tmp_path / "text.log").write_text("hello\n")
    (tmp_path / "foreign.log").write_text("(0.000000) can0 123#0011\n(0.500000) can0 123#0012\n")
    model, database = CONFIG / "factory_model.yaml", CONFIG / "cruise.dbc"
    settings = f"model: {model}\ndatabase: {database}\ncan: {{bus: virtual}}\n"
    (tmp_path / "virtual.yaml").write_text(settings)
    (tmp_path / "zero.yaml").write_text(settings + "control: {frame_s: 0}\n")
    (tmp_path / "frame.yaml").write_text(settings + "control: {frame_s: 0.03}\n")
    (tmp_path / "limits.yaml").write_text(
        settings + "control: {limits: {current_max_ma: 110.0, current_min_ma: 150.0}}\n"
    )
    (tmp_path / "misspelt.yaml").write_text(f"database: {database}\nmodle: {model}\n")
    (tmp_path / "half.dbc").write_text(database.read_text().replace("MachineState", "MachineStatus"))
    (tmp_path / "database.yaml").write_text(settings.replace(str(database), "half.dbc"))
    (tmp_path / "bad_model.yaml").write_text(model.read_text().replace("dead_zone", "dead_zon"))
    (tmp_path / "model.yaml").write_text(settings.replace(str(model), "bad_model.yaml"))
    (tmp_path / "bad_drive.yaml").write_text("seconds: 10.0\nfield:\n  - {at_s: 0.0, grade: 3.0}\n")
    (tmp_path / "button.yaml").write_text("seconds: 10.0\noperator:\n  - {at_s: 0.0, press: sett}\n")
    code, _, err = verb(*words)
    assert code == 2
    assert says in err
    assert "Traceback" not in err


def test_nan_and_gaps_are_said_and_not_learned_from(verb, tmp_path):
    rows = [f"{k / 10},{600 + 200 * (k // 30 % 2)},{0.5 + 0.3 * (k // 30 % 2)}" for k in range(300)]
    rows[50] = "5.0,nan,0.5"
    rows = rows[:100] + rows[160:]
    path = table(tmp_path / "holes.csv", "\n".join(rows) + "\n")
    words = ("replay", path, "--input", "amps", "--output", "speed", "--config", CONFIG / "dart.yaml", "--json")
    code, out, _ = verb(*words)
    assert code == 0
    notes = " ".join(json.loads(out)["notes"])
    assert "1 of 240 cells hold no number" in notes
    assert "gap of 6.1 s" in notes


def test_the_black_box_keeps_a_ring(verb, tmp_path):
    config = tmp_path / "cruise.yaml"
    config.write_text(
        f"model: {CONFIG / 'factory_model.yaml'}\ndatabase: {CONFIG / 'cruise.dbc'}\ncan: {{bus: virtual}}\n"
    )
    code, out, _ = verb("record", tmp_path / "box", "--ring", "--seconds", "0.3", "--config", config)
    assert code == 0
    assert "0 exits" in out
    assert [path.name for path in (tmp_path / "box").iterdir()] == ["log-0000001.log.gz"]


def test_help_names_every_verb(verb):
    code, out, _ = verb("--help")
    assert code == 0
    for verb in cli.VERBS:
        assert verb in out


def test_a_bus_that_disappears_ends_a_recording_with_one_clear_line(verb, tmp_path, monkeypatch):
    from cruise.can.bus import BusLostError, LocalBus

    def gone(self, *_):
        raise BusLostError("can0: the interface went away")

    monkeypatch.setattr(LocalBus, "receive", gone)
    text = f"model: {CONFIG / 'factory_model.yaml'}\ndatabase: {CONFIG / 'cruise.dbc'}\ncan: {{bus: virtual}}\n"
    (tmp_path / "cruise.yaml").write_text(text)
    code, _, err = verb("record", tmp_path / "drive.log", "--config", tmp_path / "cruise.yaml")
    assert code == 3
    assert "the interface went away" in err
    assert "Traceback" not in err


def test_the_version_is_that_of_the_package(verb):
    code, out, err = verb("--version")
    assert (code, out, err) == (0, f"cruise {version('cruise-control-combine')}\n", "")
