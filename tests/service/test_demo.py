"""The main job: the same seed is the same drive, what is left of it is whole, Ctrl-C leaves the pump in neutral."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cruise.can.frame import Frame
from cruise.can.log import read_log
from cruise.service import course, demo
from cruise.service import settings as service_settings
from cruise.service.demo import Result
from cruise.service.trace import Trace
from cruise.settings import SettingsError
from tests.service.drive import CONFIG, codec, cruise_settings, plant_settings

SECONDS = 23.0  # s; the operator of demo.yaml engages at about 20 s


def drive(seed: int, seconds: float = SECONDS, **more) -> Result:
    return demo.run(
        cruise_settings(), plant_settings(), course.load(CONFIG / "demo.yaml"), seed, seconds=seconds, **more
    )


@pytest.fixture(scope="module")
def logged(tmp_path_factory) -> tuple[Result, Path]:
    log = tmp_path_factory.mktemp("demo") / "drive.log"
    return drive(1, log=log), log


def commands(frames) -> Iterator[tuple[float, bool, float]]:
    """Time, active, current of every command among the frames."""
    ear = codec()
    for frame in frames:
        decoded = ear.decode(frame)
        if decoded.message == "PumpCurrentCommand":
            assert decoded.fault is None
            values = {reading.name: reading.value for reading in decoded.readings}
            yield frame.timestamp, values["command_active"] == 1.0, values["pump_current_command_ma"]


def test_the_same_seed_gives_the_same_report_and_another_another(logged):
    result, _ = logged
    report = json.dumps(result.report(), sort_keys=True, allow_nan=False)
    assert json.dumps(drive(1).report(), sort_keys=True, allow_nan=False) == report
    assert json.dumps(drive(2, seconds=5.0).report(), sort_keys=True) != json.dumps(drive(1, seconds=5.0).report())


def test_the_report_tells_the_drive(logged):
    report = logged[0].report()
    assert (report["seed"], report["seconds"], report["interrupted"]) == (1, SECONDS, False)
    assert [row["state"] for row in report["states"]] == ["off", "standby", "engaging", "engaged"]
    assert report["frame_faults"] == {}
    assert (report["exit_reason"], report["last_exit"]) == ("released", "")
    assert sum(report["gate_share"].values()) == pytest.approx(1.0)
    assert set(report["parameters"]) == set(report["factory_parameters"]) == set(report["standard_errors"])
    assert report["engaged_s"] == pytest.approx(SECONDS - report["states"][-1]["time_s"], abs=0.11)
    assert {"learned", "factory", "persistence"} <= set(report["error_ahead_mps"])


def test_the_log_holds_the_whole_bus_and_ends_in_neutral(logged):
    result, log = logged
    frames: list[Frame] = list(read_log(log))
    ear, names = codec(), set()
    for frame in frames:
        names.add(ear.decode(frame).message)
    assert {"DriveFeedback", "EEC1", "CCVS", "PumpCurrentCommand", "MachineSelectedSpeed", "VF"} <= names
    heard = list(commands(frames))
    assert len(heard) == round(SECONDS / result.node.period_s) + 1
    assert any(active for _, active, _ in heard)
    assert heard[-1][1:] == (False, 0.0)


def test_ctrl_c_ends_the_drive_with_neutral_and_says_so(tmp_path):
    def interrupt(now_s: float, result: Result) -> None:
        if result.node.engagement.state == "engaged" and now_s > 21.0:
            raise KeyboardInterrupt

    log = tmp_path / "interrupted.log"
    result = drive(1, seconds=100.0, log=log, show=interrupt)
    assert result.interrupted
    assert result.seconds == pytest.approx(21.05)
    heard = list(commands(read_log(log)))
    assert heard[-2][1]
    assert heard[-2][2] > 300.0
    assert heard[-1][1:] == (False, 0.0)
    report = result.report()
    assert report["interrupted"]
    assert report["seconds"] == pytest.approx(21.05)
    assert result.node.engagement.state != "engaged"


def test_the_trace_has_a_row_a_frame_and_named_columns(logged):
    result, _ = logged
    columns = result.trace.columns()
    assert {len(column) for column in columns.values()} == {round(SECONDS / 0.05)}
    np.testing.assert_allclose(np.diff(columns["time_s"]), 0.05)
    engaged = columns["engaged"] > 0.5
    assert engaged.any()
    assert np.isfinite(columns["setpoint_mps"][engaged]).all()
    assert np.isnan(columns["setpoint_mps"][~engaged]).all()
    assert (columns["command_ma"][~engaged] == 0.0).all()
    assert (columns["command_ma"][engaged] > 300.0).all()
    assert 0.9 < columns["true_speed_mps"][engaged].mean() < 2.0
    change_mps = np.trapezoid(columns["true_accel_mps2"], dx=0.05)
    assert change_mps == pytest.approx(columns["true_speed_mps"][-1], abs=0.1)


def test_an_empty_trace_has_its_columns_too():
    columns = Trace().columns()
    assert "command_ma" in columns
    assert all(column.shape == (0,) for column in columns.values())


def test_settings_name_files_beside_them_from_anywhere(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "cruise.yaml").write_text("model: sub/factory.yaml\ndatabase: /abs/cruise.dbc\n")
    monkeypatch.chdir(tmp_path / "sub")
    read = service_settings.load("../cruise.yaml")
    assert Path(read.model).resolve() == tmp_path / "sub" / "factory.yaml"
    assert Path(read.database) == Path("/abs/cruise.dbc")
    assert Path(cruise_settings().model).is_file()


def test_a_misspelt_setting_is_shown_with_file_line_and_the_right_name(tmp_path):
    path = tmp_path / "cruise.yaml"
    path.write_text("model: m.yaml\ndatabase: c.dbc\ncontrol:\n  limits:\n    curent_max_ma: 1000.0\n")
    with pytest.raises(SettingsError, match=r"cruise.yaml:5: control.limits.curent_max_ma: .*current_max_ma"):
        service_settings.load(path)


def test_nothing_in_a_report_is_not_a_number():
    assert demo._plain({"a": [math.nan, np.float64(2.0), (math.inf,)]}) == {"a": [None, 2.0, [None]]}
