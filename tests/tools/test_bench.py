"""tools/bench: every part gives its figures on a very short run, and a target that is missed is said to be."""

import io
import json
import math
import subprocess
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer
from rich.console import Console

from cruise import settings
from cruise.plant import Combine, Inputs, PlantSettings

ROOT = Path(__file__).parents[2]


@pytest.fixture
def part(monkeypatch: pytest.MonkeyPatch):
    """Import a module of tools/benchmarks, which is no installed package."""
    monkeypatch.syspath_prepend(str(ROOT))

    def load(name: str) -> ModuleType:
        return import_module(f"tools.benchmarks.{name}")

    return load


@pytest.fixture
def plant() -> PlantSettings:
    """The virtual combine as it is delivered."""
    return settings.load(ROOT / "config" / "plant.yaml", PlantSettings)


def values(measured) -> dict[str, float]:
    """Figures by key, after a look at what every part owes."""
    found = {figure.key: figure.value for figure in measured.figures}
    assert len(found) == len(measured.figures), "two figures with one key"
    json.dumps(measured.as_json(), allow_nan=False)
    return found


@pytest.mark.parametrize(
    ("value", "at_most", "at_least", "verdict"),
    [
        (1.0, 1.0, None, "met"),
        (1.001, 1.0, None, "missed"),
        (0.9, None, 1.0, "missed"),
        (1.0, None, 1.0, "met"),
        (math.nan, 1.0, None, "missed"),
        (math.nan, None, 1.0, "missed"),
        (5.0, None, None, ""),
    ],
)
def test_a_verdict_is_what_the_number_says(part, value, at_most, at_least, verdict):
    figure = part("figures").Figure("key", value, "1", "meaning", at_most, at_least)
    assert figure.verdict == verdict
    assert figure.missed == (verdict == "missed")


def test_a_table_names_value_target_and_verdict(part):
    figures = part("figures")
    paper = io.StringIO()
    shown = figures.Part((figures.Figure("late_ms", 3.25, "ms", "how late", 2.0),), (7,), ("a note",), {"t": [1.0]})
    figures.show("loop", shown, Console(file=paper, width=100))
    text = paper.getvalue()
    for word in ("loop, seeds 7", "how late", "3.25", "<= 2", "missed", "a note"):
        assert word in text


def test_estimator_times_every_contender(part):
    found = values(part("estimator").measure(seconds=20.0, rounds=2))
    assert {"update_p50_us", "update_p99_us", "update_max_us", "over_numpy", "over_padasip", "over_filterpy"} <= set(
        found
    )
    assert 0.0 < found["update_p50_us"] <= found["update_p99_us"] <= found["update_max_us"]
    assert found["updates"] > 2 * 20.0, "the gate must be open for what is timed"


def test_the_contenders_solve_the_same_problem(part):
    estimator = part("estimator")
    rng, true = np.random.default_rng(1), np.array([0.5, -0.2, 1.5])
    rows = rng.standard_normal((400, 3))
    textbook, kalman = estimator.NumpyRls(3), estimator.kalman_rls(3, 0.01)
    for row in rows:
        textbook.adapt(float(row @ true), row)
        kalman.predict()
        kalman.update(float(row @ true), H=row[None, :])
    np.testing.assert_allclose(textbook.theta, true, atol=1e-3)
    np.testing.assert_allclose(kalman.x[:, 0], true, atol=1e-3)


def test_loop_serves_and_engages(part):
    loop = part("loop")
    found = values(loop.measure(seconds=0.5))
    for rate in ("5hz", "20hz"):
        assert 0.0 <= found[f"late_p50_{rate}_ms"] <= found[f"late_p99_{rate}_ms"] <= found[f"late_max_{rate}_ms"]
        assert found[f"tick_p50_{rate}_ms"] <= found[f"tick_p99_{rate}_ms"]
    assert min(row.at_s for row in loop.OPERATOR if row.press == "set") < loop.SECONDS / 2


def test_learning_follows_a_change(part, plant, monkeypatch):
    learning = part("learning")
    changed = learning.changed_machines(plant)["pump_minus_20_pct"]
    monkeypatch.setattr(learning, "changed_machines", lambda _: {"pump_minus_20_pct": changed})
    for name, span_s in (("BEFORE_S", 40.0), ("KNOWN_S", 60.0), ("UNSEEN_S", 40.0)):
        monkeypatch.setattr(learning, name, span_s)
    found = values(learning.measure(seeds=(100,), few_seeds=(200,)))
    assert 0.5 < found["batch_ratio_median"] <= found["batch_ratio_worst"]
    assert 0.0 < found["pump_minus_20_pct_over_stale"] < 1.0, "not following was better"
    assert found["pump_minus_20_pct_followed_pct"] > 0.0


