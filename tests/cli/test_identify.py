"""`cruise identify` as a user meets it."""

import json

import numpy as np
import pytest
from matplotlib import pyplot as plt

from cruise.cli.places import CONFIG
from cruise.csv_file import write_csv
from cruise.model import files
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tools.benchmarks.recovery import SYSTEMS, currents, filtered, recording


@pytest.fixture
def tables(tmp_path):
    """Two experiments of one machine at 5 Hz, and useless ones, beside where the verb runs."""
    good = SYSTEMS["hammerstein"].record(1)
    samples = len(good)
    write_csv(good, tmp_path / "one.csv")
    write_csv(SYSTEMS["hammerstein"].record(2)[:300], tmp_path / "two.csv")
    write_csv(good[:30], tmp_path / "short.csv")
    write_csv(recording(np.full(samples, 700.0), good.output), tmp_path / "still.csv")
    write_csv(recording(good.input, np.zeros(samples)), tmp_path / "parked.csv")
    write_csv(recording(good.input[:200], good.output[:200], 0.5), tmp_path / "slow.csv")
    wave = np.sin(0.3 * np.arange(samples))
    write_csv(recording(700.0 + 200.0 * wave, 1.0 + wave), tmp_path / "wave.csv")
    rng = np.random.default_rng(8)
    current = currents(rng, 400)
    growing = filtered([1e-6], [1.0, -1.02], current - 700.0 + rng.standard_normal(400))
    write_csv(recording(current, growing), tmp_path / "growing.csv")
    (tmp_path / "no_speed.csv").write_text("time_s,pump_current_ma\n" + "".join(f"{k / 5},{k}\n" for k in range(50)))
    (tmp_path / "header.csv").write_text("time_s,pump_current_ma,ground_speed_mps\n")
    return tmp_path


