"""Fits explanations and judges them: every candidate jointly with the core, on blocks of time that it has not seen.

What a candidate gains stands in `judged.py`; which are tried beside what, added, dropped again and exchanged in
`selection.py` and `exchange.py`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cruise.effects import Effect, Stage
from cruise.model import prediction
from cruise.validation.candidates import Candidate, EffectCandidate, ways_of, with_effect, without
from cruise.validation.disturbance import Disturbance, disturbance_of
from cruise.validation.explanation import CORE, LONGEST_LAG_S, START, Explanation
from cruise.validation.fitting import Fit, Layout, Objective, bounded, fit, layout
from cruise.validation.fold_steps import fold_steps
from cruise.validation.judged import Judged, few, gain, sureness
from cruise.validation.side_by_side import side_by_side
from cruise.validation.simulation import RAN_AWAY_MPS, Scene, paced
from cruise.validation.slip import slip_mps, sure_of_slip
from cruise.validation.starts import NEARLY, Promise, Starts, apart
from cruise.validation.told import kinds_of
from cruise.validation.unnamed import RestCurrent, rest_of

FOLDS: Final = 5
BLOCK_S: Final = 20.0  # s: longer than any disturbance that the autoregression leaves behind
PARTS: Final = (
    1.0,
    0.3,
)  # of the step to a fold's parameters, or none: the errors are not quite linear
MOST_STARTS: Final = 3  # from which fits of one candidate begin
MOST_TRIED: Final = 24  # of each way in which it may act, from which a step is tried
QUICK_STEPS: Final = 4  # of the solver, to choose among several starts
ONE_STEP: Final = 2  # likewise: where it stands and one step on
NEARBY: Final = 1.1  # of the cost of a fit that is finished, from which one that is begun elsewhere is finished, too
ORDINARY_STEPS: Final = 40
SETTLED_STEPS: Final = 300
SETTLED: Final = 1e-7  # relative change at which a fit has settled: along a valley of several shapes steps are short
STILL: Final = 1e-10  # of the greatest curvature, every number in units of what it moves: so little tells nothing
PART: Final = 0.01  # of a number in a direction that is not told, from which on it is not told either
SERVO_HZ: Final = (0.8, 1.8)  # from which the fit of a servo with a pair of poles begins
SERVO_LAGS_S: Final = (0.05, 0.03)  # likewise, of the lags beside it
SERVO_GAIN: Final = 0.03  # of the held-out loss, that the pair must take away,
SERVO_SURE: Final = 2.0  # and by so many standard errors
SURE_SEED: Final = 0  # of the bootstrap that says how sure that is
STROKE_SHARE: Final = 0.5  # from which the fit of a drive that yields by its stroke begins: leakage and pump half each
STROKE_GAIN: Final = 0.1  # of the held-out loss, that this must take away where a model is kept,
STROKE_LOOKED_FOR: Final = 0.5  # while effects are looked for (slip, droop and friction are a little like it),
STROKE_SURE: Final = 3.0  # and by so many standard errors
GROUND_GAIN: Final = 0.05  # likewise, of the current at rest,
GROUND_SURE: Final = 3.0
BEYOND_DRIVEN: Final = 0.2  # of all currents from 0 on that were driven, beyond which no machine stands
SPARE_BEGINS: Final = (0.5, 0.02)  # of the way from a spare shape's neutral value to its far bound: where fits begin,
SPARED: Final = 0.6  # of the cost, from which an effect is better off with it (0.31 and 0.50; else 0.65 or more),
NEARER: Final = 0.8  # or so much of it,
NEAR: Final = 0.35  # where hardly any of it is left above the least that anything left,
SLIPS: Final = 0.5  # of what it takes, that slip may be at most: a share of the speed is what slip is, too
AT_BOUND: Final = 0.02  # of a bound, by which a number that wants beyond it is away from it

Show = Callable[[str], None]


class Search:
    """Fits and judges explanations of one scene."""

    def __init__(self, scene: Scene, longest_delay_s: float, gain_scale: float, fixed: frozenset[str]) -> None:
        self.scene = scene
        self.longest_delay_s, self.gain_scale = longest_delay_s, gain_scale
        self.slowest_s = CORE["time_constant_s"].high
        self.starts = tuple(part.start for part in scene.parts)
        self.disturbance = Disturbance((), self.starts)
        self.blocks = _blocks(scene)
        self.fixed = fixed  # shapes that nothing in the recordings moves
        self.slip_mps, self.sure_of_slip = slip_mps(scene.recordings), sure_of_slip(scene.recordings)
        self._starts: Starts | None = None

    # -- fits

    def most_delay_s(self, explanation: Explanation) -> float:
        """Dead time in s that the core may have: what the model can represent, or all where more of it was missing."""
        return CORE["delay_s"].high if "transport_delay" in explanation.structural else self.longest_delay_s

    def plan(self, start: Explanation) -> Layout:
        most_s = self.most_delay_s(start)
        return layout(start, most_s, self.gain_scale, lambda name: name not in self.fixed, self.slowest_s)

    def fitted(self, start: Explanation, steps: int = ORDINARY_STEPS) -> Fit:
        return fit(self.scene, self.plan(start), steps)

    def grown(self, explanation: Explanation, candidate: Candidate) -> Fit:
        """The best joint fit of the explanation with the candidate, from every start that the candidate offers."""
        return self.finished(self.begun(explanation, candidate))

    def begun(self, explanation: Explanation, candidate: Candidate) -> Fit:
        """A few steps from the starts that promise most, in every way in which the candidate may act."""
        return min((self._begun(explanation, one) for one in ways_of(candidate)), key=lambda fit: fit.cost)

    def _begun(self, explanation: Explanation, candidate: Candidate) -> Fit:
        """The same in one way; from further starts only while nothing is gained."""
        starts = self._starts_beside(explanation)
        options = starts.promising(list(candidate.grown(explanation)))
        if any(one.start.core != explanation.core for one in options):  # a promise depends on the core
            return self._best_of_all(starts, options)
        fits: list[Fit] = []
        for promise in apart(options):
            gained = options[0].told and any(one.cost < starts.before for one in fits)
            if len(fits) == MOST_STARTS or (gained and promise.left > NEARLY * options[0].left):
                break
            fits.append(self.fitted(starts.nearest(promise.start), QUICK_STEPS))
        if min(one.cost for one in fits) > starts.before:  # no promise was kept: so weak that little can go wrong
            weakest = min(options, key=lambda one: one.place)
            fits.append(self.fitted(starts.nearest(weakest.start), QUICK_STEPS))
        return min(fits, key=lambda one: one.cost)

    def begun_straight(self, explanation: Explanation, candidate: Candidate, bent: Sequence[str]) -> Fit:
        """`begun` where some of the effects that are there begin anew beside the candidate.

        They may have bent to stand in for it, as a parabola does for a dead zone: from there no step leads back.
        """
        straight = explanation
        for name in bent:
            straight = without(straight, name)
        found = self.begun(self.fitted(straight).explanation, candidate)
        for name in bent:
            found = self.begun(found.explanation, EffectCandidate(name, told=kinds_of(name)))
        return found

    def grown_from_all(self, explanation: Explanation, candidate: Candidate) -> Fit:
        """`grown` from the best of all starts: a step from each, a few from the best of them, the best one to its end.

        What promises most to first order may lead to a corner that is rounded instead of one further on.
        """
        starts = self._starts_beside(explanation)
        ways = [starts.promising(list(way.grown(explanation)))[:MOST_TRIED] for way in ways_of(candidate)]
        return self.finished(self._best_of_all(starts, [one for way in ways for one in way]))

    def _best_of_all(self, starts: Starts, options: Sequence[Promise]) -> Fit:
        """A step from each start, a few from the best of them."""
        fits = [self.fitted(starts.nearest(one.start), ONE_STEP) for one in options]
        best = sorted(fits, key=lambda one: one.cost)[:MOST_STARTS]
        fits = [self.fitted(one.explanation, QUICK_STEPS) for one in best]
        return min(fits, key=lambda one: one.cost)

    def served(self, present: Judged) -> Judged:
        """The same with a pair of poles for the servo, where the two lags are too few: it errs clearly less then.

        A servo of second order that lags cannot imitate would else be taken for an effect of the dynamics. One that
        would be slower, or needs all the delay that there may be, stands in for dead time that the model lacks; one
        that would ring is a resonance.
        """
        core = present.explanation.core
        if core.servo_hz:
            return present
        lag_s, second_lag_s = SERVO_LAGS_S
        paired = [replace(core, servo_hz=one, lag_s=lag_s, second_lag_s=second_lag_s) for one in SERVO_HZ]
        fits = side_by_side(self.fitted, [replace(present.explanation, core=one) for one in paired])
        judged = self.judged(present.candidate, min(fits, key=lambda one: one.cost))
        served = judged.explanation.core
        late = served.delay_s > (1.0 - AT_BOUND) * self.most_delay_s(judged.explanation)
        rings = served.servo_damping < (1.0 + AT_BOUND) * CORE["servo_damping"].low
        if late or rings or served.servo_hz < (1.0 + AT_BOUND) * CORE["servo_hz"].low:
            return present
        return _clearly_less(present, judged, SERVO_GAIN, SERVO_SURE)

    def yielding(self, present: Judged, least: float) -> Judged:
        """The same with a drive that gives way by a share of its stroke, where that takes `least` of the loss.

        Such a drive is the slower the further its pump is out, and loses the more to a slope: `cruise.model.core`.
        """
        core = present.explanation.core
        if core.stroke_share:
            return present
        begun = replace(present.explanation, core=replace(core, stroke_share=STROKE_SHARE))
        judged = self.judged(present.candidate, self.fitted(begun))
        return _clearly_less(present, judged, least, STROKE_SURE)

    def sufficient(self, present: Judged, least: float = STROKE_LOOKED_FOR) -> Judged:
        """The same with all that its core lacks."""
        return self.yielding(self.served(present), least)

    def grounded(self, present: Judged) -> Judged:
        """The same with the current about which its gains turn the drive, where it errs clearly less with it.

        A drive that begins at a third of the current and is never driven there looks as if it had an offset, which no
        gain changes: a false dead zone would make up for that beside every gain.
        """
        turns = any(effect.stage is Stage.GAIN for effect in present.explanation.effects)
        if not turns or _on_the_line(present.explanation):
            return present
        judged = self.judged(present.candidate, self.fitted(with_effect(present.explanation, RestCurrent())))
        return _clearly_less(present, judged, GROUND_GAIN, GROUND_SURE) if self._may_stand(judged.fit) else present

    def freed(self, found: Fit, name: str, least: float = 0.0) -> Fit:
        """The fit with the spare shape of an effect with which it errs far less, and by more than wheels slip.

        `least` is the cost that anything left: above it, noise apart, hardly any must be left then.
        """
        effect = next((one for one in found.explanation.effects if one.name == name), None)
        if effect is None:
            return found
        begun = [_with(found.explanation, shape) for spare in effect.spare for shape in _without_neutral(effect, spare)]
        if effect.stage is Stage.GAIN and not _on_the_line(found.explanation):
            begun.append(with_effect(found.explanation, RestCurrent()))
        free = min(filter(self._may_stand, map(self.fitted, begun)), key=lambda fit: fit.cost, default=found)
        near = free.cost < NEARER * found.cost and free.cost - least < NEAR * (found.cost - least)
        taken = found.mean_square - free.mean_square
        slips = effect.stage in (Stage.GAIN, Stage.LOAD) and self.slip_mps**2 >= SLIPS * taken
        return free if (free.cost < SPARED * found.cost or near) and not slips else found

    def _may_stand(self, found: Fit) -> bool:
        """Whether a machine may stand at the current about which its gains turn the drive, if it has one.

        About one far beyond those that were driven it has the same size at every speed, as a load has, and is no gain.
        """
        rest = rest_of(found.explanation.effects)
        if rest is None:
            return True
        driven_ma = np.concatenate([one.input for one in self.scene.recordings])
        low_ma, high_ma = min(float(np.nanmin(driven_ma)), 0.0), max(float(np.nanmax(driven_ma)), 0.0)
        beyond_ma = BEYOND_DRIVEN * (high_ma - low_ma)
        return low_ma - beyond_ma <= rest.rest_ma <= high_ma + beyond_ma

    def all_freed(self, present: Judged) -> Judged:
        """The same with the spare shapes of all its effects that are better off with them."""
        fit = present.fit
        for effect in present.explanation.effects:
            fit = self.freed(fit, effect.name)
        return present if fit is present.fit else self.judged(present.candidate, fit)

    def _starts_beside(self, explanation: Explanation) -> Starts:
        if self._starts is None or self._starts.explanation != explanation:
            self._starts = Starts(self.scene, self.plan(explanation))
        return self._starts

    def finished(self, begun: Fit) -> Fit:
        """The fit carried on to its end."""
        return fit(self.scene, replace(begun.layout, start=begun.explanation), ORDINARY_STEPS)

    def settled(self, begun: Fit) -> Fit:
        """The fit carried on until nothing changes: of a model that is kept, where the way to it may take its time."""
        plan = replace(begun.layout, start=begun.explanation)
        return min(fit(self.scene, plan, SETTLED_STEPS, SETTLED), begun, key=lambda one: one.cost)

    def regrown(self, found: Fit) -> Fit:
        """The fit settled, or a better one in which what reshapes the current began anew beside all that came later.

        Several such effects lead into valleys from which no step leads out.
        """
        best = self.settled(found)
        for name in [one.name for one in found.explanation.effects if one.stage is Stage.COMMAND]:
            anew = self.grown_from_all(without(best.explanation, name), EffectCandidate(name, told=kinds_of(name)))
            best = min(best, self.settled(anew), key=lambda fit: fit.cost)
        return best

    def grown_anew(self, explanation: Explanation, candidate: Candidate) -> Fit:
        """`grown` with the lags' time in the vehicle at first, or in the actuator: data say how slow which of them is.

        Without anything that acts between them the two are the same, and fits seldom get from one to the other.
        """
        core = explanation.core
        slow_s = min(core.lag_s + core.second_lag_s + core.time_constant_s, self.slowest_s)
        vehicle = replace(core, lag_s=START.lag_s, second_lag_s=START.second_lag_s, time_constant_s=slow_s)
        actuator = replace(vehicle, lag_s=min(slow_s, LONGEST_LAG_S), time_constant_s=START.lag_s)
        found = self.grown(replace(explanation, core=vehicle), candidate)
        if core.servo_hz or all(effect.acts_as is Stage.COMMAND for effect in found.explanation.effects):
            return found
        begun = self.begun(replace(explanation, core=actuator), candidate)
        return min(found, self.finished(begun), key=lambda one: one.cost) if begun.cost < NEARBY * found.cost else found

    def judged(self, name: str, found: Fit) -> Judged:
        """Held-out errors: for every fold the parameters move to where the rest of the recording wants them."""
        objective = Objective(self.scene, found.layout)
        held = self.blocks % FOLDS
        slopes, error_mps = found.jacobian * found.layout.scale, bounded(found.error_mps)
        steps = fold_steps(found.layout, found.vector, slopes, error_mps, held, FOLDS)
        moved = (np.clip(found.vector + part * step, *found.layout.bounds) for step in steps for part in PARTS)
        options = [found.vector, *moved]
        tried = np.vstack([found.error_mps, objective.errors(options[1:])])
        tried = np.clip(tried, -RAN_AWAY_MPS, RAN_AWAY_MPS)
        squares = np.nan_to_num(tried) ** 2
        chosen = []
        for i in range(FOLDS):  # how far the step holds is for the fold's training part to say
            mine = [0, *range(1 + i * len(PARTS), 1 + (i + 1) * len(PARTS))]
            chosen.append(min(mine, key=lambda place, i=i: squares[place, held != i].sum()))
        vectors, errors = [options[place] for place in chosen], tried[chosen]
        unseen = errors[held, np.arange(len(held))]
        white = self.disturbance.whiten(errors)[held, np.arange(len(held))]
        return Judged(name, found, tuple(vectors), unseen, *self._by_block(unseen, white))

    def covariance(self, found: Fit) -> np.ndarray:
        """Covariance (p, p) of the fitted numbers: a sandwich over blocks of time, which coloured errors don't fool.

        What the data don't tell counts as known.
        """
        scale = found.layout.scale
        slopes = found.jacobian * scale
        inverse = np.linalg.pinv(slopes.T @ slopes, rcond=1e-10, hermitian=True)
        return self._sandwich(found, slopes, inverse) * np.outer(scale, scale)

    def standard_errors(self, found: Fit) -> np.ndarray:
        """Standard errors (p,) of the fitted numbers: infinite for all that take part in what moves no error."""
        size = np.linalg.norm(found.jacobian.astype(float), axis=0)
        size[size == 0.0] = 1.0
        slopes = found.jacobian / size
        strength, ways = np.linalg.eigh(slopes.T @ slopes)
        still = strength <= STILL * strength[-1]
        inverse = (ways[:, ~still] / strength[~still]) @ ways[:, ~still].T
        errors = np.sqrt(np.maximum(np.diag(self._sandwich(found, slopes, inverse)), 0.0)) / size
        return np.where((np.abs(ways[:, still]) > PART).any(axis=1), np.inf, errors)

    def _sandwich(self, found: Fit, slopes: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        pulls = np.zeros((int(self.blocks.max()) + 1, slopes.shape[1]))
        np.add.at(pulls, self.blocks, slopes * bounded(found.error_mps)[:, None])
        judged = len(np.unique(self.blocks[np.isfinite(found.error_mps)]))
        return inverse @ (pulls.T @ pulls) @ inverse * few(judged) ** 2

    def ahead_mps(self, one: Explanation, horizon: int) -> np.ndarray:
        """Speeds (N,) of the discrete model so many samples ahead; NaN where there is none."""
        scene, result = self.scene, np.full(len(self.scene), math.nan)
        model = one.model(scene.period_s)
        for part, recording in zip(scene.parts, scene.recordings, strict=True):
            signals = {name: scene.signals[name][part] for name in model.uses if name in scene.signals}
            with np.errstate(over="ignore", invalid="ignore"):
                result[part] = prediction.ahead(model, recording.input, recording.output, signals, horizon)
        return result

    def unseen_ahead_mps(self, judged: Judged, horizon: int) -> np.ndarray:
        """The same, every sample by the fold that has not seen it."""
        speeds = np.array([self.ahead_mps(judged.fit.layout.explanation(vector), horizon) for vector in judged.folds])
        return speeds[self.blocks % FOLDS, np.arange(len(self.scene))]

    def _by_block(self, raw: np.ndarray, white: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = int(self.blocks.max()) + 1
        known = np.isfinite(raw)
        weight = np.bincount(self.blocks[known], minlength=count)
        squares = np.bincount(self.blocks[known], np.minimum(raw[known] ** 2, 1e6), minlength=count)
        sure = np.isfinite(white)
        weight_white = np.bincount(self.blocks[sure], minlength=count)
        whites = np.bincount(self.blocks[sure], np.minimum(white[sure] ** 2, 1e6), minlength=count)
        weight = np.where(weight_white > 0, weight, 0)  # a block that says nothing of the one counts for neither
        return squares / np.maximum(weight, 1), whites / np.maximum(weight_white, 1), weight.astype(float)

    # -- what nobody recorded

    def learn_disturbance(self, base: Fit, others: Sequence[Fit]) -> None:
        """The autoregression of what is left when everything that any candidate could explain is taken away."""
        error = base.error_mps
        columns = [base.jacobian]
        columns += [(error - other.error_mps)[:, None] for other in others]
        everything = np.nan_to_num(np.column_stack(columns), posinf=0.0, neginf=0.0)
        size = np.linalg.norm(everything, axis=0)
        everything = everything[:, size > 0] / size[size > 0]
        known = np.isfinite(error)
        share, *_ = np.linalg.lstsq(everything[known], error[known], rcond=1e-6)
        self.disturbance = disturbance_of(np.where(known, error - everything @ share, np.nan), self.starts)


def _clearly_less(present: Judged, judged: Judged, least: float, surely: float) -> Judged:
    """`judged` where it takes so much of the held-out loss away, and by so many standard errors; else `present`."""
    sure = sureness(present, judged, np.random.default_rng(SURE_SEED)) >= surely
    return judged if sure and gain(present, judged) >= least else present


def _on_the_line(explanation: Explanation) -> bool:
    """Whether it says already at which current the drive begins."""
    return not {RestCurrent.name, "dead_zone"}.isdisjoint(explanation.names)


def _without_neutral(effect: Effect, spare: str) -> list[Effect]:
    """An effect with a spare shape where fits of it begin; none where it is looked for already, or is nothing alone."""
    bound = effect.parameters[spare]
    way = max((bound.low, bound.high), key=lambda value: abs(value - bound.neutral)) - bound.neutral
    begun = [effect.reshaped(**{spare: bound.neutral + share * way}) for share in SPARE_BEGINS]
    return begun if spare in effect.idle and spare not in begun[0].idle else []


def _with(explanation: Explanation, effect: Effect) -> Explanation:
    """The same with another shape of one of its effects."""
    effects = tuple(effect if one.name == effect.name else one for one in explanation.effects)
    return replace(explanation, effects=effects)


def _blocks(scene: Scene) -> np.ndarray:
    """The block of time (N,) of every sample; none reaches over two recordings."""
    result, first = np.zeros(len(scene), dtype=int), 0
    for part in scene.parts:
        samples = part.stop - part.start
        count = max(round(samples * scene.period_s / paced(BLOCK_S, scene.horizon_s)), 1)
        result[part] = first + np.arange(samples) * count // samples
        first += count
    return result
