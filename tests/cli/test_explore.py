"""`cruise explore` as a user meets it."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from cruise.cli.explore import explore
from cruise.csv_file import write_csv
from cruise.recording import RecordingError
from cruise.settings import SettingsError
from tests.identification.explore.drives import lag, noise, recording, steps, through

APP = typer.Typer(pretty_exceptions_enable=False)
APP.command()(explore)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("explore") / "steps.csv"
    u = steps(3000, 1)
    write_csv(recording(u, through(*lag(1.0), 10, u) + noise(3000, 1, 0.01)), path)
    return path


def run(*words: object):
    return CliRunner().invoke(APP, [str(word) for word in words])


def test_it_speaks_and_draws(table, tmp_path):
    ended = run(table, "--picture", tmp_path / "new" / "explore.png")
    assert ended.exit_code == 0, ended.output
    assert ended.output.startswith("1 recording, ")
    for words in ("data quality", "excitation", "frequency response", "speed follows current by", "no ramps in this"):
        assert words in ended.output
    assert (tmp_path / "new" / "explore.png").read_bytes().startswith(b"\x89PNG")


def test_json_is_json_and_nothing_else(table, tmp_path):
    ended = run(table, table, "--json", "--picture", tmp_path / "e.png")
    report = json.loads(ended.stdout, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert report["samples"] == 6000
    assert report["cross_correlation"]["peak_lag_s"] == pytest.approx(0.55, abs=0.05)
    assert report["quality"]["jitter"]["typical_step_s"] == pytest.approx(0.05)


def test_columns_can_be_chosen_and_times_jitter(tmp_path):
    rng, path = np.random.default_rng(1), tmp_path / "t.csv"
    times_s = 0.1 * np.arange(400) + 0.004 * rng.standard_normal(400)
    u = steps(400, 2)
    rows = [f"{t:.4f};{a};{b};x" for t, a, b in zip(times_s, u, u / 300.0, strict=True)]
    path.write_text("\n".join(["stamp; amps; speed; text", *rows]) + "\n", encoding="utf-8")
    columns = tmp_path / "columns.yaml"
    columns.write_text("time: stamp\ncolumns:\n  amps: {scale: 1.0}\n", encoding="utf-8")
    words = ("--columns", columns, "--input", "amps", "--output", "speed", "--json", "--picture", tmp_path / "e.png")
    ended = run(path, *words, "--period", 0.2)
    assert ended.exit_code == 0, ended.output
    report = json.loads(ended.stdout)
    assert report["period_s"] == 0.2
    assert report["quality"]["jitter"]["std_s"] == pytest.approx(0.004 * np.sqrt(2.0), rel=0.15)


def test_a_useless_table_is_drawn_too(tmp_path):
    path = tmp_path / "flat.csv"
    write_csv(recording(np.full(50, 3.0), np.zeros(50)), path)
    ended = run(path, "--picture", tmp_path / "e.png")
    assert ended.exit_code == 0, ended.output
    assert "the current is constant" in ended.output


@pytest.mark.parametrize("period", ["-1", "nan", "0", "inf"])
def test_a_period_that_is_none_is_the_options_fault(table, tmp_path, period):
    ended = run(table, "--picture", tmp_path / "e.png", "--period", period)
    assert isinstance(ended.exception, SettingsError)
    assert str(ended.exception).startswith(f"--period {period}: give a time in s above 0")


def test_what_was_not_measured_is_not_explored(table, tmp_path):
    """A grid finer than the readings holds straight lines between them, and figures of these."""
    ended = run(table, "--picture", tmp_path / "e.png", "--period", 0.01)
    assert isinstance(ended.exception, RecordingError)
    assert str(ended.exception) == (
        f"{table} is sampled every 0.05 s, too slowly for a period of 0.01 s: give --period 0.05 or more, or record "
        "faster"
    )
    assert run(table, "--picture", tmp_path / "e.png", "--period", 0.05).exit_code == 0


def test_recordings_of_two_rates_need_a_period_and_have_no_one_jitter(table, tmp_path):
    u = steps(800, 2)
    write_csv(recording(u, through(*lag(1.0), 3, u), dt_s=0.2), tmp_path / "slow.csv")
    words = (table, tmp_path / "slow.csv", "--picture", tmp_path / "e.png")
    ended = run(*words)
    assert isinstance(ended.exception, RecordingError)
    assert str(ended.exception).endswith("every 0.05 s: give --period 0.2 for all of them")
    ended = run(*words, "--period", 0.2)
    assert "the recordings have sampling steps of 50 to 200 ms" in " ".join(ended.output.split())
    assert "do not vary" not in ended.output


def test_a_missing_file_is_the_users_clear_error(tmp_path):
    ended = run(tmp_path / "none.csv", "--picture", tmp_path / "e.png")
    assert isinstance(ended.exception, RecordingError)
    assert "no such file" in str(ended.exception)
