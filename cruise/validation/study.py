"""A study: recordings laid out for the search, and the explanation that a model stands for, fitted to them.

Whatever the model's own orders are, its effects act beside the physical core; what of its delay and order can be
represented is kept as the bound of the core's delay. A model that can't represent the delay lacks `transport_delay`.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Effect
from cruise.identification.preparation import at_period
from cruise.identification.regressors import UNCHANGED, FitError
from cruise.identification.structures import Family, Structure
from cruise.model.model import Model
from cruise.recording import Recording, resample
from cruise.signals import OUTPUT
from cruise.validation.background import STRUCTURAL
from cruise.validation.candidates import Candidate, EffectCandidate, absent, candidate_of, why_not
from cruise.validation.complete import complete
from cruise.validation.explanation import PUSHED_S, START, Explanation
from cruise.validation.judged import Judged
from cruise.validation.line_pressure import force_of_a_bar
from cruise.validation.noise_floor import white_mps
from cruise.validation.search import AT_BOUND, Search
from cruise.validation.simulation import JUDGED_S, WARM_UP_S, Scene, paced
from cruise.validation.told import BY_SLOPE, kinds_of

SHORTEST_S: Final = 60.0  # s of data in which anything can be judged held-out
LONGEST_PERIOD_S: Final = 1.0  # s, five times the usual one
FINEST_S: Final = 0.04  # s, the finest rate at which the current is reshaped: no servo moves within it,
NO_NEED: Final = 0.6  # of it, from which a recording is thinned
ROUNDING: Final = 1e-9  # of a count of parts

Show = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Study:
    """Recordings at the model's period, and what is fitted to them."""

    recordings: tuple[Recording, ...]
    search: Search
    base: Judged
    horizon_s: float  # in whole periods
    delay_s: float  # of the model that was given
    white_mps: float  # white part of the measured speed, that nothing foretells; 0 where it is not known

    @property
    def period_s(self) -> float:
        return self.search.scene.period_s

    @property
    def horizon(self) -> int:
        """Samples that it looks ahead."""
        return round(self.horizon_s / self.period_s)


def study(
    recordings: Sequence[Recording],
    structure: Structure,
    file: Model | None,
    period_s: float,
    horizon_s: float = WARM_UP_S,
    show: Show = lambda text: None,
    at_their_rate: bool = True,
    further: Collection[str] = (),
) -> Study:
    """The model, or structure, fitted to the recordings as an explanation. FitError says what is in the way.

    `at_their_rate`: what reshapes and delays the current is computed at the rate of the recordings, which tells effects
    apart best; else from means over the period, as the discrete model does that drives. `further` are signals that are
    needed beside the model's, even where they have holes.
    """
    if period_s > LONGEST_PERIOD_S:
        raise FitError(
            f"samples of {period_s:g} s are longer than a drive takes to answer, and tell no effects apart: "
            f"give a period of {LONGEST_PERIOD_S:g} s or less"
        )
    if structure.family is Family.NARX:
        raise FitError("a NARX model has polynomials in place of effects: diagnose an arx, armax or oe model")
    effects: tuple[Effect, ...] = file.effects if file else tuple(EFFECTS[name]() for name in structure.effects)
    recordings = complete(recordings, {*further, *(name for effect in effects for name in effect.needs)})
    prepared = at_period(recordings, period_s)
    horizon_s = round(max(round(horizon_s / period_s), 1) * period_s, 9)
    for effect in effects:
        reason = absent(type(effect), prepared) if effect.name in EFFECTS else ""
        if reason:
            raise FitError(f"the model's {effect.name} can't be computed: {reason}; record it, or leave the effect out")
    shared = set.intersection(*(set(one.columns) for one in prepared))
    raw = [_no_finer(one, period_s) for one in recordings] if at_their_rate else None
    scene = Scene(prepared, sorted(shared | {OUTPUT}), raw, horizon_s)
    known = np.isfinite(scene.current_ma) & np.isfinite(scene.speed_mps)
    if not known.any():
        raise FitError("no sample has both current and speed: choose other columns with --input and --output")
    if np.ptp(scene.current_ma[known]) <= UNCHANGED * np.abs(scene.current_ma[known]).max():
        raise FitError(
            "the current never changes, there is nothing to learn from: drive the machine, or choose --input"
        )
    slope = float(np.polyfit(scene.current_ma[known], scene.speed_mps[known], 1)[0])
    longest_s = min(structure.delay_s + max(0.5 * (structure.nb - 1), 0.5) * period_s, 2.0)  # of its middle tap
    search = Search(scene, longest_s, max(abs(slope) / 3.0, 1e-6), _fixed(effects, prepared))
    core = replace(START, gain_mps_per_ma=slope, delay_s=min(START.delay_s, 0.5 * longest_s))
    explanation = Explanation(replace(core, stroke_share=file.stroke_share) if file else core)
    judged_s = np.isfinite(scene.errors([explanation])).sum() * period_s
    shortest_s, stretch_s = paced(SHORTEST_S, horizon_s), horizon_s + paced(JUDGED_S, horizon_s)
    if judged_s < shortest_s:
        raise FitError(
            f"{judged_s:.0f} s of the recordings can be judged, too little: record {shortest_s:.3g} s or more, "
            f"in stretches of at least {stretch_s:.3g} s without a hole; a quick drive can be judged less far ahead"
        )
    show("fitting the core")
    found = search.fitted(explanation)
    if found.explanation.core.time_constant_s > (1.0 - AT_BOUND) * search.slowest_s:
        search.slowest_s = PUSHED_S
        found = search.fitted(found.explanation)
    for effect in effects:
        show(f"fitting with {effect.name}")
        given = EffectCandidate(effect.name, given=effect if file else None, told=kinds_of(effect.name))
        structural = effect.name in STRUCTURAL  # of the core, and not of what stands before it
        found = search.grown(found.explanation, candidate_of(effect.name, prepared) if structural else given)
    if effects:
        show("fitting all together")
        found = search.settled(found) if file else search.regrown(found)
    base = search.sufficient(search.judged("", found))
    return Study(tuple(prepared), search, base, horizon_s, structure.delay_s, white_mps(recordings, prepared))


