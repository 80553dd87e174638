"""`cruise compare` as a user meets it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from cruise.cli.places import CONFIG
from cruise.columns import RecordingSettings
from cruise.csv_file import read_csv, write_csv
from cruise.model import files
from cruise.recording import Recording
from cruise.report import comparison_picture
from cruise.signals import INPUT, OUTPUT
from tests.validation.machine import record

MODEL = "arx:na=2,nb=3,delay_s=0.4"


@pytest.fixture
def tables(tmp_path):
    """One machine on hills that the model does not know, twice, and useless ones, beside where the verb runs."""
    hills = record(seed=1, seconds=400.0, noise_mps=0.03, grade_mps_per_deg=0.03)
    write_csv(hills, tmp_path / "hills.csv")
    write_csv(record(seed=2, seconds=120.0, noise_mps=0.03, grade_mps_per_deg=0.03), tmp_path / "again.csv")
    write_csv(hills[:400], tmp_path / "short.csv")
    write_csv(hills[400:1600], tmp_path / "other.csv")
    poor = {name: hills.columns[name] for name in (INPUT, OUTPUT)}
    write_csv(Recording(hills.time_s, poor, hills.dt_s, "poor"), tmp_path / "poor.csv")
    return tmp_path


def judged(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_it_says_how_good_how_good_at_best_and_where_it_fails(verb, tables):
    code, out, err = verb("compare", "hills.csv", "--model", MODEL)
    assert (code, err) == (0, "")
    flat = " ".join(out.split())
    for words in (
        "1 recording, 1999 samples of 0.2 s, input filtered",
        "every sample judged by a fit that had not seen it",
        "3 s ahead",
        "free run",
        "persistence",
        "No model errs by less than 0.01",
        "of the squared error of this model, at least, is not noise",
        "% of the squared error stands in",
        "uphill above",
        "slower than predicted",
        "worst stretches",
        "signatures of what the model lacks",
        "standard test: u, any lag",
        "picture: out/compare.png",
    ):
        assert words in flat
    assert max(map(len, out.splitlines())) <= 80
    assert (tables / "out" / "compare.png").read_bytes().startswith(b"\x89PNG")


def test_json_holds_every_figure(verb, tables):
    code, out, err = verb("compare", "hills.csv", "again.csv", "--model", MODEL, "--json", "--picture", "p.png")
    assert (code, err) == (0, "")
    found = judged(out)
    assert (found["recordings"], found["structure"]) == (["hills.csv", "again.csv"], MODEL)
    assert found["ahead"]["rmse_mps"] < found["persistence"]["rmse_mps"]
    assert found["ahead"]["samples"] == found["persistence"]["samples"]
    white, reached = found["noise_floor"]["white"], found["noise_floor"]["reached"]
    assert white["value_mps"] == pytest.approx(0.03 * np.sqrt(3.5) / 4.0, rel=0.05)
    assert white["value_mps"] < reached["value_mps"] < found["ahead"]["rmse_mps"]
    first = found["regimes"][0]
    assert (first["key"], first["named"]) == ("pitch_deg", True)
    assert sum(one["time_share"] for one in first["bins"]) == pytest.approx(1.0)
    assert "pitch_deg" in (found["heat_map"]["rows"], found["heat_map"]["columns"])
    assert found["signatures"][0]["regressor"] == "slope"
    assert found["signatures"][0]["correlation"] < 0.0
    assert {one["source"] for one in found["worst_stretches"]} <= {"hills.csv", "again.csv"}
    assert found["picture"] == "p.png"


def test_a_model_file_is_taken_as_it_is_and_told_when_it_knew_the_recording(verb, tables):
    assert verb("identify", "again.csv", "--model", MODEL, "-o", "m.yaml")[0] == 0
    code, out, _ = verb("compare", "other.csv", "--model", "m.yaml")
    assert code == 0
    assert "the model was taken as it is, nothing was fitted" in out
    assert "it had been fitted to" not in out
    code, out, _ = verb("compare", "other.csv", "again.csv", "--model", "m.yaml")
    assert "it had been fitted to again.csv: what follows is not held out" in out
    found = judged(verb("compare", "again.csv", "--model", "m.yaml", "--json")[1])
    fitted = judged(verb("identify", "again.csv", "--model", MODEL, "--json")[1])
    assert found["ahead"]["rmse_mps"] == pytest.approx(fitted["training"]["rmse_mps"])
    assert found["fitted_to_some_of_these"] == ["again.csv"]


def test_a_recording_is_read_in_the_unit_that_the_model_was_made_in(verb, tables):
    """One in which the input never rose far enough to tell it would be taken for another unit."""
    hills = read_csv(tables / "hills.csv", RecordingSettings())
    for name, share in (("fast", 1.0), ("slow", 0.4)):
        pwm, speed_mps = share * 250.0 * hills.input / np.nanmax(hills.input), share * hills.output
        lines = [f"{t:.2f},{u:.6g},{v:.6g}" for t, u, v in zip(hills.time_s, pwm, speed_mps, strict=True)]
        (tables / f"{name}.csv").write_text("\n".join(["time_s,pwm,ground_speed_mps", *lines]))
    words = ("--input", "pwm", "--picture", "p.png", "--json")
    assert verb("identify", "fast.csv", "--model", MODEL, "-o", "m.yaml", *words)[0] == 0
    assert files.read(tables / "m.yaml").provenance.input_unit == "mA"
    told = judged(verb("compare", "slow.csv", "--model", "m.yaml", *words)[1])
    assert any("pwm: read as mA like that of m.yaml" in note for note in told["notes"])
    (tables / "m.yaml").write_text((tables / "m.yaml").read_text().replace("  input_unit: mA\n", ""))
    alone = judged(verb("compare", "slow.csv", "--model", "m.yaml", *words)[1])
    assert any("read as per cent, all of it" in note for note in alone["notes"])
    assert alone["ahead"]["rmse_mps"] > 2.0 * told["ahead"]["rmse_mps"]


def test_a_recording_is_counted_from_where_those_of_the_model_were(verb, tables):
    hills = read_csv(tables / "hills.csv", RecordingSettings())
    reverses = np.where(hills.time_s < 0.6 * hills.time_s[-1], 1.0, -1.0)
    lever = 1000.0 + reverses * hills.input
    lines = [f"{t:.2f},{u:.6g},{v:.6g}" for t, u, v in zip(hills.time_s, lever, reverses * hills.output, strict=True)]
    (tables / "both.csv").write_text("\n".join(["time_s,lever,ground_speed_mps", *lines]))
    ahead = [
        f"{t:.2f},{1000.0 + u:.6g},{v:.6g}" for t, u, v in zip(hills.time_s, hills.input, hills.output, strict=True)
    ]
    (tables / "ahead.csv").write_text("\n".join(["time_s,lever,ground_speed_mps", *ahead]))
    words = ("--input", "lever", "--picture", "p.png", "--json")
    assert verb("identify", "both.csv", "--model", MODEL, "-o", "m.yaml", *words)[0] == 0
    rest_ma = files.read(tables / "m.yaml").provenance.input_rest_ma
    assert rest_ma == pytest.approx(1000.0, abs=60.0)
    code, out, err = verb("compare", "ahead.csv", "--model", "m.yaml", *words)
    assert code == 0, err
    told = judged(out)
    assert any(f"lever: counted from {rest_ma:g} mA like that of m.yaml" in note for note in told["notes"])


def test_a_file_of_the_same_name_is_not_the_same_recording(verb, tables):
    (tables / "monday").mkdir()
    (tables / "tuesday").mkdir()
    write_csv(record(seed=3, seconds=60.0), tables / "monday" / "drive.csv")
    write_csv(record(seed=4, seconds=90.0), tables / "tuesday" / "drive.csv")
    assert verb("identify", "monday/drive.csv", "--model", MODEL, "-o", "m.yaml")[0] == 0
    assert "it had been fitted to" not in verb("compare", "tuesday/drive.csv", "--model", "m.yaml")[1]
    assert "fitted to monday/drive.csv" in verb("compare", "monday/drive.csv", "--model", "m.yaml")[1]


def test_names_in_brackets_are_names(verb, tables):
    one = read_csv("hills.csv", RecordingSettings())[:3000]
    columns = {"slope [deg]" if name == "pitch_deg" else name: values for name, values in one.columns.items()}
    columns["n [/min]"] = columns.pop("engine_speed_rpm", 2100.0 + 50.0 * np.sin(one.time_s))
    (tables / "d[").mkdir()
    write_csv(replace(one, columns=columns), tables / "d[" / "x].csv")
    code, out, _ = verb("compare", "d[/x].csv", "--model", MODEL)
    assert code == 0
    flat = " ".join(out.split())
    assert "n [/min]" in flat or "slope [deg] -" in flat
    assert "slope [deg], header_height, n [/min]: left out, as nobody has said whether the drive moves them; " in flat
    assert "those signals" in flat or "is not noise" in flat
    assert verb("identify", "d[/x].csv", "--model", MODEL, "-o", "d[/m].yaml")[0] == 0
    assert verb("compare", "hills.csv", "--model", "d[/m].yaml")[0] == 0


def test_a_short_recording_is_compared_and_says_what_it_can_not_tell(verb, tables):
    code, out, _ = verb("compare", "short.csv", "--model", "arx:na=1,nb=1,delay_s=0.4", "--cutoff", "0")
    assert code == 0
    assert "too short for a floor from above" in " ".join(out.split())
    assert "nan" not in out


MISTAKES = {
    "none.csv --model arx10": "none.csv: no such file",
    "poor.csv --model arx10+engine_speed": "poor.csv: the model needs engine_speed_rpm, which the recording",
    "poor.csv --model arx10b": "did you mean arx10B?",
    "poor.csv --model arx10 --horizon 0": "--horizon 0: give a time",
    "poor.csv --model arx10 --horizon 900": "no sample has 900 s of whole recording before it",
    "poor.csv --model arx10 --picture p.txt": "--picture p.txt: let the name end in .png",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_gets_one_clear_line(verb, tables, words):
    code, out, err = verb("compare", *words.split())
    assert (code, out) == (2, "")
    assert MISTAKES[words] in err
    assert err.startswith("cruise: ")
    assert len(err.splitlines()) == 1
    assert not (tables / "out" / "compare.png").exists()


def test_extremes_survive_the_thinning_of_long_curves():
    values = np.random.default_rng(1).standard_normal(50_000)
    values[12_345], values[23_456], values[30_000:30_100] = 50.0, -50.0, np.nan
    time_s = 0.2 * np.arange(50_000)
    thin_s, thin = comparison_picture.extremes(time_s, values)
    assert len(thin) <= 3 * comparison_picture.BINS
    assert {50.0, -50.0} <= set(thin)
    assert np.isnan(thin).any()
    assert np.all(np.diff(thin_s) > 0.0)
    assert np.array_equal(comparison_picture.extremes(time_s[:500], values[:500])[1], values[:500])


def test_measured_drives_fall_short_where_the_car_is_known_to_be_nonlinear(verb, dart):
    paths = sorted(dart.glob("*/*.csv"))[::3]
    words = ("--columns", CONFIG / "dart_columns.yaml", "--period", 0.1, "--model", "arx10", "--json")
    code, out, _ = verb("compare", *paths, *words)
    assert code == 0
    found = judged(out)
    assert found["noise_floor"]["reached"]["high_mps"] < 0.7 * found["ahead"]["rmse_mps"]
    assert found["noise_floor"]["white"]["value_mps"] < 0.05
    assert any(one["named"] for one in found["regimes"])
