"""What the command line's functions found, as the page shows it: plain figures, words and curves, no objects that fit.

They cross from the process that computes to the one that serves the page, and they are all that it keeps.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from cruise.model.files import ModelFile
from cruise.recording import Recording
from cruise.service.recordings import ReadingSettings
from cruise.validation.ladder import Parameter
from cruise.validation.worst_stretches import Stretch


class Show(Protocol):
    """Says what is being done."""

    def __call__(self, text: str, part: object = None, /) -> None:
        """`part`: what is there already, for those who don't want to wait for the rest."""
        ...


@dataclass(frozen=True)
class Source:
    """The files of a recording and how they are read."""

    paths: tuple[Path, ...]
    reading: ReadingSettings
    title: str


@dataclass(frozen=True)
class Asked:
    """Files of which somebody has to say what their columns mean."""

    paths: tuple[Path, ...]
    reading: ReadingSettings  # what is said already
    names: tuple[str, ...]  # of the columns of the first file


@dataclass(frozen=True, eq=False)
class Opened:
    """Recordings as they were measured."""

    source: Source
    recordings: tuple[Recording, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Question:
    """Which model is judged, and how: what the options of the command line say."""

    model: str  # name, structure written out, or model file
    horizon_s: float = 3.0


@dataclass(frozen=True)
class Figures:
    """One row of the table of errors; NaN where there is none."""

    name: str
    explained_pct: float
    nrmse_pct: float
    rmse_mps: float
    mean_error_mps: float
    words: str  # what it is, for whoever asks


@dataclass(frozen=True, eq=False)
class Cells:
    """The heat map and, sample by sample of each recording, the cell that it is in (-1: none)."""

    rows: tuple[str, str]  # what is sorted by, and its unit
    row_labels: tuple[str, ...]
    columns: tuple[str, str]
    column_labels: tuple[str, ...]
    time_share: np.ndarray
    error_share: np.ndarray
    rmse_mps: np.ndarray
    number: tuple[np.ndarray, ...]

    def words(self, row: int, column: int) -> str:
        """A cell as it is spoken of."""
        return ", ".join((_range(self.columns, self.column_labels[column]), _range(self.rows, self.row_labels[row])))


def _range(quantity: tuple[str, str], label: str) -> str:
    """A bin of a quantity with its unit; a state is its own word."""
    words, unit = quantity
    binned = unit or label.lstrip("<>- ")[:1].isdigit()
    return f"{words} {label} {unit}".rstrip() if binned else label


@dataclass(frozen=True, eq=False)
class Regime:
    """Where the error stands, in words."""

    sentence: str
    time_share: float
    error_share: float
    named: bool


@dataclass(frozen=True, eq=False)
class Predicted:
    """Speeds in m/s per recording at the model's period; NaN where there is none."""

    recordings: tuple[Recording, ...]
    horizon_s: float  # in whole periods, as it was judged
    ahead_mps: tuple[np.ndarray, ...]
    free_run_mps: tuple[np.ndarray, ...]

    @property
    def errors_mps(self) -> tuple[np.ndarray, ...]:
        """Measured minus predicted."""
        return tuple(one.output - speed for one, speed in zip(self.recordings, self.ahead_mps, strict=True))


@dataclass(frozen=True, eq=False)
class Compared:
    """What `cruise compare` says of a model."""

    how: str
    not_held_out: str  # a sentence, where the model was fitted to what it is judged on; or empty
    predicted: Predicted
    figures: tuple[Figures, ...]  # ahead, free run, persistence, floor at most, floor at least
    floor_mps: tuple[float, float]  # at least, at most; NaN where not known
    floor_words: tuple[str, ...]
    regimes: tuple[Regime, ...]
    leaves: tuple[str, ...]
    stretches: tuple[Stretch, ...]
    cells: Cells | None
    picture: bytes  # PNG

    @property
    def error_mps(self) -> float:
        """RMS error ahead."""
        return self.figures[0].rmse_mps


@dataclass(frozen=True, eq=False)
class Signature:
    """What the model leaves over what the effect changes: medians and 10 to 90 % of bins, before and after."""

    before: tuple[np.ndarray, ...]  # x, 10 %, 50 %, 90 %
    after: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Curve:
    """What an effect does as fitted."""

    x: np.ndarray
    y: np.ndarray
    bands: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]  # x, low, high of twice the standard error
    limits: tuple[float, float]  # of the axis of y
    without: np.ndarray
    x_words: str
    y_words: str
    driven: tuple[np.ndarray, np.ndarray] | None  # middles and counts of how often each x was driven


@dataclass(frozen=True)
class Number:
    """A fitted number of an effect."""

    name: str
    value: str
    std: str
    unit: str
    span: str
    remark: str


@dataclass(frozen=True, eq=False)
class Card:
    """One candidate with its evidence."""

    effect: str
    headline: str
    physics: str
    equation: str
    confidence_words: str
    error_before_mps: float
    error_after_mps: float
    gain: float  # share of the squared error
    sureness: float  # standard errors
    counts: float  # share of the evidence that counts: less for what answers to the drive itself
    step: int  # of the search, in which both errors and the signature are; 0: alone beside the model
    chosen: bool
    worth_adding: bool  # with it the model errs less: all that was named, but a dead time that changes
    listed: bool  # an effect of the table, which can be added
    numbers: tuple[Number, ...]
    look_alikes: tuple[str, ...]
    experiment: str
    signature: Signature
    curve: Curve | None


@dataclass(frozen=True, eq=False)
class Minute:
    """The minute that tells most: measured speed, and errors of the model as it is and with what was found."""

    time_s: np.ndarray
    measured_mps: np.ndarray
    before_mps: np.ndarray
    after_mps: np.ndarray
    label: str


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """What `cruise diagnose` says of a model."""

    horizon_s: float  # in whole periods, as it was judged
    verdict: str
    explained: bool  # whether a model comes with it that errs less
    effects: tuple[str, ...]
    signals: tuple[str, ...]
    sentence: str
    next_experiment: tuple[str, ...]
    hints: tuple[str, ...]  # columns that may be a signal which an effect lacked
    discounted: str  # why not all that a candidate explains counts
    core: tuple[str, ...]  # what the core holds that is no effect, and what to do where the drive is very late
    hidden_mps: float  # what an effect could move the speed by without being named
    cards: tuple[Card, ...]
    others: tuple[tuple[str, float, float], ...]  # further effects with the error that each leaves, and its gain
    refused: tuple[tuple[str, str], ...]
    error_before_mps: float
    error_after_mps: float
    floor_mps: tuple[float, float]
    minute: Minute
    picture: bytes


@dataclass(frozen=True, eq=False)
class Added:
    """What `cruise add` made of a model."""

    effect: str
    file: ModelFile
    path: Path
    error_before_mps: float
    error_after_mps: float
    floor_mps: tuple[float, float]
    parameters: tuple[Parameter, ...]
    by_hand: bool  # set, not fitted: both errors are of `cruise compare`, on all data
    compared: Compared  # the better model, as `cruise compare` judges its file
    doubts: tuple[str, ...] = ()  # what speaks against keeping it
