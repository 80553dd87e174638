"""How fast fits and predictions are, beside a bare numpy and the peers, and the models of the paper on measured drives.

One recording of 60,000 samples for all fits: A y = B u + c_0 + C e, na = nb = 2, a delay of two samples. Calls take
turns, so that all meet the same machine; a ratio is one of medians. The drives are those of a small car (DART): every
other file is fitted to, the rest is judged 3 s ahead, at the settings of the service for it, with the paper's filter.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

from cruise import settings
from cruise.columns import RecordingSettings
from cruise.csv_file import read_csv
from cruise.identification.accuracy import Accuracy, accuracy, persistence
from cruise.identification.armax import fit_armax
from cruise.identification.arx import fit_arx
from cruise.identification.identify import fit_family, with_shapes
from cruise.identification.output_error import fit_output_error
from cruise.identification.preparation import PreparationSettings, at_period, smoother
from cruise.identification.structures import PRESETS, Structure
from cruise.model import files
from cruise.model.model import Model
from cruise.model.prediction import ahead
from cruise.recording import Recording

from .dart import DATA
from .figures import Figure, Part
from .peers import DELAY, NA, NB, Peers
from .recordings import CONFIG
from .recovery import PERIOD_S, currents, filtered, recording

SAMPLES, PART = 60_000, 20_000
TURNS, FEW_TURNS = 15, 3  # of what takes milliseconds, of what takes seconds
HORIZON_S, STEPS = 3.0, 60
SLOWER_AT_MOST, AHEAD_MS_AT_MOST, FASTER_AT_LEAST = 2.0, 10.0, 5.0  # issue 3
SAME_ERROR = 1.0001  # errors that differ less are the same: both stop when little is left to gain
SEED = 0


def measure(peers: bool = True) -> Part:
    """Times, then the table of models; `peers`: whether SysIdentPy and SIPPY are to be had, installed if need be."""
    one = system()
    notes = []
    figures = [*_least_squares(one), _sliding(one)]
    running = Peers.start(one.input, one.output) if peers else "SysIdentPy and SIPPY were left out"
    if isinstance(running, str):
        notes.append(running)
        figures += _searches(one)
    else:
        with running:
            figures += [*_searches(one), *_beside(one, running)]
    table, words = dart()
    return Part((*figures, *table), (SEED,), (*notes, *words))


def system() -> Recording:
    """60,000 samples of a known ARMAX system."""
    rng = np.random.default_rng(SEED)
    current = currents(rng, SAMPLES)
    poles = [1.0, -1.2, 0.35]
    noise = filtered([1.0, 0.6], poles, 0.03 * rng.standard_normal(SAMPLES))
    return recording(current, filtered([*(0.0,) * DELAY, 3e-4, 2e-4], poles, current) + noise)


def structure(na: int = NA, nb: int = NB) -> Model:
    """The structure that is fitted, without parameters."""
    return Model(PERIOD_S, na, nb, DELAY, (), (0.0,) * (na + nb + 1))


def bare(one: Recording) -> np.ndarray:
    """Nothing but a matrix and numpy's least squares: a, b, c_0."""
    first, count = max(NA, DELAY + NB - 1), len(one)
    lags = [one.output[first - i : count - i] for i in range(1, NA + 1)]
    lags += [one.input[first - j : count - j] for j in range(DELAY, DELAY + NB)]
    return np.linalg.lstsq(np.column_stack([*lags, np.ones(count - first)]), one.output[first:])[0]


def medians_s(calls: Sequence[Callable[[], float | None]], turns: int) -> list[float]:
    """The median time of each call, in s; in turns. A call that returns a number was timed elsewhere."""
    taken: list[list[float]] = [[] for _ in calls]
    for _ in range(turns):
        for call, mine in zip(calls, taken, strict=True):
            begin_s = perf_counter()
            told_s = call()
            mine.append(perf_counter() - begin_s if told_s is None else told_s)
    return [float(np.median(mine)) for mine in taken]


def innovation_mps(one: Recording, theta: Sequence[float]) -> float:
    """RMS in m/s of the innovations that theta (a, b, c_0, c) leaves, the first 100 left out."""
    a, b, c_0, c = theta[:NA], theta[NA : NA + NB], theta[NA + NB], theta[NA + NB + 1 :]
    equation_error = filtered([1.0, *(-value for value in a)], [1.0], one.output) - c_0
    equation_error -= filtered([*(0.0,) * DELAY, *b], [1.0], one.input)
    innovation = filtered([1.0], [1.0, *c], equation_error)[100:]
    return float(np.sqrt(np.mean(innovation**2)))


def _run(call: Callable[[], object]) -> Callable[[], None]:
    """A call whose result is of no interest, to be timed here."""

    def run() -> None:
        call()

    return run


def _least_squares(one: Recording) -> list[Figure]:
    bare_s, arx_s = medians_s([_run(lambda: bare(one)), _run(lambda: fit_arx(structure(), [one]))], TURNS)
    return [
        Figure("arx_over_numpy", arx_s / bare_s, "1", "ARX with standard errors, over bare numpy", SLOWER_AT_MOST),
        Figure("numpy_ms", 1e3 * bare_s, "ms", "bare numpy least squares, 60,000 samples"),
        Figure("arx_ms", 1e3 * arx_s, "ms", "ARX with standard errors"),
    ]


