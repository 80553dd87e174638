"""`cruise orders` as a user meets it."""

import json

import numpy as np
import pytest

from cruise.csv_file import write_csv
from cruise.effects.dead_zone import DeadZone
from cruise.model import files
from cruise.model.files import Provenance
from cruise.model.model import Model
from tools.benchmarks.recovery import SYSTEMS, recording


@pytest.fixture
def table(tmp_path):
    """y = 1.2 y_1 - 0.35 y_2 + b_0 u_2 + b_1 u_3 + e, at 5 Hz, twice."""
    write_csv(SYSTEMS["arx"].record(1), tmp_path / "one.csv")
    write_csv(SYSTEMS["arx"].record(2), tmp_path / "two.csv")
    return tmp_path


def judged(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_it_ranks_recommends_and_draws(verb, table):
    code, out, err = verb("orders", "one.csv", "two.csv", "--cutoff", 0, "--nb-max", 3, "--picture", "new/orders.png")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "72 structures, 3 s ahead" in lines[0]
    (row,) = (line.split() for line in lines if line.rstrip().endswith("recommended") and "*" in line)
    assert row[:4] == ["2", "2", "0.4", "5"]
    at = next(k for k, line in enumerate(lines) if line.startswith("recommended"))
    assert lines[at + 1].strip() == "arx:na=2,nb=2,delay_s=0.4"
    assert (table / "new" / "orders.png").read_bytes().startswith(b"\x89PNG")


def test_a_narrow_terminal_costs_no_digit(verb, table, monkeypatch):
    words = ("orders", "one.csv", "--na-max", 1, "--nb-max", 1, "--delay-max", 0)
    wide = verb(*words)[1]
    monkeypatch.setenv("COLUMNS", "40")
    assert verb(*words)[1] == wide


def test_json_holds_every_structure_and_is_what_identify_takes(verb, table):
    words = ("--cutoff", 0, "--na-max", 2, "--nb-max", 2, "--delay-max", 0.6, "--json")
    code, out, err = verb("orders", "one.csv", *words)
    assert (code, err) == (0, "")
    found = judged(out)
    assert len(found["candidates"]) == 24
    assert found["recommended"]["model"] == "arx:na=2,nb=2,delay_s=0.4"
    assert found["recommended"]["on_front"]
    errors = [one["rmse_mps"] for one in found["candidates"] if not one["refused"]]
    assert errors == sorted(errors)
    assert all(one["rmse_mps"] is None for one in found["candidates"] if one["refused"])
    again = judged(verb("identify", "one.csv", "--model", found["recommended"]["model"], "--cutoff", 0, "--json")[1])
    # the search leaves out the first samples, from which not all structures can predict
    assert again["held_out"]["rmse_mps"] == pytest.approx(found["recommended"]["rmse_mps"], rel=0.05)


def test_the_effects_are_searched_with_and_written_out(verb, tmp_path):
    write_csv(SYSTEMS["hammerstein"].record(1), tmp_path / "curved.csv")
    few = ("--cutoff", 0, "--na-max", 1, "--nb-max", 2, "--delay-max", 0.4, "--json")
    found = judged(verb("orders", "curved.csv", "--model", "arx10+dead_zone", *few)[1])
    assert found["recommended"]["model"] == "arx:na=1,nb=2,delay_s=0.4+dead_zone"
    assert found["not_held_out"] == ["shapes of dead_zone"]

    model = Model(0.1, 1, 1, 0, (DeadZone(500.0),), (0.5, 1e-4, 0.0))
    files.save(tmp_path / "m.yaml", model, Provenance())
    one = SYSTEMS["hammerstein"].record(1)
    write_csv(recording(np.repeat(one.input, 2), np.repeat(one.output, 2), 0.1), tmp_path / "fast.csv")
    found = judged(verb("orders", "fast.csv", "--model", "m.yaml", *few)[1])
    assert found["period_s"] == 0.1, "the model file's"
    assert found["recommended"]["model"].endswith("+dead_zone")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("one.csv --model oe5", "oe5: the search is over ARX structures; name one, such as arx10B"),
        ("one.csv --model arx11", "did you mean arx1"),
        ("one.csv --period -1", "--period -1: give a time in s above 0"),
        ("one.csv --cutoff nan", "--cutoff nan: give a frequency"),
        ("one.csv --horizon nan", "--horizon nan: give a time"),
        (
            "one.csv --horizon 200 --na-max 0 --nb-max 1 --delay-max 0",
            "none of 1 structures can be judged; the first one: a held-out part has no prediction",
        ),
        ("one.csv --picture .", "--picture .: let the name end in .png"),
        ("still.csv", "none of 120 structures can be judged; the first one: the input does not excite the drive"),
        (
            "short.csv",
            "none of 120 structures can be judged; the first one: no recording is long enough: record for longer",
        ),
        ("none.csv", "none.csv: no such file"),
    ],
)
def test_a_mistake_gets_one_clear_line(verb, table, words, says):
    one = SYSTEMS["arx"].record(1)
    write_csv(recording(np.full(len(one), 700.0), one.output), table / "still.csv")
    write_csv(one[:10], table / "short.csv")
    code, out, err = verb("orders", *words.split())
    assert (code, out) == (2, "")
    assert says in err
    assert len(err.splitlines()) == 1
    assert err.startswith("cruise: ")