def test_a_change_under_way_changes_the_machine(part, plant):
    learning, recordings = part("learning"), part("recordings")
    changed = learning.changed_machines(plant)["pump_minus_20_pct"]
    alone = recordings.drive(plant, 5, 20.0)
    with_change = recordings.drive(plant, 5, 20.0, changes=[(10.0, changed)])
    before, after = recordings.parts(with_change, 10.0)
    np.testing.assert_array_equal(before.output, alone[: len(before)].output)
    assert np.mean(after.output[10:]) < 0.95 * np.mean(alone[len(before) + 10 :].output)


def test_samples_are_the_recording(part, plant):
    recordings = part("recordings")
    recording = recordings.drive(plant, 5, 4.0)
    taken = recordings.samples(recording)
    assert [sample.speed_mps for sample in taken] == pytest.approx(recording.output.tolist(), nan_ok=True)
    assert [sample.signals["gear"] for sample in taken] == pytest.approx(
        recording.columns["gear"].tolist(), nan_ok=True
    )


def test_constant_speed_compares_the_same_change(part, monkeypatch):
    engaged = part("engaged")
    monkeypatch.setattr(engaged, "STEPS_S", 32.0)
    monkeypatch.setattr(engaged, "HOLD_S", 6.0)
    found = values(engaged.constant_speed(constant_s=12.0))
    for name in ("up", "down"):
        for when in ("before", "after"):
            assert 0.0 <= found[f"overshoot_{name}_{when}_pct"] < 50.0
            assert 0.0 < found[f"settling_{name}_{when}_s"] < engaged.HOLD_S
    assert 0.0 < found["std_ratio"] <= 1.0 + 1e-6
    assert 0.0 < found["std_ratio_ungated"] <= 1.0 + 1e-6


def test_together_reports_every_case(part, monkeypatch):
    engaged = part("engaged")
    monkeypatch.setattr(engaged, "CASES", {name: engaged.CASES[name] for name in ("hill", "drift", "both")})
    monkeypatch.setattr(engaged, "HILL_S", (8.0, 24.0))
    monkeypatch.setattr(engaged, "DRIFT_S", (24.0, 34.0))
    measured = engaged.together(end_s=26.0)
    found = values(measured)
    assert found["c_0_moved_mps"] == 0.0
    assert {"crosstalk_pct", "hill_gain_error_pct", "drift_gain_error_end_pct", "both_d_mps"} <= set(found)
    assert all(math.isfinite(value) for value in found.values())
    assert set(map(len, measured.series.values())) == {1}


def test_the_true_gain_follows_the_pump(part, plant):
    engaged = part("engaged")
    start, end = (engaged.true_gain_mps_per_ma(engaged.worn(plant, now_s), 0.0, 0.05) for now_s in engaged.DRIFT_S)
    assert end / start == pytest.approx(1.0 - engaged.LOST_SHARE, abs=0.02)
    combine = Combine(plant, 0)
    combine.advance(Inputs(engaged.CURRENT_MA), engaged.SETTLE_S)
    assert abs(combine.truth.acceleration_mps2) < 0.02, "the machine has to stand at its steady speed"


def test_driving_reports_every_target(part):
    driving = part("driving")
    found = values(driving.measure(seeds=(0,), seconds=42.0))
    assert {f"{name}_worst" for name in driving.TARGETS} | {"times_real_time"} == set(found)
    assert all(math.isfinite(value) for value in found.values())


def test_the_command_prints_one_json_object():
    said = subprocess.run([ROOT / "tools" / "bench", "plant", "--json"], check=True, capture_output=True, text=True)
    found = json.loads(said.stdout)
    assert set(found) == {"plant"}
    figures = found["plant"]["figures"]
    assert 0.0 < figures["times_real_time"]["value"] <= figures["times_real_time_best"]["value"]
    assert found["plant"]["seeds"] == [1]
    assert "plant ..." in said.stderr


def test_an_unknown_part_is_refused(part):
    with pytest.raises(typer.BadParameter, match="no such part: engine; there are estimator, "):
        part("__main__").bench(["plant", "engine"])
