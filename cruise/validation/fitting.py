"""Joint fit of core, coefficients and shapes to the simulated speed: output error, by trust-region Gauss-Newton.

    minimise over p  || e(p) ||^2,   e(p) measured minus simulated speed at least 3 s after the last measured one

p holds the core's gain, delay, lag and time constant, the offset, a coefficient for each load and the shapes of all
effects. The derivatives are forward differences, simulated at once with the error itself: nearly every step that the
solver tries is taken. All that a solver of least squares needs of errors and derivatives is the triangle R of
[J e] = Q R, whose p + 1 rows have the same sums of squares and products as the N of [J e]. Source: L. Ljung, System
Identification, 2nd ed. 1999, chapters 7 and 10; G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed. 2013, section
5.3; solver: scipy's least_squares (Branch, Coleman, Li).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
from scipy import optimize

from cruise.effects import Stage
from cruise.validation.explanation import CORE, RESONANCE, Explanation
from cruise.validation.simulation import RAN_AWAY_MPS, Scene

STEP: Final = 1e-4  # of a parameter's range, for the differences
TOLERANCE: Final = 1e-5  # relative change of cost and parameters at which a fit has ended
INSIDE: Final = 1e-2  # of a typical change, by which a fit starts inside its bounds
MOST_STEPS: Final = 25
REMEMBERED: Final = 2  # vectors: where the solver stands and what it tries
FAR: Final = 1e3  # bounds of coefficients, in units of their own scale

Kept = TypeVar("Kept")


@dataclass(frozen=True)
class Slot:
    """One fitted number: what it belongs to, its bounds, the size of a typical change."""

    owner: str  # core, an effect, or offset
    name: str
    low: float
    high: float
    scale: float


@dataclass(frozen=True)
class Layout:
    """Which numbers of an explanation are fitted, and how a vector becomes an explanation again."""

    start: Explanation
    slots: tuple[Slot, ...]

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([slot.low for slot in self.slots]), np.array([slot.high for slot in self.slots])

    @cached_property
    def scale(self) -> np.ndarray:
        return np.array([slot.scale for slot in self.slots])

    @cached_property
    def vector(self) -> np.ndarray:
        one, values = self.start, []
        effects = {effect.name: effect for effect in one.effects}
        loads = dict(zip((one.effects[i].name for i in one.at(Stage.LOAD)), one.loads, strict=True))
        for slot in self.slots:
            if slot.owner == "core":
                values.append(getattr(one.core, slot.name))
            elif slot.owner == "offset":
                values.append(one.offset_mps)
            elif slot.name == "load":
                values.append(loads[slot.owner])
            else:
                values.append(getattr(effects[slot.owner], slot.name))
        low, high = self.bounds
        return np.clip(np.array(values, float), low, high)

    def explanation(self, vector: np.ndarray) -> Explanation:
        one = self.start
        for place, value in enumerate(vector.tolist()):
            one = self.moved(one, place, value)
        return one

    def moved(self, one: Explanation, place: int, value: float) -> Explanation:
        """An explanation of this layout with another value of one of its numbers."""
        slot = self.slots[place]
        if slot.owner == "core":
            return replace(one, core=replace(one.core, **{slot.name: value}))
        if slot.owner == "offset":
            return replace(one, offset_mps=value)
        if slot.name == "load":
            owners = [one.effects[i].name for i in one.at(Stage.LOAD)]
            kept = zip(owners, one.loads, strict=True)
            return replace(one, loads=tuple(value if owner == slot.owner else old for owner, old in kept))
        shape = {slot.name: value}
        effects = (effect.reshaped(**shape) if effect.name == slot.owner else effect for effect in one.effects)
        return replace(one, effects=tuple(effects))


def layout(
    start: Explanation,
    longest_delay_s: float,
    gain_scale: float,
    free: Callable[[str], bool],
    slowest_s: float = CORE["time_constant_s"].high,
) -> Layout:
    """All numbers of `start` that are free: core, offset, every load, shapes that are not idle and `free` lets go."""
    longest_s = {"delay_s": longest_delay_s, "time_constant_s": slowest_s}
    slots = [Slot("core", "gain_mps_per_ma", -FAR * gain_scale, FAR * gain_scale, gain_scale)]
    for name in ("delay_s", "lag_s", "second_lag_s", "time_constant_s"):
        bound = CORE[name]
        slots.append(Slot("core", name, bound.low, longest_s.get(name, bound.high), 0.3))
    if start.core.servo_hz:
        pair = [(name, CORE[name]) for name in ("servo_hz", "servo_damping")]
        slots += [Slot("core", name, b.low, b.high, 0.3 * (b.high - b.low)) for name, b in pair]
    if start.core.stroke_share:
        bound = CORE["stroke_share"]
        slots.append(Slot("core", "stroke_share", bound.low, bound.high, 0.3))
    if "resonance" in start.structural:
        slots += [Slot("core", name, b.low, b.high, 0.3 * (b.high - b.low)) for name, b in RESONANCE.items()]
    slots.append(Slot("offset", "offset_mps", -FAR, FAR, 0.1))
    for effect in start.effects:
        if effect.acts_as is Stage.LOAD:
            slots.append(Slot(effect.name, "load", -FAR if effect.either_sign else 0.0, FAR, 0.1))
        for name, bound in effect.parameters.items():
            if name not in effect.idle and free(f"{effect.name}.{name}"):
                slots.append(Slot(effect.name, name, bound.low, bound.high, 0.2 * (bound.high - bound.low)))
    return Layout(start, tuple(slots))


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted explanation with what is needed to judge it: errors (N,) and derivatives (N, p).

    These are kept in single precision, as differences are no more exact: a search holds those of some sixty fits.
    """

    layout: Layout
    vector: np.ndarray
    error_mps: np.ndarray
    jacobian: np.ndarray
    cost: float  # mean of the squared error, in m2/s2

    @cached_property
    def explanation(self) -> Explanation:
        return self.layout.explanation(self.vector)

    @cached_property
    def mean_square(self) -> float:
        """Of the error, not whitened, in m2/s2."""
        judged = self.error_mps[~np.isnan(self.error_mps)]
        return float(np.mean(bounded(judged) ** 2)) if len(judged) else 0.0

    @cached_property
    def room(self) -> np.ndarray:
        """How far every number (p,) is from its nearest bound."""
        low, high = self.layout.bounds
        return np.minimum(self.vector - low, high - self.vector)


