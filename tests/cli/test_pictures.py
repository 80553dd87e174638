"""What is written in the pictures of `cruise compare` and `cruise orders` can be read, and hides nothing."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib import pyplot as plt

from cruise.csv_file import write_csv
from cruise.report import comparison_picture
from cruise.validation.regimes import HeatMap, Regime, Regimes, Table
from tools.benchmarks.recovery import SYSTEMS

LABELS = ("< 0", "0 to 0.02", "0.02 to 0.04", "0.04 to 0.06", "0.06 to 0.1", "> 0.1")


def table(key: str) -> Table:
    shares = np.full(len(LABELS), 1.0 / len(LABELS))
    return Table(key, key, "m/s2", LABELS, shares, shares, shares, shares)


def regimes(*, named: bool) -> Regimes:
    """Two quantities of six bins, both named or both within noise."""
    tables = table("acceleration"), table("time since the start")
    told = tuple(Regime(one.key, "", 0.1, 0.5, 0.4, 0.6, 0.0, 0.01, named) for one in tables)
    shares = np.full((6, 6), 1.0 / 36.0)
    return Regimes(tables, told, HeatMap(*tables, shares, shares, shares, 0.4, 0.3, 0.5, np.zeros(3, int)))


@pytest.fixture
def figure():
    drawn = plt.figure(figsize=(13, 5), layout="constrained")
    yield drawn
    plt.close(drawn)


def test_no_label_or_legend_of_the_bars_is_written_over_another(figure):
    _, right = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))
    comparison_picture._bars(right, regimes(named=False))
    figure.canvas.draw()
    for axis in right.axes:
        labels = [one.get_window_extent() for one in axis.get_xticklabels()]
        assert not any(one.overlaps(other) for one, other in pairwise(labels))
    (legend,) = right.legends
    assert not any(legend.get_window_extent().overlaps(axis.get_tightbbox()) for axis in right.axes)


@pytest.mark.parametrize("named", [True, False])
def test_a_map_of_noise_says_so_and_its_labels_stand_beside_its_title(figure, named):
    left, _ = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))
    where = regimes(named=named)
    assert where.heat_map is not None
    comparison_picture._map(left, where.heat_map, named)
    figure.canvas.draw()
    axis = left.axes[0]
    assert axis.get_title(loc="left").endswith(" - within noise") is not named
    title = axis.yaxis.label.get_window_extent()
    assert not any(title.overlaps(one.get_window_extent()) for one in axis.get_yticklabels())


def test_the_legend_of_orders_hides_no_point(verb, tmp_path, monkeypatch):
    write_csv(SYSTEMS["hammerstein"].record(1)[:200], tmp_path / "one.csv")
    drawn = []
    monkeypatch.setattr(plt, "close", drawn.append)
    assert verb("orders", "one.csv")[0] == 0
    monkeypatch.undo()
    (picture,) = drawn
    picture.canvas.draw()
    left = picture.axes[0]
    assert not left.get_legend().get_window_extent().overlaps(left.get_window_extent())
    plt.close(picture)


def test_the_labels_of_the_map_break_between_words_alone(figure):
    where = regimes(named=True)
    assert where.heat_map is not None
    rows = replace(where.heat_map.rows, labels=("accelerating", "800 to 1000", "steady", "", "", ""))
    comparison_picture._map(figure, replace(where.heat_map, rows=rows), True)
    assert [one.get_text() for one in figure.axes[0].get_yticklabels()][:2] == ["accelerating", "800 to\n1000"]


@pytest.mark.parametrize("words", [("compare", "--model"), ("identify", "--model"), ("explore",)])
def test_a_name_with_dollars_is_no_formula(verb, tmp_path, words):
    rng = np.random.default_rng(4)
    current = np.repeat(rng.uniform(400.0, 1000.0, 30), 60)
    speed = np.convolve(current, np.exp(-np.arange(60) / 12.0) / 4000.0)[:1800] + rng.normal(0.0, 0.005, 1800)
    rows = "".join(f"{0.05 * k:.2f},{current[k]:.1f},{speed[k]:.4f}\n" for k in range(1800))
    path = tmp_path / "drive_$a_$b_.csv"
    path.write_text("time_s,pump_current_ma,ground_speed_mps\n" + rows)
    model = ["arx:na=1,nb=3,delay_s=0.2"] if len(words) > 1 else []
    code, _, err = verb(words[0], path, *words[1:], *model, "--picture", tmp_path / "one.png")
    assert (code, err) == (0, "")
