"""Where a joint fit of an explanation with a candidate may start, by what each start promises to first order.

    left = min over d and s of  sum_k (e - J d - s z)_k^2,   z = e - e(option)

e error of the explanation, J its derivatives by its own parameters, d how far they move, z what the option takes away
with the core as it is, s how many times as strong a load should be.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.effects import Stage
from cruise.validation.explanation import Explanation
from cruise.validation.fitting import Layout, Objective, bounded
from cruise.validation.simulation import Scene

NEARLY: Final = 1.2  # times what the best start leaves, to first order, that another may leave
UNMOVED: Final = 1e-6  # of what is left: a start that changes no more is none
TOLD: Final = 0.99  # of what is left without the candidate, from which on a promise is worth following
LOAD_MPS: Final = 0.1  # m/s of steady speed per unit of a load, to see where it acts
SAME: Final = 1e-3  # relative difference of what two starts leave, below which they are as good
LEAST_STRENGTH, MOST_STRENGTH = 0.02, 0.7  # of the weakest start, to which it is weakened where its error asks for it
WEAKER: Final = (0.5, 0.2)  # shares of the strength that first order asks for, where it asks for too much


@dataclass(frozen=True, eq=False)
class Promise:
    """A start of a fit, what it would leave in m2/s2 summed, and its place in the order of strength."""

    left: float
    place: float
    start: Explanation
    told: bool  # whether first order says anything: a stop just beyond all currents moves nothing


class Starts:
    """Starts beside the explanation of `plan`; `before` is its mean squared error in m2/s2."""

    def __init__(self, scene: Scene, plan: Layout) -> None:
        self.scene, self.plan, self.explanation = scene, plan, plan.start
        self.error, slopes = Objective(scene, plan).differences(plan.vector)
        self.slopes = slopes * plan.scale
        self.count = max(int(scene.judged.sum()), 1)
        self.before = float(self.error @ self.error) / self.count
        stiff = self.slopes.T @ self.slopes + np.eye(len(plan.scale)) * self.before
        self.soft = np.linalg.inv(stiff)

    def promising(self, options: Sequence[Explanation]) -> list[Promise]:
        """Starts that move something, best first: the core gives way and a load is scaled.

        A start from which nothing moves, such as a stop beyond the highest current, would be left as it is by any fit.
        Beside the options stand what lies between the best and its neighbours, and the weakest made as strong as its
        own error asks for.
        """
        found = self._left(options)
        places, more = _between(self.explanation, options, found)
        found += self._left(more) if more else []
        before = self.before * self.count
        promising = [
            Promise(left, place, _loaded(self.explanation, one, LOAD_MPS * share), left < TOLD * before)
            for place, (left, share, one) in zip([*range(len(options)), *places], found, strict=True)
        ]
        promising.sort(key=lambda one: one.left)
        return [one for one in promising if abs(one.left - before) > UNMOVED * before] or promising

    def nearest(self, option: Explanation) -> Explanation:
        """The start as it is, weaker, or with the core where first order wants it: whichever errs least.

        Friction that is right for the core as it will be may hold the machine still with the core as it is.
        """
        starts = [option]
        if len(option.loads) > len(self.explanation.loads):
            held = set(self.explanation.names)
            places = [option.effects[i].name in held for i in option.at(Stage.LOAD)]
            pairs = list(zip(places, option.loads, strict=True))
            starts += [
                replace(option, loads=tuple(load if kept else share * load for kept, load in pairs)) for share in WEAKER
            ]
        errors = bounded(self.scene.errors(starts))
        if option.core == self.explanation.core:
            moved = [self._core_moved(one, error) for one, error in zip(starts, errors, strict=True)]
            starts, errors = [*starts, *moved], np.vstack([errors, bounded(self.scene.errors(moved))])
        return starts[int(np.argmin(np.einsum("ij,ij->i", errors, errors)))]

    def _core_moved(self, option: Explanation, error: np.ndarray) -> Explanation:
        """The option with core and offset where its error (N,) asks for them, to first order."""
        plan, slopes, soft = self.plan, self.slopes, self.soft
        low, high = plan.bounds
        moved = plan.explanation(np.clip(plan.vector - plan.scale * (soft @ (slopes.T @ error)), low, high))
        return replace(option, core=moved.core, offset_mps=moved.offset_mps)

    def _left(self, options: Sequence[Explanation]) -> list[tuple[float, float, Explanation]]:
        """What each option would leave, in m2/s2 summed, and how many times as strong it should be for that."""
        explanation, error, slopes, soft = self.explanation, self.error, self.slopes, self.soft
        moved = error - bounded(self.scene.errors([_loaded(explanation, option) for option in options]))
        mine, its = error @ slopes, moved @ slopes
        size = np.einsum("ij,ij->i", moved, moved) - np.einsum("ij,jk,ik->i", its, soft, its)
        along = moved @ error - its @ soft @ mine
        strength = along / np.maximum(size, 1e-12)
        share = np.ones(len(options))
        if len(options[0].loads) > len(explanation.loads):
            share = strength if any(one.either_sign for one in options[0].effects) else np.maximum(strength, 0.0)
            strength = share
        left = error @ error - mine @ soft @ mine - 2.0 * share * along + share**2 * size
        return list(zip(left.tolist(), strength.tolist(), options, strict=True))


def apart(options: Sequence[Promise]) -> list[Promise]:
    """The best first, then those that promise nearly as much, each as far as it can be from those before it."""
    near = [one for one in options if one.left <= NEARLY * options[0].left]
    order = [near.pop(0)]
    while near:
        far = max(near, key=lambda one: min(abs(one.place - other.place) for other in order))
        near.remove(far)
        order.append(far)
    return [*order, *(one for one in options if one not in order)]


def _loaded(before: Explanation, option: Explanation, coefficient: float = LOAD_MPS) -> Explanation:
    """The option with something in the load that is new: a coefficient of 0 would not show where it acts."""
    if len(option.loads) == len(before.loads):
        return option
    held = set(before.names)
    loads = [
        load if option.effects[i].name in held else coefficient
        for i, load in zip(option.at(Stage.LOAD), option.loads, strict=True)
    ]
    return replace(option, loads=tuple(loads))


def _between(
    before: Explanation, options: Sequence[Explanation], found: Sequence[tuple[float, float, Explanation]]
) -> tuple[list[float], list[Explanation]]:
    """Further starts: the middle between the best option and its neighbours, the weakest one as strong as it should be.

    `options` stand in the order of their strength, with what each leaves and its best strength in `found`. Before the
    starts stand their places in that order.
    """
    left = [one for one, _, _ in found]
    best = max(i for i in range(len(options)) if left[i] <= (1.0 + SAME) * min(left))  # the strongest of those alike
    further = [
        (0.5 * (best + i), _mixed(options[best], options[i])) for i in (best - 1, best + 1) if 0 <= i < len(options)
    ]
    if len(options[0].loads) == len(before.loads):
        further.append((-0.5, _weakened(before, options[0], found[0][1])))
    further = [one for one in further if one[1].effects != options[best].effects]
    return [place for place, _ in further], [one for _, one in further]


def _mixed(one: Explanation, other: Explanation) -> Explanation:
    """Shapes in the middle between those of two explanations with the same effects: in ratios where both have one.

    Between two kinds of an effect there is no middle.
    """
    effects = []
    for mine, its in zip(one.effects, other.effects, strict=True):
        pairs = {name: (getattr(mine, name), getattr(its, name)) for name in mine.parameters}
        middles = {name: math.sqrt(a * b) if min(a, b) > 0.0 else 0.5 * (a + b) for name, (a, b) in pairs.items()}
        middles |= {mine.kind: pairs[mine.kind][0]} if mine.kind else {}
        effects.append(mine if mine == its else mine.reshaped(**middles))
    return replace(one, effects=tuple(effects))


def _weakened(before: Explanation, option: Explanation, strength: float) -> Explanation:
    """The option with the shapes of what is new so many times as far from their neutral values, within bounds."""
    times = math.copysign(min(max(abs(strength), LEAST_STRENGTH), MOST_STRENGTH), strength)
    effects = []
    for effect in option.effects:
        shape = {
            name: min(max(one.neutral + times * (getattr(effect, name) - one.neutral), one.low), one.high)
            for name, one in effect.parameters.items()
        }
        effects.append(effect if effect.name in before.names else effect.reshaped(**shape))
    return replace(option, effects=tuple(effects))
