"""The catch-all: how much of an error the recorded signals and the current's history foretell, whatever the law.

    e = error - J d - sum_j b_j z_j,   |d| <= 1,   0 <= b_j <= 1/2        what a little of every known effect leaves
    share  R^2 = 1 - sum_k (e_k - p_k)^2 / min(sum_k e_k^2, sum_k (e_k - w_k)^2)

J derivatives of the error by the model's own parameters in units of a typical change, z_j what effect j takes away
where it is fitted alone: every machine may have half of each of them. p_k and w_k come from gradient boosted trees that
have not seen the block of time in which k lies. Those of p see the current as it is and was (bands of it, and plays,
which remember where it came from), the speed of the model, the clock, every signal that the drive itself doesn't move
and how fast it moves (oil that turns the wheels is missing while they turn): what answers to the drive would show them
the error. Those of w see the clock alone: soil wanders slowly, and oil that warms up or a bin that fills tells the time
as well as any clock. Noise, soil and wind that nobody recorded are not foretold by more than that; an effect that no
one has named is, a memory of the current's included.
Source: J. H. Friedman, Greedy function approximation: a gradient boosting machine, Annals of Statistics 29 (2001) 1189.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
from scipy import signal
from scipy.optimize import lsq_linear
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from cruise.effects.hysteresis import Hysteresis
from cruise.signals import INPUT, OUTPUT
from cruise.validation.fitting import Fit, bounded
from cruise.validation.side_by_side import side_by_side
from cruise.validation.simulation import Scene
from cruise.validation.slope import PITCH, SLOPE
from cruise.validation.unnamed import SPEED

BANDS_S: Final = (0.2, 0.5, 1.0, 2.0, 4.0)  # time constants between the bands into which the current is cut
RATE_S: Final = 0.5  # s over which it is seen how fast a signal moves
PLAYS: Final = (0.01, 0.04, 0.1)  # half widths, of the range of the current
ANSWERS: Final = frozenset({INPUT, OUTPUT, "wheel_speed_mps"})
"""Current and speed, which are seen otherwise, and what is nearly one of them."""
MOVED: Final = frozenset({"line_pressure_bar", "engine_load_pct"})
"""What the drive itself moves."""
FOLDS: Final = 5
LITTLE: Final = 0.5  # of what an effect takes away where it is fitted alone
ROUNDING: Final = 1e-9  # of the diagonal of the normal equations
CLOCK: Final = "time_s"
CHANCE: Final = 0.3  # R^2 that trees may reach on what nothing moves,
LEAST_TOLD: Final = 0.1  # or on white noise with a little of something else
LEAST_NAMED: Final = 0.2  # of the share, that is lost with a signal that is worth naming
TREES: Final = {
    "max_iter": 80,
    "learning_rate": 0.1,
    "max_leaf_nodes": 12,
    "min_samples_leaf": 25,
    "l2_regularization": 5.0,
    "random_state": 0,
    "early_stopping": False,
}


@dataclass(frozen=True)
class Foretold:
    """R^2, what is foretold in m2/s2, and the signals without which most of it is lost, the costliest first.

    `drift` in m2/s2 is what the clock alone foretells, which counts for none of it; `left` in m2/s2 is all that could
    be foretold beside that.
    """

    share: float
    loss: float
    signals: tuple[str, ...]
    drift: float = 0.0
    left: float = 0.0


def foretold(scene: Scene, present: Fit, others: Sequence[Fit], blocks: np.ndarray) -> Foretold:
    """How much of the error of a fit is foretold across `blocks` (N,) of time, a little of all `others` beside it."""
    error_mps = beside(present, others)
    seen = {CLOCK: [_clock(scene)], **_seen(scene, scene.speed_mps - bounded(present.error_mps), pace=True)}
    told, without = _across(seen, error_mps, blocks)
    drift, _ = _across({CLOCK: seen[CLOCK]}, error_mps, blocks, mixed=False)
    known = np.isfinite(error_mps)
    error = error_mps[known]
    whole = float(error @ error)
    left = max(min(float(np.sum((error - drift[known]) ** 2)), whole), 1e-12)

    def share(part: np.ndarray) -> float:
        return 1.0 - float(np.sum((error - part[known]) ** 2)) / left

    all_of_it = share(told)
    lost = {name: all_of_it - share(part) for name, part in without.items() if name != CLOCK}
    named = [name for name in sorted(lost, key=lambda name: -lost[name]) if lost[name] > LEAST_NAMED * all_of_it]
    count = max(len(error), 1)
    loss = max(all_of_it, 0.0) * left / count
    signals = tuple(named) if all_of_it > LEAST_TOLD else ()
    return Foretold(all_of_it, loss, signals, (whole - left) / count, left / count)


def share_told(scene: Scene, present: Fit, part_mps: np.ndarray, blocks: np.ndarray, by: str = "") -> float:
    """R^2 that is foretold of any part (N,) of the error of a fit, such as what one effect takes away, but its mean.

    By all that is recorded, or `by` one signal and the model's speed alone.
    """
    seen = _seen(scene, scene.speed_mps - bounded(present.error_mps), pace=False)
    seen = {name: seen[name] for name in (by, SPEED)} if by else seen
    whole, _ = _across(seen, part_mps, blocks, mixed=False)
    known = np.isfinite(part_mps)
    part = part_mps[known]
    return 1.0 - float(np.mean((part - whole[known]) ** 2)) / max(float(np.var(part)), 1e-12)


def _across(
    seen: Mapping[str, list[np.ndarray]], part_mps: np.ndarray, blocks: np.ndarray, mixed: bool = True
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What trees foretell (N,) of a part of the error across blocks of time; and as if a signal had been another's."""
    names = [name for name, columns in seen.items() for _ in columns]
    matrix = np.column_stack([column for columns in seen.values() for column in columns])
    known, held = np.isfinite(part_mps), blocks % FOLDS
    part = np.where(known, part_mps, 0.0)
    whole, without = np.zeros_like(part), {name: np.zeros_like(part) for name in seen}
    folds = [(known & (held != fold), known & (held == fold)) for fold in range(FOLDS)]
    folds = [(shown, unseen) for shown, unseen in folds if unseen.any() and shown.any()]
    others = [np.array([one == name for one in names]) for name in (seen if mixed else ())]
    told = side_by_side(partial(_told, matrix, part, others), folds)
    for (_, unseen), (mine, *mixed_up) in zip(folds, told, strict=True):
        whole[unseen] = mine
        for name, one in zip(seen, mixed_up, strict=False):
            without[name][unseen] = one
    return whole, without


