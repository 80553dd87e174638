"""Trials on disk: one CSV a recording, as a user would bring it, and the answers in a file of their own."""

from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from .simulate import Columns, simulate
from .trial import Trial

ANSWERS: Final = "answers.json"
DECIMALS: Final = {"time_s": 2, "ground_speed_mps": 4, "wheel_speed_mps": 4, "gear": 0, "tyre_pressure_bar": 3}
OTHER_DECIMALS: Final = 2


class Answer(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A recording's file name and what is in it."""

    recording: str
    trial: Trial


def write_csv(path: Path, columns: Columns) -> None:
    """Write a recording with one header line."""
    formats = [f"%.{DECIMALS.get(name, OTHER_DECIMALS)}f" for name in columns]
    np.savetxt(path, np.column_stack(list(columns.values())), formats, ",", header=",".join(columns), comments="")


def make(folder: Path, trials: list[Trial]) -> None:
    """Simulate the trials into numbered CSV files of a new or empty folder and seal their answers beside them.

    Raises FileExistsError for a folder that holds something.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise FileExistsError(f"{folder} holds files already; name another folder")
    answers = []
    for k, trial in enumerate(trials):
        name = f"{k:04d}.csv"
        write_csv(folder / name, simulate(trial))
        answers.append(Answer(recording=name, trial=trial))
    (folder / ANSWERS).write_bytes(msgspec.json.format(msgspec.json.encode(answers)) + b"\n")


def answers(folder: Path) -> list[Answer]:
    """Open the sealed answers of a folder; raises msgspec.ValidationError where they are not such."""
    return msgspec.json.decode((folder / ANSWERS).read_bytes(), type=list[Answer])
