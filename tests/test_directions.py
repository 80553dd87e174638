"""Which way a machine goes by its input."""

import numpy as np
import pytest
from msgspec import structs

from cruise.columns import ActiveWhen, ColumnSettings, RecordingSettings
from cruise.csv_file import read_csv
from cruise.directions import along, middle, unsigned
from cruise.recording import resample
from cruise.service.recordings import ReadingSettings, Told, read_recordings
from tests.csv_files import csv_of

DT_S = 0.05
LAG = 6  # samples: 0.3 s
STANDS = "it stands at about"
LEVER = RecordingSettings(input="lever")


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


def test_a_size_is_what_is_above_zero_whichever_way_a_machine_goes():
    speeds = answer(lever())
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(speeds))
    assert unsigned(np.abs(speeds) + noise, speeds)
    assert unsigned(40.0 + 10.0 * np.abs(speeds), speeds), "a gauge that shows the charge pressure at rest"
    assert not unsigned(speeds + noise, speeds)
    assert not unsigned(30.0 * np.sign(speeds) + 60.0 * np.sin(0.01 * np.arange(len(speeds))), speeds)
    assert not unsigned(np.abs(speeds), np.abs(speeds)), "it goes one way"
    assert not unsigned(np.zeros_like(speeds), speeds)
    assert not unsigned(np.full_like(speeds, np.nan), speeds)
    holed = np.abs(speeds)
    holed[::3] = np.nan
    assert unsigned(holed, speeds)


def test_a_size_gets_the_sign_of_the_motion_and_keeps_it_while_the_machine_stands():
    speeds = np.array([0.0, 0.01, 2.0, 1.0, 0.01, -0.01, -0.1, -2.0, np.nan, -0.01, 0.01, 3.0])
    signed = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -7.0, -8.0, -9.0, -10.0, -11.0, 12.0]
    np.testing.assert_array_equal(along(np.arange(1.0, 13.0), speeds, 1.0), signed)
    np.testing.assert_array_equal(along(np.full(3, np.nan), np.full(3, np.nan), 0.05), np.full(3, np.nan))
    place = lever()
    noisy = answer(place) + 0.04 * np.random.default_rng(5).standard_normal(len(place))
    wrong = np.sign(along(np.ones(len(place)), noisy, DT_S)) != np.sign(answer(place))
    assert (wrong & (np.abs(answer(place)) > 0.1)).mean() < 0.01, "noise turns nothing but what stands"
    assert not wrong[np.abs(answer(place)) > 1.0].any()


def test_a_gauge_and_a_wheel_without_a_sign_are_read_along_the_motion(tmp_path):
    place = lever()
    speeds = answer(place)
    shown = np.column_stack([700.0 * place, speeds, np.abs(speeds), 30.0 + 20.0 * np.abs(speeds)])
    rows = [f"{DT_S * k:.2f},{','.join(f'{one:.4f}' for one in row)}" for k, row in enumerate(shown)]
    header = "time_s,pump_current_ma,ground_speed_mps,wheel_speed_mps,line_pressure_bar"
    read = read_csv(csv_of(tmp_path, rows, header), RecordingSettings())
    for name in ("wheel_speed_mps", "line_pressure_bar"):
        assert any(note.startswith(f"{name}: above 0 while the machine goes backward") for note in read.notes)
    moves = np.abs(speeds) > 0.5
    np.testing.assert_array_equal(np.sign(read.columns["line_pressure_bar"][moves]), np.sign(speeds[moves]))
    assert np.corrcoef(read.columns["wheel_speed_mps"], speeds)[0, 1] > 0.999


def table(folder, name: str, rest: float, place: np.ndarray):
    """A file of the lever in per cent, and of a flag that is 1 throughout."""
    rows = [
        f"{time_s:.2f},{per_cent:.6g},{speed_mps:.4f},1"
        for time_s, per_cent, speed_mps in zip(
            DT_S * np.arange(len(place)), rest + 40.0 * place, answer(place), strict=True
        )
    ]
    return csv_of(folder, rows, "time_s,lever,ground_speed_mps,on").rename(folder / name)


