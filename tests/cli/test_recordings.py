"""The verbs on recordings of every kind: a log of the bus says the same as the table of it."""

import json
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from cruise.can.codec import Codec
from cruise.can.settings import CanSettings
from cruise.cli import reading
from cruise.cli.places import CONFIG
from cruise.columns import RecordingSettings
from cruise.csv_file import read_csv, write_csv
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

DBC = CONFIG / "cruise.dbc"
SAMPLES, PERIOD_S = 1200, 0.05


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """One drive of a first-order system as drive.csv and drive.blf."""
    folder, random = tmp_path_factory.mktemp("drive"), np.random.default_rng(7)
    current_ma = 700.0 + 100.0 * np.repeat(random.integers(-3, 4, SAMPLES // 20), 20)
    speed_mps = np.zeros(SAMPLES)
    for k in range(1, SAMPLES):
        speed_mps[k] = 0.95 * speed_mps[k - 1] + 1.5e-4 * current_ma[k - 1]
    speed_mps += 0.005 * random.normal(size=SAMPLES)
    time_s = PERIOD_S * np.arange(SAMPLES)
    write_csv(Recording(time_s, {INPUT: current_ma, OUTPUT: speed_mps}, PERIOD_S, "x"), folder / "drive.csv")
    codec = Codec.load(DBC, CanSettings())
    with can.Logger(folder / "drive.blf") as logger:
        for t, u, v in zip(time_s.tolist(), current_ma.tolist(), speed_mps.tolist(), strict=True):
            logger(codec.encode("DriveFeedback", {INPUT: u, OUTPUT: v}, 1_700_000_000.0 + t))
            logger(can.Message(arbitration_id=0x18FEEE00, data=bytes(8), timestamp=1_700_000_000.0 + t))
    return folder


def test_explore_says_of_a_log_what_it_says_of_its_table(verb, files):
    told = {}
    for name in ("drive.csv", "drive.blf"):
        code, out, err = verb("explore", files / name, "--json")
        assert code == 0, err
        told[name] = json.loads(out)
    table, log = told["drive.csv"], told["drive.blf"]
    assert log["quality"]["noise"]["std_mps"] == pytest.approx(table["quality"]["noise"]["std_mps"], rel=0.02)
    assert log["quality"]["jitter"]["typical_step_s"] == pytest.approx(PERIOD_S)
    assert any("1200 frames of identifiers" in note for note in log["quality"]["notes"])


def test_identify_finds_the_same_model_in_both(verb, files):
    found = []
    for name in ("drive.csv", "drive.blf"):
        words = ("--model", "arx:na=1,nb=1,delay_s=0.2", "--cutoff", "0", "--json")
        code, out, err = verb("identify", files / name, *words)
        assert code == 0, err
        found.append({key: one["value"] for key, one in json.loads(out)["parameters"].items()})
    assert found[1] == pytest.approx(found[0], rel=0.02, abs=0.01)


def test_replay_sends_what_a_controller_would_of_a_sensor_that_is_a_little_off(verb, files, tmp_path):
    one = read_csv(files / "drive.csv", RecordingSettings())
    further = {"engine_load_pct": np.linspace(-3.0, 90.0, len(one)), "engine_speed_rpm": np.full(len(one), 2000.0)}
    further |= {"gear": np.full(len(one), 2.0), "pitch_deg": np.zeros(len(one))}
    further["engine_load_pct"][100:110] = 900.0
    write_csv(replace(one, columns={**one.columns, **further}), tmp_path / "off.csv")
    code, out, _ = verb("replay", tmp_path / "off.csv")
    assert code == 0
    assert "engine_load_pct: " in out
    assert "values are not within 0 to 125; sent as the nearest" in " ".join(out.split())


def test_replay_takes_a_measurement_without_frames_for_a_table(verb, tmp_path):
    code, _, err = verb("replay", tmp_path / "none.parquet")
    assert code == 2
    assert "none.parquet: no such file" in err


def test_the_database_is_the_command_lines_then_the_settings_then_ours(tmp_path):
    (tmp_path / "columns.yaml").write_text("database: theirs.dbc\ninput: amps\ncan: {addresses: {engine: 5}}\n")
    assert reading.columns_of(None, None, None).database == str(DBC)
    read = reading.columns_of(tmp_path / "columns.yaml", None, None)
    assert read.database == str(tmp_path / "theirs.dbc")
    assert read.can.addresses.engine == 5
    assert reading.columns_of(tmp_path / "columns.yaml", None, None, Path("x.dbc")).database == "x.dbc"


def test_a_wrong_database_ends_with_one_clear_line(verb, files, tmp_path):
    code, _, err = verb("explore", files / "drive.blf", "--database", tmp_path / "none.dbc")
    assert (code, err.count("\n")) == (2, 1)
    assert "none.dbc: no such file; give the path of the CAN database" in err
    code, _, err = verb("explore", files / "drive.blf", "--input", "amps")
    assert (code, err.count("\n")) == (2, 1)
    assert "no column 'amps' for input; it has " in err


def test_the_help_says_what_can_be_opened(verb):
    code, out, _ = verb("explore", "--help")
    assert code == 0
    for word in (".csv", ".parquet", ".log", ".blf", ".mf4", "--database"):
        assert word in out
