"""The known drive as channels of an MDF file comes back by the mapping."""

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal

from cruise.columns import ColumnSettings
from cruise.recording import RecordingError
from cruise.service.recordings import ReadingSettings, is_log, measurement, read_recording
from cruise.signals import INPUT, OUTPUT
from tests.service.logs import BY_DBC, DBC, STEP_S, assert_is_the_drive, current_ma, drive, logged, speed_mps


def measured(path: Path, *further: Signal) -> Path:
    """An MDF file with decoded signals as channels: the current at 100 Hz, the speed in km/h at 20 Hz."""
    fast_s, slow_s = 0.01 * np.arange(401), STEP_S * np.arange(81)
    with MDF() as file:
        file.append([Signal(current_ma(fast_s), fast_s, name="I_pump", unit="mA")])
        file.append(
            [
                Signal(3.6 * speed_mps(slow_s), slow_s, name="v_veh", unit="km/h"),
                Signal(300.0 + slow_s, slow_s, name="header_height_mm"),
            ]
        )
        for signal in further:
            file.append([signal])
        file.save(path)
    return path


MAPPED = ReadingSettings(
    input="I_pump", columns={"v_veh": ColumnSettings(signal=OUTPUT, scale=1 / 3.6)}, database=str(DBC)
)


def test_a_measurement_is_its_channels_by_the_mapping(tmp_path):
    read = read_recording(measured(tmp_path / "m.mf4"), MAPPED)
    assert read.dt_s == pytest.approx(STEP_S)  # the slower one's
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=1e-9)
    np.testing.assert_allclose(read.input, current_ma(read.time_s), atol=1e-9)
    np.testing.assert_allclose(read.columns["header_height_mm"], 300.0 + read.time_s, atol=1e-9)
    assert read.notes == ()


def test_channels_that_are_no_numbers_or_come_twice_are_noted(tmp_path):
    time_s = 0.5 * np.arange(9)
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"}
    path = measured(
        tmp_path / "m.mf4",
        Signal(np.array([b"Anna"] * 9), time_s, name="operator", encoding="utf-8"),
        Signal(np.ones(9, dtype="u1"), time_s, name="clutch_pedal", conversion=states),
        Signal(np.full(9, 99.0), time_s, name="v_veh"),
    )
    read = read_recording(path, MAPPED)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=1e-9)
    assert (read.columns["clutch_pedal"][:-1] == 1.0).all()
    assert read.notes == (
        "v_veh: in 2 groups of the file, taken where it has most readings",
        "operator: holds no numbers, left out",
    )


def test_of_thousands_of_channels_only_the_named_ones_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(measurement, "FURTHER_CHANNELS", 3)
    time_s = STEP_S * np.arange(81)
    names = ["pitch_deg", *(f"ecu_{k}" for k in range(4))]
    path = measured(tmp_path / "m.mf4", *(Signal(time_s, time_s, name=name) for name in names))
    read = read_recording(path, MAPPED)
    assert set(read.columns) == {INPUT, OUTPUT, "pitch_deg"}
    assert read.notes == (
        "5 channels that nobody named are left out, such as header_height_mm, ecu_0, ecu_1; "
        "name in columns those that may matter",
    )


def test_a_measurement_without_the_channel_lists_those_it_has(tmp_path):
    path = measured(tmp_path / "m.mf4")
    with pytest.raises(RecordingError, match=r"no column 'pump_current_ma' for input; it has I_pump, v_veh, header"):
        read_recording(path, BY_DBC)


def test_frames_in_a_measurement_count_where_no_channel_is_named(tmp_path):
    logged(tmp_path / "bus.mf4", drive())
    slow_s = STEP_S * np.arange(81)
    with MDF(tmp_path / "bus.mf4") as file:
        file.append([Signal(900.0 + slow_s, slow_s, name="I_pump"), Signal(slow_s, slow_s, name="v_veh")])
        file.save(tmp_path / "both.mf4")
    assert is_log(tmp_path / "both.mf4", BY_DBC)
    assert_is_the_drive(read_recording(tmp_path / "both.mf4", BY_DBC), 2e-3)
    assert not is_log(tmp_path / "both.mf4", MAPPED)
    read = read_recording(tmp_path / "both.mf4", MAPPED)
    np.testing.assert_allclose(read.output, read.time_s / 3.6, atol=1e-9)
    assert set(read.columns) == {INPUT, OUTPUT}