class Objective:
    """Errors and derivatives of a layout over a scene."""

    def __init__(self, scene: Scene, plan: Layout) -> None:
        self.scene, self.plan = scene, plan
        self._known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        self._triangles: dict[bytes, np.ndarray] = {}

    def errors(self, vectors: Sequence[np.ndarray]) -> np.ndarray:
        """(P, N), raw, NaN where nothing is judged or a signal is missing."""
        return self.scene.errors([self.plan.explanation(vector) for vector in vectors])

    def residual(self, vector: np.ndarray) -> np.ndarray:
        return bounded(self.raw(vector))

    def jacobian(self, vector: np.ndarray) -> np.ndarray:
        return self._here(vector)[1]

    def raw(self, vector: np.ndarray) -> np.ndarray:
        """Error (N,) as it is."""
        return self._here(vector)[0]

    def differences(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error (N,) and its derivatives (N, p)."""
        return self.residual(vector), self.jacobian(vector)

    def triangle(self, vector: np.ndarray) -> np.ndarray:
        """R (p + 1, p + 1) of the derivatives and, last, the error."""

        def made() -> np.ndarray:
            error, slopes = self.differences(vector)
            return np.asarray(np.linalg.qr(np.column_stack([slopes, error]), mode="r"))

        return self._kept(self._triangles, vector, made)

    def _here(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._kept(self._known, vector, lambda: self._differences(vector))

    def _kept(self, known: dict[bytes, Kept], vector: np.ndarray, make: Callable[[], Kept]) -> Kept:
        key = vector.tobytes()
        if key not in known:
            if len(known) == REMEMBERED:
                known.pop(next(iter(known)))
            known[key] = make()
        return known[key]

    def _differences(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, high = self.plan.bounds
        size = STEP * self.plan.scale
        step = np.where(vector + size > high, -size, size)
        here = self.plan.explanation(vector)
        beside = [self.plan.moved(here, place, value) for place, value in enumerate((vector + step).tolist())]
        raw = self.scene.errors([here, *beside])
        errors = bounded(raw)
        return raw[0].copy(), ((errors[1:] - errors[0]) / step[:, None]).T


def bounded(errors: np.ndarray) -> np.ndarray:
    """Errors of which sums of squares can be taken: nothing where nothing is judged, far where a run went away."""
    return np.clip(np.where(np.isnan(errors), 0.0, errors), -RAN_AWAY_MPS, RAN_AWAY_MPS)


def fit(
    scene: Scene,
    plan: Layout,
    steps: int = MOST_STEPS,
    tolerance: float = TOLERANCE,
) -> Fit:
    """The least squares fit from where the plan starts."""
    objective = Objective(scene, plan)
    low, high = plan.bounds
    room = np.minimum(INSIDE * plan.scale, 0.25 * (high - low))  # on a bound the solver would stand still
    start = np.clip(plan.vector, low + room, high - room)
    found = optimize.least_squares(
        lambda vector: objective.triangle(vector)[:, -1],
        start,
        jac=lambda vector: objective.triangle(vector)[:, :-1],  # type: ignore[arg-type]
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=1e-9,
        max_nfev=steps,
    )
    return Fit(
        plan,
        found.x,
        objective.raw(found.x),
        np.asarray(objective.jacobian(found.x), np.float32),
        float(2.0 * found.cost / max(scene.judged.sum(), 1)),
    )
