"""The paper redone: what is published is whole, aggregation is right, and one short seed goes all the way."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cruise.identification.structures import PRESETS
from cruise.paper import published as printed
from cruise.paper import records
from cruise.paper.figures import Statement, power_share, rise_s, top_speed_mps
from cruise.paper.reproduce import Reproduction, Run, _rows, _stated, run_seed
from cruise.paper.tables import Cell
from cruise.plant.engine import EngineSettings
from cruise.recording import Recording
from cruise.settings import SettingsError

FOLDER = Path(__file__).parents[2] / "config" / "paper"
PUBLISHED = printed.load(FOLDER / "published.yaml")


def test_all_published_models_are_known_and_every_table_is_there():
    assert set(PUBLISHED.explained_pct) == {"I", "II", "III", "IV"}
    for rows in PUBLISHED.explained_pct.values():
        assert set(rows) <= set(PRESETS)
    assert sum(len(rows) for rows in PUBLISHED.explained_pct.values()) == 22
    assert len(PUBLISHED.steps_explained_pct) == 6
    assert len(PUBLISHED.dc_gain_pct) == 9


def test_twins_are_one_structure():
    for arx, oe in (("arx9", "oe8"), ("arx8", "oe7"), ("arx7", "oe6")):
        assert (PRESETS[arx].na, PRESETS[arx].nb, PRESETS[arx].delay_s) == (
            PRESETS[oe].na,
            PRESETS[oe].nb,
            PRESETS[oe].delay_s,
        )


def run(seed: int, *values: float | None, agrees: bool = True) -> Run:
    cells = tuple(Cell("I", f"m{i}", 20.0, 70.0, value) for i, value in enumerate(values))
    return Run(seed, cells, (Statement("2", "cut-off", "at 1 Hz", 1.0 + 0.1 * seed, "Hz", agrees),))


def test_rows_are_means_and_a_model_unstable_in_most_seeds_is_unstable():
    rows = _rows([run(0, 70.0, None, None), run(1, 74.0, 60.0, None), run(2, 78.0, None, 50.0)])
    assert [row.ours for row in rows] == [74.0, None, None]
    assert rows[0].spread == pytest.approx(4.0)
    assert rows[0].difference == pytest.approx(4.0)
    assert [row.unstable_pct for row in rows] == pytest.approx([0.0, 200 / 3, 200 / 3])
    assert rows[1].difference is None


def test_statements_are_means_with_the_share_that_agrees():
    stated = _stated([run(0), run(1, agrees=False), run(2)])[0]
    assert stated.ours == pytest.approx(1.1)
    assert stated.agrees_pct == pytest.approx(200 / 3)


def test_the_margin_on_steps_is_over_the_next_best_that_is_stable():
    def reproduction(arx10b: float | None) -> Reproduction:
        cells = (
            Cell("V", "arx10B", 20.0, 91.3, arx10b),
            Cell("V", "arx7B", 20.0, 58.8, 60.0),
            Cell("V", "narx2", 20.0, None, None),
        )
        return Reproduction((0,), _rows([Run(0, cells, ())]), (), None)  # pyright: ignore[reportArgumentType]

    assert reproduction(85.0).steps_margin == pytest.approx(25.0)
    assert math.isnan(reproduction(None).steps_margin)
    assert [row.model for row in reproduction(None).stability_differs] == ["arx10B"]


def recording(current_ma: np.ndarray, speed_mps: np.ndarray) -> Recording:
    return Recording(
        0.05 * np.arange(len(current_ma)), {"pump_current_ma": current_ma, "ground_speed_mps": speed_mps}, 0.05, "made"
    )


def test_top_speed_and_time_to_it():
    current = np.concatenate([np.full(100, 500.0), np.full(300, 1200.0)])
    speed = np.concatenate([np.full(100, 0.5), 2.0 - 1.5 * np.exp(-0.05 * np.arange(300))])
    made = recording(current, speed)
    assert top_speed_mps(made) == pytest.approx(2.0, abs=1e-3)
    assert rise_s(made) == pytest.approx(-math.log(0.05 * 2.0 / 1.5), abs=0.06)


def test_power_is_relative_to_rated_speed_and_lies_above_proportional_where_torque_rises():
    shares = power_share(EngineSettings(), np.array([1500.0, 2100.0]))
    assert shares[1] == 1.0
    assert shares[0] > 1500.0 / 2100.0


def short(setting: records.Setting) -> records.Setting:
    """The same machine with experiments of a few seconds."""
    lengths = {"noise": 60.0, "noise_unseen": 40.0, "noise_minute": 10.0, "steps": 40.0, "gear_steps": 32.0}
    shorter = {
        name: msgspec.structs.replace(one, excitation=one.excitation.lasting(lengths[name])) if name in lengths else one
        for name, one in setting.experiments.items()
    }
    return records.Setting(setting.plant, shorter)


def test_one_short_seed_fills_every_cell_and_statement():
    setting = short(records.load(FOLDER))
    first = run_seed(setting, PUBLISHED, 7)
    assert len(first.run.cells) == 2 * 22 + 6 + 9
    by_key = {cell.key: cell for cell in first.run.cells}
    for rate_hz in (20.0, 5.0):
        assert by_key["I", "arx7", rate_hz].ours == pytest.approx(by_key["II", "oe6", rate_hz].ours, rel=1e-9)
    level = by_key["VI", "+0.0 deg, 15700 kg", 20.0]
    uphill = by_key["VI", "+4.4 deg, 17200 kg", 20.0]
    assert level.ours == pytest.approx(100.0)
    assert uphill.ours is not None
    assert uphill.ours < 99.0
    assert {one.figure for one in first.run.statements} == {"2", "3", "4", "5", "IV.B.2", "6", "7"}
    explained = {one.about: one.ours for one in first.run.statements}
    assert explained["gear 2: rescaled arx10B"] == pytest.approx(explained["gear 2: acceleration rescaled arx10B"])


def test_a_folder_without_an_experiment_says_which(tmp_path):
    (tmp_path / "experiments.yaml").write_text("experiments: []\n")
    with pytest.raises(SettingsError, match="no experiment named noise"):
        records.load(tmp_path)
