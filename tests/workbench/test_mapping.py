"""What the columns of a file mean: guessed, asked, in which unit, and read as the command line reads it."""

from contextlib import closing

import numpy as np
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from pyarrow import parquet

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from nicegui import Client
from nicegui.page import page

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import LogWriter
from cruise.can.settings import CanSettings
from cruise.cli.places import CONFIG
from cruise.columns import ColumnSettings
from cruise.service.recordings import ReadingSettings, read_recording
from cruise.service.recordings.names import names_in
from cruise.signals import CONTEXT, INPUT, OUTPUT
from cruise.usual_names import TIME, USUAL, guessed
from cruise.workbench.views.mapping import AS_IT_IS, AS_SET, _choice, known, reading_of


def test_columns_are_guessed_and_meant():
    names = ["time_s", "pump_curent_ma", "v", "engine_speed_rpm"]
    found = guessed(names, ["time_s", "pump_current_ma", "ground_speed_mps", "engine_speed_rpm"])
    assert found == {
        "time_s": "time_s", "pump_curent_ma": "pump_current_ma", "v": "ground_speed_mps",
        "engine_speed_rpm": "engine_speed_rpm",
    }  # fmt: skip
    meant = {
        "t": ("time_s", "ms"),
        "I": ("pump_current_ma", "A"),
        "v": ("ground_speed_mps", "km/h"),
        "n": ("engine_speed_rpm", "rpm"),
        "x": (AS_IT_IS, "-"),
    }
    reading = reading_of(ReadingSettings(), meant)
    assert (reading.time, reading.input, reading.output) == ("t", "I", "v")
    assert reading.columns["v"] == ColumnSettings(scale=1 / 3.6)
    assert reading.columns["n"] == ColumnSettings(signal="engine_speed_rpm")
    assert "x" not in reading.columns


@pytest.mark.parametrize(
    "meant",
    [
        {
            "Time [s]": (TIME, "s"),
            "I_pump [mA]": (INPUT, "mA"),
            "v_vehicle [km/h]": (OUTPUT, "km/h"),
            "Slope [%]": ("pitch_deg", "%"),
            "EngSpeed [rpm]": ("engine_speed_rpm", "rpm"),
            "T_oil [°C]": ("oil_temperature_c", "degC"),
            "EngLoad [%]": ("engine_load_pct", "%"),
        },
        {
            "t_ms": (TIME, "ms"),
            "Current (A)": (INPUT, "A"),
            "Speed_kmh": (OUTPUT, "km/h"),
            "wheelSpeed": ("wheel_speed_mps", "m/s"),
            "rpm": ("engine_speed_rpm", "rpm"),
            "Gear": ("gear", "-"),
            "Pitch angle [rad]": ("pitch_deg", "rad"),
            "mass [t]": ("machine_mass_kg", "t"),
            "Oil temp. [K]": ("oil_temperature_c", "K"),
            "load [%]": ("engine_load_pct", "%"),
            "pressure [psi]": ("line_pressure_bar", "psi"),
        },
        {"i": (INPUT, AS_SET), "v": (OUTPUT, "m/s"), "t": (TIME, "s")},
    ],
)
def test_usual_names_are_guessed_with_their_units(meant):
    names, meanings = [*meant, "header_height_mm"], [TIME, INPUT, OUTPUT, *CONTEXT]
    assert known(ReadingSettings(), names, meanings) == meant


@pytest.mark.parametrize(
    "name",
    [
        "pump_current_command_ma",
        "target speed [km/h]",
        "fan_speed",
        "ambient temperature [degC]",
        "v [V]",
        "T_s",
        "[s]",
    ],
)
def test_what_may_be_something_else_is_not_guessed(name):
    assert known(ReadingSettings(), [name], [INPUT, OUTPUT, *CONTEXT]) == {}


def test_every_word_is_of_a_signal_that_is_offered():
    assert set(USUAL) == {TIME, INPUT, OUTPUT, *CONTEXT}


def test_every_kind_of_file_says_how_its_columns_are_called(tmp_path):
    settings = ReadingSettings(database=str(CONFIG / "cruise.dbc"))
    numbers = np.arange(20.0)
    (tmp_path / "a.csv").write_text("t; I ;v\n0;1;2\n")
    parquet.write_table(pa.table({"t": numbers, "I": numbers}), tmp_path / "a.parquet")
    with MDF() as file:
        file.append([Signal(numbers, numbers, name="I")])
        file.append([Signal(numbers, numbers, name="v")])
        file.save(tmp_path / "a.mf4")
    codec = Codec.load(CONFIG / "cruise.dbc", CanSettings())
    frame = codec.encode("DriveFeedback", {INPUT: 700.0, OUTPUT: 2.0}, 5.0)
    with closing(LogWriter.create(tmp_path / "a.log")) as log:
        log.write(frame)
        log.write(Frame(timestamp=5.1, arbitration_id=0x18FEEE00, data=bytes(8)))
    assert names_in(tmp_path / "a.csv", settings) == ["t", "I", "v"]
    assert names_in(tmp_path / "a.parquet", settings) == ["t", "I"]
    assert names_in(tmp_path / "a.mf4", settings) == ["I", "v"]
    assert {INPUT, OUTPUT} <= set(names_in(tmp_path / "a.log", settings))
    assert names_in(tmp_path / "a.log", ReadingSettings()) == [], "nobody has said what the frames mean"


