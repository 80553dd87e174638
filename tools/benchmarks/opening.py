"""How long an hour's recording takes to open: tables of 72,000 rows, and a log of a million frames.

The log holds what a machine sends (speed and current at 50 Hz, slope at 100 Hz, the rest slower) and a tenth of frames
that nobody describes.
"""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import can
import numpy as np
import pyarrow as pa
from asammdf import MDF, Signal
from pyarrow import parquet

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from cruise.csv_file import write_csv
from cruise.recording import Recording
from cruise.service.combine_node import MESSAGES
from cruise.service.recordings import ReadingSettings, read_recording
from cruise.signals import CONTEXT, INPUT, OUTPUT, SIGNALS

from .figures import Figure, Part
from .recordings import CONFIG

ROWS, PERIOD_S = 72_000, 0.05  # an hour at 20 Hz
FRAMES, TICK_S, FAST_EVERY, FOREIGN_EVERY = 1_000_000, 0.01, 2, 4
START_S = 1.7e9  # s since 1970: stamps as a logger has them
SEED = 0


def measure() -> Part:
    """The time of opening each, once: files are read once, too."""
    settings = ReadingSettings(database=str(CONFIG / "cruise.dbc"))
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        for key, write, meaning in (
            ("csv_s", _csv, f".csv, {ROWS} rows"),
            ("parquet_s", _parquet, f".parquet, {ROWS} rows"),
            ("mf4_s", _mf4, f".mf4, {ROWS} readings of each channel"),
            ("blf_s", _blf, f".blf, {FRAMES} frames through the DBC file"),
        ):
            path = write(Path(folder))
            begin_s = perf_counter()
            read = read_recording(path, settings)
            took_s = perf_counter() - begin_s
            meaning = f"opening {meaning}, {len(read.columns)} columns, {len(read)} samples of {read.dt_s:g} s"
            figures.append(Figure(key, took_s, "s", meaning))
    return Part(tuple(figures), (SEED,))


def hour() -> Recording:
    """Nine signals that move."""
    rng, time_s = np.random.default_rng(SEED), PERIOD_S * np.arange(ROWS)
    columns = {name: SIGNALS[name].high * rng.uniform(0.4, 0.6, ROWS) for name in (INPUT, OUTPUT, *CONTEXT[1:])}
    return Recording(time_s, columns, PERIOD_S, "made up")


def _csv(folder: Path) -> Path:
    write_csv(hour(), folder / "hour.csv")
    return folder / "hour.csv"


def _parquet(folder: Path) -> Path:
    made = hour()
    parquet.write_table(pa.table({"time_s": made.time_s, **made.columns}), folder / "hour.parquet")
    return folder / "hour.parquet"


def _mf4(folder: Path) -> Path:
    made = hour()
    with MDF() as file:
        for name, values in made.columns.items():
            file.append([Signal(values, made.time_s, name=name)])
        file.save(folder / "hour.mf4")
    return folder / "hour.mf4"


def _blf(folder: Path) -> Path:
    codec = Codec.load(CONFIG / "cruise.dbc", CanSettings())
    encode: Callable[..., Frame] = codec.encode
    with can.Logger(folder / "hour.blf") as logger:
        written = tick = 0
        while written < FRAMES:
            t = tick * TICK_S
            frames = [
                encode(one.message, {name: 0.5 * SIGNALS[name].high for name, _ in one.signals}, START_S + t)
                for one in MESSAGES
                if tick % round(one.period_s / TICK_S) == 0
            ]
            if tick % FAST_EVERY == 0:
                values = {INPUT: 700.0 + 100.0 * math.sin(t / 3.0), OUTPUT: 2.0 + math.sin(t / 5.0)}
                frames.append(encode("DriveFeedback", values, START_S + t))
            if tick % FOREIGN_EVERY == 0:
                frames.append(Frame(arbitration_id=0x18FEEE00, data=bytes(8), timestamp=START_S + t))
            for frame in frames:
                logger(frame)
            written += len(frames)
            tick += 1
    return folder / "hour.blf"
