"""Which model drives: the running 3 s ahead error of each, and when the learned one may take over.

    e_k = y_k - y_k|k-h,   E_k = E_(k-1) + (T / W) (e_k^2 - E_(k-1)),   RMS = sqrt(E)

y_k|k-h the model's free run from h samples ago with the measured currents and signals, plus the disturbance that was
known then: a running mean of its one step ahead error, as the observer would carry it. Judged by predictions, not by
parameters: below 1 Hz the single b_j can't be told apart.
"""

import math
from collections import deque
from collections.abc import Mapping

import msgspec

from cruise.model.model import Model, ModelState
from cruise.settings import Positive
from cruise.signals import Sample


class SupervisionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a learned model proves itself."""

    horizon_s: Positive = 3.0  # s, Coen et al. 2005, section II.B
    window_s: Positive = 30.0  # s, time constant of the running errors
    disturbance_s: Positive = 2.0  # s, time constant of the running one step ahead error
    adopt_every_s: Positive = 5.0  # s, at most so often
    proof_s: Positive = 10.0  # s of judged predictions before the first adoption
    worse_at_most: Positive = 1.05  # the learned model's error relative to that of the one that drives


class AheadErrors:
    """Running RMS of the 3 s ahead error of several models of one structure, and of persistence."""

    def __init__(self, period_s: float, settings: SupervisionSettings) -> None:
        self.settings = settings
        self.period_s = period_s
        self.horizon = max(round(settings.horizon_s / period_s), 1)
        self.mean_squares: dict[str, float] = {}
        self.restart()

    def restart(self) -> None:
        """Forget the way here, after a hole in the samples; the errors stay."""
        self.past: deque[tuple[ModelState, Sample, dict[str, float]]] = deque(maxlen=self.horizon + 1)
        self.disturbances: dict[str, float] = {}
        self.judged_s = 0.0

    def step(self, before: ModelState, sample: Sample, models: Mapping[str, Model]) -> None:
        """One sample on; `before` is the state once its current was applied and before its speed was observed."""
        share = min(self.period_s / self.settings.disturbance_s, 1.0)
        for name, model in models.items():
            residual = float(sample.speed_mps - model.next_speed(before))
            known = self.disturbances.get(name, 0.0)
            self.disturbances[name] = known + share * (residual - known)
        any_model = next(iter(models.values()))
        after = any_model.observe(before, sample.speed_mps)
        self.past.append((after, sample, dict(self.disturbances)))
        if len(self.past) <= self.horizon:
            return
        self.judged_s += self.period_s
        start, first, disturbances = self.past[0]
        self._count("persistence", sample.speed_mps - first.speed_mps)
        for name, model in models.items():
            state, speed = start, math.nan
            for _, passed, _ in list(self.past)[1:]:
                state = model.apply(state, passed.current_ma, passed.signals)
                speed = model.next_speed(state) + disturbances.get(name, 0.0)
                state = model.observe(state, speed)
            self._count(name, sample.speed_mps - speed)

    def rms_mps(self, name: str) -> float:
        """Running RMS error of a model; NaN before anything was judged."""
        return math.sqrt(self.mean_squares.get(name, math.nan))

    def _count(self, name: str, error_mps: float) -> None:
        before = self.mean_squares.get(name)
        share = 1.0 if before is None else min(self.period_s / self.settings.window_s, 1.0)
        self.mean_squares[name] = (before or 0.0) + share * (error_mps**2 - (before or 0.0))


class Supervisor:
    """Holds the model that drives and lets a better one take its place."""

    def __init__(self, factory: Model, settings: SupervisionSettings) -> None:
        self.settings = settings
        self.factory = factory
        self.driving = factory
        self.errors = AheadErrors(factory.period_s, settings)
        self.adoptions = 0
        self._since_s = 0.0

    def step(self, before: ModelState, sample: Sample, learned: Model) -> Model | None:
        """Judge one sample; the model to drive with from now on where it changes, None where it stays."""
        models = {"learned": learned, "driving": self.driving, "factory": self.factory}
        self.errors.step(before, sample, models)
        self._since_s += self.factory.period_s
        due = self._since_s >= self.settings.adopt_every_s and self.errors.judged_s >= self.settings.proof_s
        if not due:
            return None
        self._since_s = 0.0
        if learned.theta == self.driving.theta:
            return None
        allowed = self.settings.worse_at_most * self.errors.rms_mps("driving")
        if not self.errors.rms_mps("learned") <= allowed:
            return None
        self.driving = learned
        self.adoptions += 1
        return learned