@threadpool_limits.wrap(limits=1)  # two threads that wait for each other cost more than they bring
def _told(
    matrix: np.ndarray, part: np.ndarray, others: Sequence[np.ndarray], fold: tuple[np.ndarray, np.ndarray]
) -> list[np.ndarray]:
    """What trees that were shown some rows foretell of the unseen ones; and as if `others` were of another time."""
    shown, unseen = fold
    trees = HistGradientBoostingRegressor(**TREES).fit(matrix[shown], part[shown])
    rows = matrix[unseen]
    elsewhere = np.roll(rows, len(rows) // 2, axis=0)
    return [trees.predict(rows), *(trees.predict(np.where(mine, elsewhere, rows)) for mine in others)]


def beside(present: Fit, others: Sequence[Fit]) -> np.ndarray:
    """The error (N,) in m/s of a fit with a little of all others beside it, NaN where it is not judged."""
    error = present.error_mps
    known = np.isfinite(error)
    slopes = present.jacobian * present.layout.scale
    moved = [error - one.error_mps for one in others]
    columns = bounded(np.column_stack([slopes, *moved]))[known]
    own, count = slopes.shape[1], columns.shape[1]
    low, high = np.zeros(count), np.full(count, LITTLE)
    low[:own], high[:own] = -1.0, 1.0
    squares = columns.T @ columns
    root = np.linalg.cholesky(squares + ROUNDING * (np.trace(squares) / count + 1e-12) * np.eye(count))
    shares = lsq_linear(root.T, np.linalg.solve(root, columns.T @ bounded(error[known])), (low, high)).x
    result = np.full(len(error), np.nan)
    result[known] = bounded(error[known]) - columns @ shares
    return result


def _clock(scene: Scene) -> np.ndarray:
    """Time (N,) in s since the first recording began, one after the other."""
    return np.concatenate([scene.period_s * np.arange(part.start, part.stop) for part in scene.parts])


def _seen(scene: Scene, modelled_mps: np.ndarray, pace: bool) -> Mapping[str, list[np.ndarray]]:
    """Columns (N,) by the signal that they come from, with how fast it moves or without."""
    current = np.concatenate([_history(scene.current_ma[part], scene.period_s) for part in scene.parts], axis=1)
    # The pitch without acceleration, which the drive moves itself.
    shown = {PITCH: scene.signals[SLOPE]} if SLOPE in scene.signals else {}
    signals = {
        name: [column]
        for name, column in {**scene.signals, **shown}.items()
        if name not in ANSWERS | MOVED | {SLOPE} and np.nanstd(column) > 0.0
    }
    for columns in signals.values() if pace else ():
        columns.append(np.concatenate([_pace(columns[0][part], scene.period_s) for part in scene.parts]))
    return {INPUT: list(current), SPEED: [modelled_mps], **signals}


def _pace(values: np.ndarray, period_s: float) -> np.ndarray:
    """How fast a signal (N,) moves, either way, per s; over a hole as from one side to the other."""
    known = np.isfinite(values)
    if len(values) <= 1 or not known.any():
        return np.zeros(len(values))
    rate = np.abs(np.gradient(np.interp(np.arange(len(values)), np.flatnonzero(known), values[known]))) / period_s
    rest = math.exp(-period_s / RATE_S)
    return np.asarray(signal.lfilter([1.0 - rest], [1.0, -rest], rate))


def _history(current_ma: np.ndarray, period_s: float) -> np.ndarray:
    """The current (M, N) as it is and as it was."""
    known = np.isfinite(current_ma)
    if not known.any():
        return np.full((2 + len(BANDS_S) + len(PLAYS), len(current_ma)), np.nan)
    current = np.interp(np.arange(len(current_ma)), np.flatnonzero(known), current_ma[known])
    slower = [current]
    for span_s in BANDS_S:
        rest = math.exp(-period_s / span_s)
        slower.append(signal.lfilter([1.0 - rest], [1.0, -rest], current, zi=[rest * current[0]])[0])
    rows = [current, slower[-1], *(fast - slow for fast, slow in pairwise(slower))]
    low, high = np.percentile(current, [1, 99])
    plays = [Hysteresis(2.0 * share * (high - low)) for share in PLAYS]
    rows += [current - play.over(current, current, {}, period_s)[0] for play in plays]
    return np.array(rows)
