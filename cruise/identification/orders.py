"""The search over orders and delay: held-out error against complexity.

Every (na, nb, delay) of a grid is fitted to the folds of the recordings and judged on the blocks that it had not seen,
`horizon_s` ahead. Best is not always wise: recommended is the structure with the fewest parameters whose squared error
is within one standard error of the best one's, both taken block by block. Source: L. Breiman et al., Classification and
Regression Trees (1984), section 3.4.3 (the one-standard-error rule); sections IV.B and IV.B.1 of Coen et al. 2005.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cruise.identification.accuracy import accuracy
from cruise.identification.arx import fit_arx
from cruise.identification.held_out import folds
from cruise.identification.regressors import FitError, Smooth
from cruise.model.model import Model
from cruise.recording import Recording


@dataclass(frozen=True, eq=False)
class Candidate:
    """One structure and how good it is on what it had not seen; NaN and a reason where it can't be judged."""

    na: int
    nb: int
    delay: int  # samples
    parameters: int
    explained_pct: float
    rmse_mps: float
    block_power_m2ps2: np.ndarray  # (folds,) mean squared error on each held-out block
    refused: str = ""  # why there are no figures


@dataclass(frozen=True)
class Search:
    """All candidates, best first; `front` are those that no simpler one beats, `recommended` one of them."""

    candidates: tuple[Candidate, ...]
    front: tuple[Candidate, ...]
    recommended: Candidate
    period_s: float
    horizon_s: float


def search(
    base: Model,
    recordings: Sequence[Recording],
    na: Iterable[int],
    nb: Iterable[int],
    delays: Iterable[int],
    horizon_s: float,
    smooth: Smooth | None = None,
    validation: Smooth | None = None,
    show: Callable[[int, int], None] | None = None,
) -> Search:
    """Judge every combination with the effects of `base`; `show` is told how many of how many are done.

    `recordings` are on the period of `base`. Raises FitError where no structure can be fitted at all.
    """
    grid = [(i, j, d) for i, j, d in product(na, nb, delays) if i + j > 0]
    parts = folds(recordings)
    found = []
    for done, (order_a, order_b, delay) in enumerate(grid):
        structure = _structure(base, order_a, order_b, delay)
        found.append(_judged(structure, parts, max(round(horizon_s / base.period_s), 1), smooth, validation))
        if show is not None:
            show(done + 1, len(grid))
    usable = [one for one in found if not one.refused]
    if not usable:
        raise FitError(f"none of {len(grid)} structures can be fitted; the first one: {found[0].refused}")
    best = min(usable, key=lambda one: one.rmse_mps)
    candidates = sorted(found, key=lambda one: (bool(one.refused), one.rmse_mps))
    return Search(tuple(candidates), _front(usable), _wise(usable, best), base.period_s, horizon_s)


def _structure(base: Model, na: int, nb: int, delay: int) -> Model:
    loads = len(base.load_effects)
    return replace(base, na=na, nb=nb, delay=delay, theta=(0.0,) * (na + nb + loads + 1), theta_std=())


def _judged(
    structure: Model, parts: Sequence, horizon: int, smooth: Smooth | None, validation: Smooth | None
) -> Candidate:
    def refused(why: str) -> Candidate:
        return Candidate(*orders, np.nan, np.nan, np.full(len(parts), np.nan), why)

    orders = structure.na, structure.nb, structure.delay, len(structure.theta)
    measured, predicted, powers = [], [], []
    for fold in parts:
        try:
            fitted = fit_arx(structure, fold.training, smooth)
        except FitError as error:
            return refused(str(error))
        if fitted.unstable:
            return refused(f"unstable: {fitted.unstable}")
        said = [fitted.ahead(one, horizon, validation) for one in fold.unseen]
        measured += [one.output for one in fold.unseen]
        predicted += said
        block = accuracy([one.output for one in fold.unseen], said)
        powers.append(block.rmse_mps**2)
    judged = accuracy(measured, predicted)
    if not np.all(np.isfinite(powers)):
        return refused("the held-out blocks are too short for the delay and the horizon: record for longer")
    return Candidate(*orders, judged.explained_pct, judged.rmse_mps, np.array(powers))


def _front(usable: Sequence[Candidate]) -> tuple[Candidate, ...]:
    front: list[Candidate] = []
    for one in sorted(usable, key=lambda one: (one.parameters, one.rmse_mps)):
        if not front or one.rmse_mps < front[-1].rmse_mps:
            front.append(one)
    return tuple(front)


def _wise(usable: Sequence[Candidate], best: Candidate) -> Candidate:
    def close(one: Candidate) -> bool:
        more = one.block_power_m2ps2 - best.block_power_m2ps2
        return float(more.mean()) <= float(more.std(ddof=1)) / np.sqrt(len(more))

    return min((one for one in usable if close(one)), key=lambda one: (one.parameters, one.rmse_mps))