def test_an_input_is_counted_from_where_the_machine_stands(tmp_path):
    path = table(tmp_path, "one.csv", 50.0, lever())
    read = read_csv(path, LEVER)
    said = [note for note in read.notes if STANDS in note]
    assert len(said) == 1
    assert "it stands at about 500 mA, which is 0 unless the model's file, or input_rest_ma in that of" in said[0]
    assert read.input_rest_ma == 500.0
    np.testing.assert_allclose(read.input, 400.0 * lever(), atol=1e-3)
    assert resample(read, 0.2).input_rest_ma == 500.0
    assert read[100:].input_rest_ma == 500.0
    as_it_is = read_csv(path, structs.replace(LEVER, input_rest_ma=0.0))
    np.testing.assert_allclose(as_it_is.input, 500.0 + 400.0 * lever(), atol=1e-3)
    assert not any(STANDS in note for note in as_it_is.notes)
    elsewhere = read_csv(path, structs.replace(LEVER, input_rest_ma=480.0))
    np.testing.assert_allclose(elsewhere.input, 20.0 + 400.0 * lever(), atol=1e-3)
    turned = structs.replace(LEVER, input_rest_ma=-500.0, columns={"lever": ColumnSettings(scale=-10.0)})
    assert any("the speed falls as the input rises" in note for note in read_csv(path, turned).notes)


def test_where_a_flag_sets_it_to_zero_the_entry_is_said_that_counts_from_there(tmp_path):
    path = table(tmp_path, "one.csv", 50.0, lever())
    gated = structs.replace(LEVER, active_when=ActiveWhen(column="on"))
    (said,) = [note for note in read_csv(path, gated).notes if STANDS in note]
    assert "columns: {lever: {scale: 10, offset: -500}} in the file of --columns takes that as 0" in said
    counted = structs.replace(gated, columns={"lever": ColumnSettings(scale=10.0, offset=-500.0)})
    read = read_csv(path, counted)
    assert not any(STANDS in note for note in read.notes)
    np.testing.assert_allclose(read.input, 400.0 * lever(), atol=1e-3)
    (told,) = read_recordings(
        [path],
        structs.replace(ReadingSettings(input="lever"), active_when=gated.active_when),
        told=Told("", 480.0, "m.yaml"),
    )
    assert told.input_rest_ma == 0.0, "where the flag is off it is 0, whatever the model's recordings were"
    with pytest.raises(ValueError, match="input_rest_ma beside active_when"):
        structs.replace(gated, input_rest_ma=500.0)


def test_recordings_that_are_read_together_are_counted_from_one_place(tmp_path):
    """One goes both ways, in the other the machine never reversed; a model's recordings had another."""
    both = table(tmp_path, "both.csv", 50.0, lever())
    ahead = table(tmp_path, "ahead.csv", 50.0, np.abs(lever(seed=3)))
    settings = ReadingSettings(input="lever")
    assert read_recordings([ahead], settings)[0].input_rest_ma == 0.0
    for paths in ([both, ahead], [ahead, both]):
        read = {one.source: one for one in read_recordings(paths, settings)}[str(ahead)]
        np.testing.assert_allclose(read.input, 400.0 * np.abs(lever(seed=3)), atol=1e-3)
        assert any("lever: counted from 500 mA like that of both.csv" in note for note in read.notes)
    told = Told("", 510.0, "m.yaml")
    (read,) = read_recordings([both], settings, told=told)
    np.testing.assert_allclose(read.input, -10.0 + 400.0 * lever(), atol=1e-3)
    assert any("counted from 510 mA like that of m.yaml, and not from 500" in note for note in read.notes)
    (read,) = read_recordings([both], structs.replace(settings, input_rest_ma=500.0), told=told)
    assert read.input_rest_ma == 500.0, "the settings have the word"
