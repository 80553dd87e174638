"""How large an effect has to be: its physical size for which a model without it errs so many times as one with it.

    ratio  r = sqrt(L_without / L_with),   L mean squared held-out error in m2/s2, at least 3 s ahead

An effect of the table is judged by the model that holds its structure, another by the twin, the same drive without the
effect. Where the true structure leaves far more than the twin does, it is not true there, and the size is none. As
r^2 - 1 grows about with a power of the size, the search runs straight in the logarithms of both.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import msgspec

from cruise.identification.regressors import FitError
from cruise.identification.structures import parse
from cruise.recording import Recording
from cruise.validation import study as studies
from cruise.validation.candidates import candidates
from cruise.validation.judged import Judged
from cruise.validation.study import Study

from .draw import draw
from .effects import EFFECTS, UNLISTED, ranges
from .simulate import Columns, simulate
from .trial import PERIOD_S, Tier

MODEL: Final = "arx:na=1,nb=3,delay_s=0.5"  # that lacks the effect: low order, dead time up to its middle tap
MODEL_PERIOD_S: Final = 0.2  # s, what the program takes unless told otherwise
RATIOS: Final[Mapping[str, float]] = {
    "small": 1.3,
    "medium": 2.0,
    "large": 4.0,
}  # base error over that of the true structure
TOLERANCE: Final = 0.12  # relative, of the ratio
MOST_STEPS: Final = 4  # simulations for one size
LEAST_GROWTH: Final = 0.01  # of r^2 - 1: what is below is no effect but the noise of the judgement
POWER: Final = 2.0  # of the size in r^2 - 1, while there is one point only
POWERS: Final = (0.5, 12.0)  # between a stop that is hit ever more rarely and one that is hit at once
WIDEST: Final = 5.0  # factor between two sizes that are tried
FARTHEST: Final = 30.0  # factor beyond the ranges of the table
MOST_LEFT: Final = 4.0  # times the twin's error that the true structure may leave: with more it is not the true one


class Point(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag=True):
    """A size that was tried and what came of it."""

    tier: Tier
    effect: str
    seed: int
    size: float  # unit of the effect's row
    ratio: float
    left: float = 1.0  # error of the model with the true structure over that of the twin


class Miss(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag=True):
    """A drive on which an effect doesn't become small, medium or large."""

    tier: Tier
    effect: str
    seed: int
    size: str
    why: str


@dataclass(frozen=True)
class Sized:
    """The physical size, or why there is none; `tried` are the new points."""

    size: float
    tried: tuple[Point, ...]
    miss: Miss | None = None


def recording(columns: Columns) -> Recording:
    """What the program sees of a trial: the columns, nothing else."""
    shown = {name: values for name, values in columns.items() if name != "time_s"}
    return Recording(columns["time_s"], shown, PERIOD_S, "blind trial")


def begun(*drives: Columns) -> Study:
    """The model without any effect, fitted to one or more drives."""
    return studies.study([recording(columns) for columns in drives], parse(MODEL), None, MODEL_PERIOD_S)


def with_truth(study: Study, effects: Sequence[str]) -> Judged:
    """The model with the structure that is true, its parameters fitted to the recording."""
    now = study.base
    for name in effects:
        possible, refused = candidates(study.recordings, now.explanation)
        true = next((one for one in possible if one.name == name), None)
        if true is None:
            raise FitError("; ".join(f"{one.effect}: {one.reason}" for one in refused if one.effect == name))
        now = study.search.judged(name, study.search.grown(now.explanation, true))
    return now


def rms_mps(judged: Judged) -> float:
    """Held-out error in m/s, at least 3 s ahead."""
    return math.sqrt(judged.loss)


def sized(tier: Tier, effect: str, size: str, seed: int, known: Iterable[Point | Miss] = ()) -> Sized:
    """The size of an effect that is alone on the drive of a seed; `known` is what was found before."""
    target, trial = RATIOS[size], draw(tier, effect, size, seed)
    (first,) = (one.size for one in (*trial.effects, *trial.unlisted))
    low, high = _limits(effect, tier)
    here = [one for one in known if (one.tier, one.effect, one.seed) == (tier, effect, seed)]
    for one in here:
        if isinstance(one, Miss) and one.size == size:
            return Sized(math.nan, (), one)
    points = [one for one in here if isinstance(one, Point)]
    tried: list[Point] = []
    twin_mps: float | None = None
    while True:
        best = min(points, key=lambda one: abs(math.log(one.ratio / target)), default=None)
        if best is not None and abs(best.ratio / target - 1.0) <= TOLERANCE and best.left <= MOST_LEFT:
            return Sized(best.size, tuple(tried))
        wanted = min(max(next_size(points, target, first), low), high)
        if len(tried) == MOST_STEPS or any(one.size == wanted for one in points):
            break
        study = begun(simulate(trial.resized(effect, wanted)))
        twin_mps = twin_mps or rms_mps(begun(simulate(trial.without(effect))).base)
        true_mps = twin_mps if effect in UNLISTED else rms_mps(with_truth(study, [effect]))
        ratio, left = rms_mps(study.base) / true_mps, true_mps / twin_mps
        tried.append(Point(tier=tier, effect=effect, seed=seed, size=wanted, ratio=ratio, left=left))
        points.append(tried[-1])
    points.sort(key=lambda one: one.size)
    why = f"{target:g} times is not reached: " + ", ".join(f"{one.ratio:.2f} at {one.size:.3g}" for one in points)
    return Sized(math.nan, tuple(tried), Miss(tier=tier, effect=effect, seed=seed, size=size, why=why))


def next_size(points: Sequence[Point], target: float, first: float) -> float:
    """The size at which the ratio should be `target`: on the line through the two points next to it."""
    if not points:
        return first
    wanted = math.log(target**2 - 1.0)
    line = sorted((math.log(one.size), math.log(max(one.ratio**2 - 1.0, LEAST_GROWTH))) for one in points)
    for (x, y), (x_next, y_next) in pairwise(line):
        if y < wanted <= y_next:
            return math.exp(x + (x_next - x) * (wanted - y) / (y_next - y))
    # All lie on one side: go on from the end that is nearer, by the slope that is seen there.
    end, beside = (line[-1], line[-2:-1]) if line[-1][1] < wanted else (line[0], line[1:2])
    power = POWER
    if beside:
        power = min(max((end[1] - beside[0][1]) / (end[0] - beside[0][0]), POWERS[0]), POWERS[1])
    step = (wanted - end[1]) / power
    return math.exp(end[0] + min(max(step, -math.log(WIDEST)), math.log(WIDEST)))


def _limits(effect: str, tier: Tier) -> tuple[float, float]:
    row = (EFFECTS | UNLISTED)[effect]
    return ranges(row, "small", tier)[0] / FARTHEST, ranges(row, "large", tier)[1] * FARTHEST
