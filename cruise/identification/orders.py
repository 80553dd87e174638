"""The search over orders and delay: held-out error against complexity.

Every (na, nb, delay) of a grid is fitted to the folds of the recordings and judged on what it had not seen, `horizon_s`
ahead, all of them on the same samples. They share the effects, whose shapes were found on everything. Best is not
always wise: recommended is the structure with the fewest parameters whose squared error is within one standard error of
the best one's, both taken fold by fold. Source: L. Breiman et al., Classification and Regression Trees (1984), section
3.4.3 (the one-standard-error rule); sections IV.B and IV.B.1 of Coen et al. 2005.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cruise.identification.accuracy import Accuracy, accuracy
from cruise.identification.arx import fit_arx
from cruise.identification.held_out import Fold, folds
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
    power_m2ps2: np.ndarray  # (folds,) mean squared error on what each fold held out
    refused: str = ""  # why there are no figures


@dataclass(frozen=True)
class Search:
    """All candidates, best first; `front` are those that no simpler one beats, `recommended` one of them."""

    candidates: tuple[Candidate, ...]
    front: tuple[Candidate, ...]
    recommended: Candidate
    effects: tuple[str, ...]  # of all of them
    period_s: float
    horizon_s: float


def search(
    base: Model,
    recordings: Sequence[Recording],
    na: Sequence[int],
    nb: Sequence[int],
    delays: Sequence[int],
    horizon_s: float,
    smooth: Smooth | None = None,
    validation: Smooth | None = None,
    show: Callable[[int, int], None] | None = None,
) -> Search:
    """Judge every combination with the effects of `base`; `show` is told how many of how many are done.

    `recordings` are on the period of `base`, `delays` in samples. Raises FitError where no structure can be judged.
    """
    grid = [(i, j, d) for i, j, d in product(na, nb, delays) if i + j > 0]
    if not grid:
        raise FitError("no structure to search: give a greatest na or nb of 1 or more")
    horizon = max(round(horizon_s / base.period_s), 1)
    task = _Task(recordings, folds(recordings), horizon, max(na) + max(nb) + max(delays) + horizon, smooth, validation)
    found = []
    for done, orders in enumerate(grid):
        found.append(task.judged(_structure(base, *orders)))
        if show is not None:
            show(done + 1, len(grid))
    usable = [one for one in found if not one.refused]
    if not usable:
        raise FitError(f"none of {len(grid)} structures can be judged; the first one: {found[0].refused}")
    best = min(usable, key=lambda one: one.rmse_mps)
    return Search(
        candidates=tuple(sorted(found, key=lambda one: (bool(one.refused), one.rmse_mps))),
        front=_front(usable),
        recommended=_wise(usable, best),
        effects=tuple(effect.name for effect in base.effects),
        period_s=base.period_s,
        horizon_s=horizon * base.period_s,
    )


def _structure(base: Model, na: int, nb: int, delay: int) -> Model:
    loads = len(base.load_effects)
    return replace(base, na=na, nb=nb, delay=delay, theta=(0.0,) * (na + nb + loads + 1), theta_std=())


@dataclass(frozen=True, eq=False)
class _Task:
    """What is the same for all candidates; `lead`: samples of every recording from which one of them can't predict."""

    recordings: Sequence[Recording]
    folds: Sequence[Fold]
    horizon: int
    lead: int
    smooth: Smooth | None
    validation: Smooth | None

    def judged(self, structure: Model) -> Candidate:
        """The structure with its figures, or with the reason why it has none."""
        orders = structure.na, structure.nb, structure.delay, len(structure.theta)
        try:
            whole, powers = self._figures(structure)
        except FitError as error:
            return Candidate(*orders, np.nan, np.nan, np.full(len(self.folds), np.nan), str(error))
        return Candidate(*orders, whole.explained_pct, whole.rmse_mps, powers)

    def _figures(self, structure: Model) -> tuple[Accuracy, np.ndarray]:
        """Over everything, and the mean squared error of each fold. FitError where there are none."""
        measured = [one.output for one in self.recordings]
        predicted = [np.full(len(one), np.nan) for one in self.recordings]
        powers = []
        for fold in self.folds:
            fitted = fit_arx(structure, fold.training, self.smooth)
            if fitted.unstable:
                raise FitError(f"unstable: {fitted.unstable}")
            said = [np.full(len(one), np.nan) for one in self.recordings]
            for one, unseen, mine, result in zip(self.recordings, fold.unseen, said, predicted, strict=True):
                judged = slice(max(unseen.start, self.lead), unseen.stop)
                if judged.stop > judged.start:
                    mine[judged] = result[judged] = fitted.ahead(one, self.horizon, self.validation)[judged]
            powers.append(accuracy(measured, said).rmse_mps ** 2)
        if not np.all(np.isfinite(powers)):
            raise FitError("a held-out part has no prediction: record for longer, or search over shorter delays")
        return accuracy(measured, predicted), np.array(powers)


def _front(usable: Sequence[Candidate]) -> tuple[Candidate, ...]:
    front: list[Candidate] = []
    for one in sorted(usable, key=lambda one: (one.parameters, one.rmse_mps)):
        if not front or one.rmse_mps < front[-1].rmse_mps:
            front.append(one)
    return tuple(front)


def _wise(usable: Sequence[Candidate], best: Candidate) -> Candidate:
    def close(one: Candidate) -> bool:
        more = one.power_m2ps2 - best.power_m2ps2
        return float(more.mean()) <= float(more.std(ddof=1)) / np.sqrt(len(more))

    return min((one for one in usable if close(one)), key=lambda one: (one.parameters, one.rmse_mps))