def _sliding(one: Recording) -> Figure:
    part, model = one[:PART], structure(1, 3).with_theta((0.9, 1e-4, 1e-4, 1e-4, 0.0))
    (ahead_s,) = medians_s([_run(lambda: ahead(model, part.input, part.output, {}, STEPS))], TURNS)
    return Figure("ahead_ms", 1e3 * ahead_s, "ms", "60 steps ahead from 20,000 samples, na = 1", AHEAD_MS_AT_MOST)


def _searches(one: Recording) -> list[Figure]:
    calls = [_run(lambda: fit_armax(structure(), 1, [one])), _run(lambda: fit_output_error(structure(), [one]))]
    armax_s, oe_s = medians_s(calls, FEW_TURNS)
    return [
        Figure("armax_ms", 1e3 * armax_s, "ms", "ARMAX, 60,000 samples"),
        Figure("output_error_ms", 1e3 * oe_s, "ms", "output error, 60,000 samples"),
    ]


def _beside(one: Recording, peers: Peers) -> list[Figure]:
    """The peers in turns with this project."""
    for name in ("sysidentpy_arx", "sippy_arx"):
        if not np.allclose(peers.fit(name).theta[:-1], bare(one)[:-1], rtol=1e-3):  # means for c_0 are not quite c_0
            raise RuntimeError(f"{name} solves another problem")
    plain_s, sysidentpy_s, sippy_s = medians_s(
        [
            _run(lambda: bare(one)),
            *(lambda name=name: peers.fit(name).seconds for name in ("sysidentpy_arx", "sippy_arx")),
        ],
        FEW_TURNS,
    )
    theirs = peers.fit("sippy_armax")
    armax_s, sippy_armax_s = medians_s(
        [_run(lambda: fit_armax(structure(), 1, [one])), lambda: peers.fit("sippy_armax").seconds], FEW_TURNS
    )
    error = innovation_mps(one, fit_armax(structure(), 1, [one]).theta) / innovation_mps(one, theirs.theta)
    return [
        Figure("sysidentpy_over_numpy", sysidentpy_s / plain_s, "1", "SysIdentPy's ARX (FROLS) over bare numpy"),
        Figure("sippy_over_numpy", sippy_s / plain_s, "1", "SIPPY's ARX over bare numpy"),
        Figure(
            "armax_faster_than_sippy",
            sippy_armax_s / armax_s,
            "1",
            "SIPPY's ARMAX over ours, time",
            at_least=FASTER_AT_LEAST,
        ),
        Figure("armax_error_over_sippy", error, "1", "our ARMAX error over SIPPY's", SAME_ERROR),
    ]


def dart(names: Sequence[str] = tuple(PRESETS)) -> tuple[list[Figure], list[str]]:
    """3 s ahead error and explained variance of the paper's models on files that were not fitted to."""
    data = os.environ.get(DATA)
    if not data:
        return [], [f"{DATA} is not set: no table of models, the measured drives are not here"]
    paths = sorted((Path(data) / "dart").glob("*/*.csv"))
    columns = settings.load(CONFIG / "dart_columns.yaml", RecordingSettings)
    preparation = PreparationSettings(period_s=files.load(CONFIG / "dart_model.yaml").period_s)
    taught, unseen = (
        at_period([read_csv(path, columns) for path in some], preparation.period_s)
        for some in (paths[::2], paths[1::2])
    )
    speeds_mps = [one.output for one in unseen]
    table = {"persistence": persistence(speeds_mps, speeds_mps, round(HORIZON_S / preparation.period_s))}
    for name in names:
        table[name] = judged(PRESETS[name], taught, unseen, preparation)
    figures = []
    for name, found in table.items():
        figures += [
            Figure(f"dart_{name}_mps", found.rmse_mps, "m/s", f"DART, {name}: 3 s ahead"),
            Figure(f"dart_{name}_explained_pct", found.explained_pct, "%", f"DART, {name}: explained"),
        ]
    samples = table["persistence"].samples
    words = (
        f"DART: {len(taught)} files fitted to, {len(unseen)} judged, {samples} predictions; - is an unstable predictor"
    )
    return figures, [words]


def judged(
    wanted: Structure, taught: Sequence[Recording], unseen: Sequence[Recording], preparation: PreparationSettings
) -> Accuracy:
    """One model on unseen recordings; NaN where its predictor is unstable."""
    smooth = smoother(preparation, preparation.period_s)
    shaped = with_shapes(wanted.model(preparation.period_s), taught, smooth)
    fitted = fit_family(wanted, shaped, taught, smooth)
    if fitted.unstable:
        return accuracy([], [])
    horizon = round(HORIZON_S / preparation.period_s)
    return accuracy([one.output for one in unseen], [fitted.ahead(one, horizon, smooth) for one in unseen])
