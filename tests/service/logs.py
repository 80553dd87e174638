"""One known drive, as frames, as a log of any format and as a table."""

import contextlib
import importlib
import sqlite3
import sys
from collections.abc import Iterable
from pathlib import Path

import can
import can.io.mf4
import numpy as np
import pandas as pd
import pytest

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import LogWriter
from cruise.can.settings import CanSettings
from cruise.service.recordings import ReadingSettings
from cruise.signals import INPUT, OUTPUT

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"
BY_DBC = ReadingSettings(database=str(DBC))
START_S = 1_700_000_000.0
STEP_S = 0.05


def current_ma(time_s):
    return 700.0 + 100.0 * np.floor(time_s)  # steps, as a held signal has them


def speed_mps(time_s):
    return 1.0 + 0.4 * time_s


def drive(seconds: float = 4.0, without: Iterable[str | None] = ()) -> list[Frame]:
    """The frames of a drive whose speed rises by 0.4 m/s each second and whose current by 100 mA, in steps."""
    codec = Codec.load(DBC, CanSettings())
    frames = []
    for k in range(round(seconds / STEP_S) + 1):
        t = k * STEP_S
        values = {OUTPUT: float(speed_mps(t)), INPUT: float(current_ma(t))}
        frames.append(codec.encode("DriveFeedback", values, START_S + t))
        if k % 2 == 0:
            frames.append(codec.encode("ETC2", {"gear": 2.0}, START_S + t))
            frames.append(codec.encode("GBSD", {OUTPUT: float(speed_mps(t)) + 0.5}, START_S + t))
        pitched = (t, t + 0.01, t + 0.02, t + 0.03, t + 0.04)
        frames += [codec.encode("SSI2", {"pitch_deg": at_s}, START_S + at_s) for at_s in pitched]
    return [frame for frame in frames if codec.decode(frame).message not in set(without)]


def logged(path: Path, frames: Iterable[Frame]) -> Path:
    if path.suffix == ".db":
        return stored(path, frames)
    if path.suffix == ".log":  # python-can's writer lifts times that run back
        with LogWriter.create(path) as writer:
            for frame in frames:
                writer.write(frame)
        return path
    importlib.reload(can.io.mf4)  # cruise.can has hidden asammdf from it
    with can.Logger(path) as logger:
        for frame in frames:
            logger(frame)
    with pytest.MonkeyPatch.context() as patch:  # hidden again: who reads the log finds it by himself
        patch.setitem(sys.modules, "asammdf", None)
        importlib.reload(can.io.mf4)
    return path


def stored(path: Path, frames: Iterable[Frame]) -> Path:
    """The table that python-can's SqliteWriter makes; its thread drops what is left when it is stopped."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute(
            "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, remote INTEGER, error INTEGER, "
            "dlc INTEGER, data BLOB)"
        )
        rows = [
            (one.timestamp, one.arbitration_id, one.is_extended_id, False, False, one.dlc, bytes(one.data))
            for one in frames
        ]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
    return path


def table() -> pd.DataFrame:
    time_s = STEP_S * np.arange(81)
    return pd.DataFrame({"time_s": time_s, INPUT: current_ma(time_s), OUTPUT: speed_mps(time_s), "gear": 2})


def assert_is_the_drive(read, atol: float) -> None:
    time_s = read.time_s - read.time_s[0]  # .asc and .trc count from their beginning
    assert read.dt_s == pytest.approx(STEP_S)
    assert len(read) == 81
    np.testing.assert_allclose(read.output, speed_mps(time_s), atol=atol)
    steady = np.abs(time_s - np.rint(time_s)) > 0.01  # a stamp that is rounded puts a step one sample late
    np.testing.assert_allclose(read.input[steady], current_ma(time_s)[steady], atol=0.03)