def test_what_was_said_of_columns_is_known_again():
    names, meanings = ["t", "I", "v", "engine_speed_rpm", "x"], [TIME, INPUT, OUTPUT, "engine_speed_rpm", "pitch_deg"]
    meant = {"t": (TIME, "ms"), "I": (INPUT, "A"), "v": (OUTPUT, "km/h"), "x": ("pitch_deg", "rad")}
    assert known(reading_of(ReadingSettings(), meant), names, meanings) == meant | {
        "engine_speed_rpm": ("engine_speed_rpm", "rpm")
    }


def test_what_the_settings_say_holds_on_where_nothing_else_is_said():
    usual = ReadingSettings(
        input="I",
        output="v",
        columns={
            "v": ColumnSettings(scale=0.277778),
            "I": ColumnSettings(scale=7.5),  # of no unit here
            "header": ColumnSettings(scale=0.1),
            "sp": ColumnSettings(signal="setpoint_mps", scale=0.277778),
            "slope": ColumnSettings(signal="pitch_deg", scale=2.0),
            "grade": ColumnSettings(signal="pitch_deg"),
        },
    )
    names, meanings = ["time_s", "I", "v", "header", "sp", "slope"], [TIME, INPUT, OUTPUT, "pitch_deg"]
    meant = known(usual, names, meanings)
    assert meant["v"] == (OUTPUT, "km/h")
    assert meant["slope"] == ("pitch_deg", AS_SET)
    asked = {name: meant.get(name, (AS_IT_IS, "-")) for name in names}
    again = reading_of(usual, asked).columns
    assert again["v"].scale == pytest.approx(0.277778, rel=1e-5)
    assert {name: again[name] for name in ("I", "header", "sp", "slope")} == {
        name: usual.columns[name] for name in ("I", "header", "sp", "slope")
    }
    assert "grade" not in again, "another column is the slope now"
    assert "slope" not in reading_of(usual, asked | {"slope": (AS_IT_IS, "-")}).columns, "it goes by its own name"


@pytest.mark.parametrize(
    ("name", "meaning", "unit"),
    [
        ("ground_speed_kmh", OUTPUT, "km/h"),
        ("Radar [km/h]", OUTPUT, "km/h"),
        ("wheel_speed_kmh", "wheel_speed_mps", "km/h"),
        ("pitch_rad", "pitch_deg", "rad"),
        ("oil_temperature_f", "oil_temperature_c", "degF"),
        ("line_pressure_psi", "line_pressure_bar", "psi"),
        ("machine_mass_t", "machine_mass_kg", "t"),
        ("engine_speed_rps", "engine_speed_rpm", "1/s"),
        ("pump_current_a", INPUT, "A"),
        ("pump_current_pct", INPUT, "%"),
        ("time_ms", TIME, "ms"),
        ("pitch_s", "pitch_deg", "deg"),  # no unit of a slope
    ],
)
def test_the_name_of_a_column_says_its_unit(name, meaning, unit):
    assert known(ReadingSettings(input="I", output="Radar [km/h]"), [name], [meaning]) == {name: (meaning, unit)}


@pytest.mark.parametrize("name", ["pump_pct", "I"])
def test_a_share_of_the_current_is_read_as_the_command_line_reads_it(name, tmp_path):
    """Its unit is known by its size, with a note, as long as nobody says another."""
    path = tmp_path / "share.csv"
    time_s = 0.1 * np.arange(200)
    share_pct = 50.0 + 50.0 * np.sin(time_s)
    table = np.column_stack([time_s, share_pct, 0.02 * share_pct])
    np.savetxt(path, table, delimiter=",", header=f"time_s,{name},ground_speed_mps", comments="")
    usual = ReadingSettings(input=name)
    meant = known(usual, ["time_s", name, OUTPUT], [TIME, INPUT, OUTPUT])
    reading = reading_of(usual, meant)
    assert reading == usual
    told = read_recording(path, reading)
    assert told.input.max() == pytest.approx(10.0 * share_pct.max())
    assert any("read as per cent" in note for note in told.notes)
    in_ma = read_recording(path, reading_of(usual, meant | {name: (INPUT, "mA")}))
    assert in_ma.input.max() == pytest.approx(share_pct.max())


def test_a_measurement_is_told_the_share_that_its_reader_does_not_look_for():
    meant = {"pump_pct": (INPUT, "%"), "v": (OUTPUT, "m/s")}
    assert reading_of(ReadingSettings(), meant).columns["pump_pct"] == ColumnSettings(scale=10.0)


def test_what_a_column_is_called_is_never_read_as_properties():
    name = 'speed "GPS" innerHTML="<img src=x>'
    with Client(page(""), request=None):
        meaning, unit = _choice(name, [TIME], TIME, "s")
    assert meaning.props["aria-label"] == f"meaning of {name}"
    assert unit.props["aria-label"] == f"unit of {name}"
    assert "innerHTML" not in meaning.props