def candidate(name: str, recordings: Sequence[Recording]) -> Candidate:
    """The candidate of a name in the table of effects. FitError says why these recordings can't speak of it."""
    reason = why_not(EFFECTS[name], recordings)
    if reason:
        raise FitError(f"{name} can't be added: {reason}; record a drive in which it is measured and moves")
    return candidate_of(name, recordings)


def discrete(one: Study, judged: Judged) -> Model:
    """The model that estimator and controller run, its standard errors carried over from those of the physical core."""
    layout, vector = judged.fit.layout, judged.fit.vector
    model = judged.explanation.model(one.period_s)
    covariance = one.search.covariance(judged.fit)
    size = 1e-4 * layout.scale
    _, high = layout.bounds
    step = np.where(vector + size > high, -size, size)
    there = np.asarray(judged.explanation.model(one.period_s, model).theta)
    slopes = np.empty((len(there), len(vector)))
    for i in range(len(vector)):
        moved = layout.explanation(vector + np.eye(len(vector))[i] * step[i]).model(one.period_s, model)
        slopes[:, i] = (np.asarray(moved.theta) - there) / step[i]
    std = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    error_mps = one.search.scene.speed_mps - one.search.ahead_mps(judged.explanation, 1)
    residual_std_mps = float(np.sqrt(np.nanmean(error_mps**2)))
    return replace(model, theta_std=tuple(std.tolist()), residual_std_mps=residual_std_mps)


def _no_finer(one: Recording, period_s: float) -> Recording:
    """A recording as means over a part of the period where it is far finer than `FINEST_S`."""
    fine_s = period_s / max(math.floor(period_s / FINEST_S + ROUNDING), 1)
    return resample(one, fine_s) if one.dt_s <= NO_NEED * fine_s else one


def _fixed(effects: Sequence[Effect], recordings: Sequence[Recording]) -> frozenset[str]:
    """Shapes that these recordings say nothing about: of gears that were not driven, the reference gear; what the
    pitch sensor and a bar of line pressure show is told by the signals alone."""
    driven = set()
    for one in recordings:
        if "gear" in one.columns:
            gear = one.columns["gear"]
            driven |= {int(value) for value in np.unique(gear[np.isfinite(gear)])}
    unknown = {f"gear_ratio.gear_{i}_mps" for i in (1, 2, 3, 4) if i not in driven}
    if not driven & {3, 4}:
        unknown.add("gear_ratio.pace_exponent")
    if not all("machine_mass_kg" in one.columns for one in recordings):
        unknown.add("grade.mass_share")
    unknown |= {
        f"power_limit.{name}" for name in (BY_SLOPE["power_limit"] if force_of_a_bar(recordings) else ("rest_bar",))
    }
    if not all("engine_load_pct" in one.columns for one in recordings):
        unknown.add("power_limit.load_share")
    unknown |= {"crop_load.traction_pct_per_bar_mps", "crop_load.rest_bar"}
    reference = {"gear_ratio.gear_2_mps", "grade.acceleration_share", "power_limit.kn_per_bar"}
    kinds = {f"{name}.{effect.kind}" for name, effect in EFFECTS.items() if effect.kind}
    return frozenset(unknown | reference | kinds)
