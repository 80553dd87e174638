"""Which way a machine goes by its input."""

import numpy as np
import pytest

from cruise.columns import ColumnSettings, RecordingSettings
from cruise.csv_file import read_csv
from cruise.directions import middle
from tests.csv_files import csv_of

DT_S = 0.05
LAG = 6  # samples: 0.3 s
STANDS = "it stands at about"


def lever(seed: int = 1, count: int = 6000) -> np.ndarray:
    """Where the lever stands, -1 to 1: some seconds each, in its middle in between."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1.0, 1.0, count // 120)
    places[::4] = 0.0
    return np.repeat(places, 120)


def answer(place: np.ndarray, zone: float = 0.0) -> np.ndarray:
    """The speed in m/s of a machine that comes late and slowly, with noise."""
    wanted = 4.0 * np.sign(place) * np.maximum(np.abs(place) - zone, 0.0)
    late = np.concatenate([np.zeros(LAG), wanted[:-LAG]])
    speed = np.zeros_like(late)
    for k in range(1, len(late)):
        speed[k] = speed[k - 1] + DT_S / 0.4 * (late[k] - speed[k - 1])
    return speed + 0.01 * np.random.default_rng(2).standard_normal(len(speed))


@pytest.mark.parametrize("zone", [0.0, 0.2])
@pytest.mark.parametrize(("at", "full"), [(1000.0, 700.0), (2.5, 2.0), (-500.0, 400.0)])
def test_a_lever_has_its_middle_where_the_machine_stands(at, full, zone):
    place = lever()
    assert middle(at + full * place, answer(place, zone), DT_S) == pytest.approx(at, abs=0.01 * full)


def test_a_machine_that_seldom_stands_has_its_middle_between_the_two_ways():
    place = lever()
    place[place == 0.0] = 0.6
    assert middle(1000.0 + 700.0 * place, answer(place), DT_S) == pytest.approx(1000.0, abs=0.05 * 700.0)


def test_an_input_of_both_signs_and_a_machine_that_goes_one_way_have_it_at_zero():
    place = lever()
    assert middle(700.0 * place, answer(place), DT_S) == 0.0
    assert middle(20.0 + 700.0 * place, answer(place), DT_S) == 0.0, "an offset of a sensor is none"
    assert middle(700.0 * np.abs(place), answer(np.abs(place), 0.3), DT_S) == 0.0


def test_a_machine_that_rolls_back_or_is_driven_by_something_else_has_none():
    place = np.abs(lever())
    rolls = np.where(place < 0.2, -0.8, answer(place))
    assert middle(700.0 * place, rolls, DT_S) == 0.0, "down a slope, whatever its input"
    assert middle(700.0 * place, answer(lever(seed=7)), DT_S) == 0.0
    assert middle(700.0 * place, np.full_like(place, np.nan), DT_S) == 0.0
    assert middle(np.zeros_like(place), answer(place), DT_S) == 0.0
    assert middle(place[:3], place[:3], DT_S) == 0.0


def test_holes_change_nothing():
    place = lever()
    inputs, speeds = 1000.0 + 700.0 * place, answer(place)
    inputs[500:700], speeds[2000:2100] = np.nan, np.nan
    assert middle(inputs, speeds, DT_S) == pytest.approx(1000.0, abs=7.0)


def test_where_it_stands_is_said_with_the_entry_that_counts_from_there(tmp_path):
    place = lever()
    table = np.column_stack([DT_S * np.arange(len(place)), 50.0 + 40.0 * place, answer(place)])
    rows = [f"{time_s:.2f},{per_cent:.6g},{speed_mps:.4f}" for time_s, per_cent, speed_mps in table]
    path = csv_of(tmp_path, rows, "time_s,lever,ground_speed_mps")
    said = [note for note in read_csv(path, RecordingSettings(input="lever")).notes if STANDS in note]
    assert len(said) == 1
    assert "it stands at about 500 mA" in said[0]
    assert "columns: {lever: {scale: 10, offset: -500}} in the file of --columns takes that as 0" in said[0]
    read = read_csv(
        path, RecordingSettings(input="lever", columns={"lever": ColumnSettings(scale=10.0, offset=-500.0)})
    )
    assert not any(STANDS in note for note in read.notes)
    assert np.median(read.input) == pytest.approx(0.0, abs=100.0)
    assert read.input.min() < -300.0