def judged(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_it_speaks_draws_and_leaves_a_model_that_is_the_next_start(verb, tables):
    code, out, err = verb(
        "identify", "one.csv", "two.csv", "--model", "arx:na=1,nb=2,delay_s=0.4+dead_zone", "-o", "m/new.yaml"
    )
    assert (code, err) == (0, "")
    for words in (
        "2 recordings, 900 samples of 0.2 s, filtered at 1 Hz; delay 0.4 s",
        "dead_zone.threshold_ma",
        "time constants: 0.",
        "held out",
        "persistence",
        "residuals one step ahead",
        "picture: out/identify.png",
        "model: m/new.yaml; next: cruise run with it",
    ):
        assert words in out
    assert max(map(len, out.splitlines())) <= 80
    assert (tables / "out" / "identify.png").read_bytes().startswith(b"\x89PNG")

    file = files.read(tables / "m" / "new.yaml")
    assert (file.family, file.period_s, file.delay_s) == ("arx", 0.2, 0.4)
    assert file.provenance.recordings == ("one.csv, 0 to 119.8 s", "two.csv, 0 to 59.8 s")
    assert file.provenance.samples == 900
    assert file.provenance.made_by == "cruise identify --model arx:na=1,nb=2,delay_s=0.4+dead_zone"
    assert len(file.provenance.made_on) == len("2026-01-31")
    assert "filtered at 1 Hz" in file.provenance.note

    code, out, _ = verb("identify", "one.csv", "two.csv", "--model", "m/new.yaml", "--json")
    assert code == 0
    again = judged(out)
    assert again["structure"] == "arx:na=1,nb=2,delay_s=0.4+dead_zone"
    assert again["held_out"]["rmse_mps"] == pytest.approx(file.provenance.error_ahead_mps, rel=0.01)
    found = {name: value["value"] for name, value in again["parameters"].items()}
    assert found == pytest.approx(file.parameters, rel=0.02)
    assert again["effects"]["dead_zone"]["threshold_ma"] == pytest.approx(
        file.effects["dead_zone"]["threshold_ma"], abs=2.0
    )


def test_json_is_json_and_nothing_else(verb, tables):
    code, out, err = verb("identify", "one.csv", "--model", "arx10", "--cutoff", "0", "--horizon", "1", "--json")
    assert (code, err) == (0, "")
    found = judged(out)
    assert found["model"] == "arx10"
    assert found["structure"] == "arx:na=1,nb=3,delay_s=0.5"
    assert found["delay_s"] == 0.4
    assert found["horizon_s"] == pytest.approx(1.0)
    assert (found["samples"], found["recordings"], found["training_data"]) == (600, ["one.csv"], "not filtered")
    assert found["input_filtered_for_validation"] is False
    assert list(found["parameters"]) == ["a_1", "b_0_mps_per_ma", "b_1_mps_per_ma", "b_2_mps_per_ma", "c_0_mps"]
    assert all(one["standard_error"] > 0.0 for one in found["parameters"].values())
    for name in ("held_out", "training", "free_run", "persistence"):
        assert found[name]["samples"] > 500
    assert found["persistence"]["samples"] == found["training"]["samples"]
    assert found["held_out"]["explained_pct"] > 80.0 > found["persistence"]["explained_pct"]
    assert (found["model_file"], found["doubts"]) == (None, [])


def test_the_picture_says_that_the_fit_knew_what_it_predicts(verb, tables, monkeypatch):
    drawn = []
    monkeypatch.setattr(plt, "close", drawn.append)
    assert verb("identify", "one.csv", "--model", "arx10")[0] == 0
    monkeypatch.undo()
    (figure,) = drawn
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == [
        "measured",
        "predicted 3 s ahead, training data",
    ]
    plt.close(figure)


def test_an_unstable_predictor_is_a_dash_and_never_a_number(verb, tables):
    words = ("identify", "growing.csv", "--model", "arx:na=1,nb=1,delay_s=0", "--cutoff", "0", "-o", "m.yaml")
    code, out, _ = verb(*words)
    assert code == 0
    assert "unstable predictor: pole at 1.02" in out
    for name in ("held out", "training", "free run"):
        (row,) = (line for line in out.splitlines() if line.strip().startswith(name))
        assert row.split()[-5:] == ["-"] * 5
    provenance = files.read(tables / "m.yaml").provenance
    assert provenance.error_ahead_mps is None
    assert "unstable predictor: pole at 1.02" in provenance.note
    found = judged(verb(*words[:-2], "--json")[1])
    assert found["unstable"] == "pole at 1.02"
    assert found["held_out"] is found["training"] is found["free_run"] is None


def test_what_can_not_be_held_out_is_said(verb, tables):
    code, out, _ = verb("identify", "short.csv", "--model", "arx:na=1,nb=5,delay_s=0", "--cutoff", "0", "-o", "m.yaml")
    assert code == 0
    assert "nothing held out: " in out
    assert "don't drive with this model:\n  nothing shows how well it predicts" in out
    assert "next: drive some minutes" in out
    assert "cruise run" not in out
    assert "too few to say whether they are white" in out
    assert "nan" not in out
    assert files.read(tables / "m.yaml").provenance.error_ahead_mps is None


def test_noise_parameters_of_armax_are_kept_for_the_next_fit(verb, tables):
    write_csv(SYSTEMS["armax"].record(3), tables / "coloured.csv")
    words = ("--model", "armax:na=2,nb=2,nc=1,delay_s=0.4", "--cutoff", "0", "-o", "armax.yaml")
    assert verb("identify", "coloured.csv", *words)[0] == 0
    file = files.read(tables / "armax.yaml")
    assert file.family == "armax"
    assert file.noise_parameters == pytest.approx((0.6,), abs=0.15)
    again = judged(verb("identify", "coloured.csv", "--model", "armax.yaml", "--cutoff", "0", "--json")[1])
    assert again["parameters"]["noise_1"]["value"] == pytest.approx(file.noise_parameters[0], abs=1e-3)


def test_polynomials_are_shown_but_not_saved(verb, tables):
    found = judged(verb("identify", "one.csv", "--model", "narx:na=1,nb=2,degree=2,delay_s=0.4", "--json")[1])
    assert {"a_1", "h1_0_mps", "h2_1_mps", "c_0_mps"} <= set(found["parameters"])
    assert found["held_out"]["explained_pct"] > 80.0


def test_many_notes_are_counted_not_shown(verb, tables):
    one = SYSTEMS["hammerstein"].record(1)
    for number in range(7):
        speed = one.output.copy()
        speed[100 : 110 + 10 * number : 10] = np.nan
        write_csv(Recording(one.time_s, {INPUT: one.input, OUTPUT: speed}, 0.2, "n"), tables / f"n{number}.csv")
    words = ("identify", *(f"n{number}.csv" for number in range(7)), "--model", "arx:na=0,nb=1,delay_s=0.4")
    _, out, _ = verb(*words)
    assert out.count("note: ") == 5
    assert "and 2 notes more (--json has them all)" in out
    assert len(judged(verb(*words, "--json")[1])["notes"]) == 7


MISTAKES = {
    "none.csv": r"none.csv: no such file",
    "header.csv": r"header.csv: 0 usable rows are too few",
    "short.csv": r"0 usable samples for 5 parameters: record for longer (26 before the filter",
    "still.csv": r"the current is 700 mA throughout; drive steps of different size",
    "parked.csv": r"the speed is 0 m/s throughout, there is nothing to identify: drive the machine",
    "no_speed.csv": r"no column 'ground_speed_mps' for output; it has time_s, pump_current_ma; choose with --output",
    "slow.csv": r"slow.csv is sampled every 0.5 s, too slowly for a model of 0.2 s: give --period 0.5 or more",
    "one.csv slow.csv": r"slow.csv is sampled every 0.5 s, too slowly",
    "wave.csv --model arx2 --cutoff 0": r"parameters can be told apart",
    "one.csv --model arx10b": r"did you mean arx10B?",
    "one.csv --model arx10+dead_zne": r"did you mean dead_zone?",
    "one.csv --model arx10+engine_speed": r"one.csv: the model needs engine_speed_rpm, which the recording",
    "one.csv --model none.yaml": r"none.yaml: no such file",
    "one.csv --model one.csv": r"one.csv:1: expected settings",
    "one.csv --model narx1 -o m.yaml": r"polynomials can't drive",
    "one.csv --model arx3 -o m.yaml": r"a model without the current can't drive",
    "one.csv --model armax:na=1,nb=1,nc=0,delay_s=0": r"an ARMAX model without a noise model is an ARX model",
    "one.csv --input amps": r"no column 'amps' for input",
    "one.csv --columns none.yaml": r"none.yaml: no such file",
    "one.csv --period 0": r"--period 0: give a time in s above 0",
    "one.csv --period nan": r"--period nan: give a time",
    "one.csv --period 60": r"2 samples of 60 s are too few; choose a shorter period",
    "one.csv --cutoff -1": r"--cutoff -1: give a frequency in Hz, or 0 for no filter",
    "one.csv --horizon 0": r"--horizon 0: give a time",
    "one.csv --model arx10 --horizon 500": r"no sample has 500 s of whole recording before it",
    "one.csv --picture p.txt": r"--picture p.txt: let the name end in .png",
    "one.csv -o .": r"--out .: let the name end in .yaml",
    "one.csv -o m.txt": r"--out m.txt: let the name end in .yaml or .yml",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_gets_one_clear_line(verb, tables, words):
    code, out, err = verb("identify", *words.split())
    assert (code, out) == (2, "")
    assert MISTAKES[words] in err
    assert err.startswith("cruise: ")
    assert len(err.splitlines()) == 1
    assert not (tables / "out" / "identify.png").exists()


def test_measured_drives_are_explained_and_beat_persistence_by_far(verb, dart):
    paths = sorted(dart.glob("*/*.csv"))[::8]
    words = ("--columns", CONFIG / "dart_columns.yaml", "--period", 0.1, "--model", "arx10+dead_zone", "--json")
    code, out, _ = verb("identify", *paths, *words)
    assert code == 0
    found = judged(out)
    assert len(found["recordings"]) == len(paths)
    assert found["held_out"]["rmse_mps"] < 0.4 * found["persistence"]["rmse_mps"]
    assert found["held_out"]["explained_pct"] > 70.0
    assert found["effects"]["dead_zone"]["threshold_ma"] == pytest.approx(180.0, abs=60.0)
