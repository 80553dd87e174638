"""The online estimator: recursive least squares on the model's own regression, behind a gate, kept inside a safe set.

Who owns an offset: while the controller is engaged its disturbance observer does. Then the offset c_0 and the load
coefficients are held, and the rest learns from band-passed columns, which carry no offset. Otherwise everything
learns from low-passed columns. So offset, disturbance and slowly drifting parameters never explain the same thing
twice (design, "the interfaces that carry it").
"""

import math
from dataclasses import replace
from typing import Annotated, Any

import msgspec
import numpy as np

from cruise.estimation.filters import LearningFilter
from cruise.estimation.forgetting import Forgetting, ForgettingSettings
from cruise.estimation.gate import Gate, GateKeeper, GateSettings
from cruise.estimation.recursive import SquareRootRls
from cruise.model.model import Model, ModelState
from cruise.settings import Positive
from cruise.signals import Sample


class EstimatorSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How quickly the model follows the machine, and how far it may go."""

    cutoff_hz: Positive = 2.0  # Hz; at 1 Hz, where the model's validity ends, a minute teaches up to 9 % less
    mean_s: Positive = 15.0  # s, running mean that is left out of learning while engaged
    noise_factor: Positive = 2.0  # filtered residuals are coloured: about one sample in four is news
    pole_max: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.99  # magnitude of the slowest pole that is still believed
    gain_range: Annotated[float, msgspec.Meta(ge=1, le=10)] = 3.0  # DC gain within factory / range .. factory * range
    forgetting: ForgettingSettings = ForgettingSettings()
    gate: GateSettings = GateSettings()


class Learned(msgspec.Struct, frozen=True):
    """What one sample brought: the one step ahead prediction, its error, and whether it taught."""

    predicted_mps: float
    innovation_mps: float
    gate: Gate


class Estimator:
    """Learns the linear parameters of `factory`; structure, effects and their shapes stay."""

    def __init__(self, factory: Model, settings: EstimatorSettings) -> None:
        self.factory = factory
        self.settings = settings
        std = factory.theta_std or tuple(abs(value) * 0.3 + 1e-6 for value in factory.theta)
        self._noise_std = settings.noise_factor * factory.residual_std_mps
        self.rls = SquareRootRls(np.array(factory.theta), np.array(std), self._noise_std)
        self.filter = LearningFilter(len(factory.theta) + 1, factory.period_s, settings.cutoff_hz, settings.mean_s)
        self.gate = GateKeeper(settings.gate, factory.period_s)
        self.state: ModelState | None = None  # after the last sample
        self.applied: ModelState | None = None  # at the last sample, before its speed was observed
        self.last_s = -math.inf
        self.forgetting = self._memory()
        self._owned = factory.na + factory.nb  # parameters that learn while engaged
        self._factory_gain = factory.dc_gain_mps_per_ma

    def predict(self, sample: Sample) -> float:
        """The speed in m/s expected for a sample from those before it; NaN at the start. Learns nothing."""
        if self.state is None or not self._complete(sample):
            return math.nan
        columns, offset = self.factory.regression(self.factory.apply(self.state, sample.current_ma, sample.signals))
        return float(offset + np.dot(columns, self.rls.theta))

    def learn(self, sample: Sample) -> Learned:
        """Take one sample in, and learn from it if the gate lets it teach."""
        if not self._complete(sample):
            self.state = None
            return Learned(math.nan, math.nan, Gate.STALE_SIGNAL)
        model = self.factory
        if self.state is None or abs(sample.time_s - self.last_s - model.period_s) > 0.5 * model.period_s:
            return self._restart(sample)
        self.last_s = sample.time_s
        self.applied = model.apply(self.state, sample.current_ma, sample.signals)
        columns, offset = model.regression(self.applied)
        self.state = model.observe(self.applied, sample.speed_mps)
        row = np.array((sample.speed_mps - offset, *columns))
        predicted_mps = float(offset + row[1:].dot(self.rls.theta))
        rows = self.filter(row)
        drive_mps = self.applied.gain * self.applied.drives[0] * self._factory_gain
        gate = self.gate.judge(sample, drive_mps)
        if gate is Gate.OPEN:
            self._update(rows[1] if sample.engaged else rows[0], sample.engaged)
        return Learned(predicted_mps, sample.speed_mps - predicted_mps, gate)

    def snapshot(self) -> Model:
        """The model as learned so far, with its uncertainty."""
        std = tuple(float(value) for value in self.rls.std())
        return replace(self.factory.with_theta(self.rls.theta), theta_std=std)

    def save(self) -> dict[str, Any]:
        """What must survive a restart, as plain numbers."""
        return {"theta": self.rls.theta.tolist(), "root": self.rls.root.tolist(), "turn": self.rls.turn}

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue from what `save` gave. ValueError if it belongs to another structure or isn't finite and safe."""
        theta, root = np.array(saved["theta"], float), np.array(saved["root"], float)
        size = len(self.factory.theta)
        if theta.shape != (size,) or root.shape not in {(size, size), (self._owned, self._owned)}:
            raise ValueError(f"saved parameters are for {theta.size} of them, this model has {size}")
        if not (np.isfinite(theta).all() and np.isfinite(root).all() and self._safe(theta)):
            raise ValueError(
                "saved parameters are not those of a stable drive with a positive gain: poles up to pole_max, "
                f"{self.settings.pole_max:g}, gain within gain_range, {self.settings.gain_range:g} times the factory's"
            )
        self.rls.theta, self.rls.root, self.rls.turn = theta, root, int(saved["turn"])
        self.state = None

    def forget(self) -> None:
        """Begin anew with the factory's parameters and uncertainty, and with its memory."""
        self.rls = SquareRootRls(self.rls.prior, self.rls.prior_std, self._noise_std)
        self.forgetting = self._memory()
        self.state = None

    def _memory(self) -> Forgetting:
        return Forgetting(self.settings.forgetting, self.factory.period_s, self.factory.residual_std_mps**2)

    def _complete(self, sample: Sample) -> bool:
        return (
            math.isfinite(sample.current_ma) and math.isfinite(sample.speed_mps) and self.factory.usable(sample.signals)
        )

    def _restart(self, sample: Sample) -> Learned:
        """Begin anew after a hole: as if the machine had been driving like this forever."""
        model = self.factory
        self.last_s = sample.time_s
        state = model.start(sample.speed_mps, sample.current_ma, sample.signals)
        self.applied = model.apply(state, sample.current_ma, sample.signals)
        columns, offset = model.regression(self.applied)
        self.state = model.observe(self.applied, sample.speed_mps)
        self.filter.settle(np.array((sample.speed_mps - offset, *columns)))
        self.gate.restart()
        return Learned(math.nan, math.nan, Gate.WARMING_UP)

    def _update(self, row: np.ndarray, engaged: bool) -> None:
        self.rls.hold_after(self._owned if engaged else len(self.rls.theta))
        before = self.rls.theta.copy()
        innovation = float(row[0] - row[1:].dot(before))
        self.rls.update(row[1 : 1 + self.rls.free], innovation, self.forgetting.step(innovation))
        self._project(before)

    def _project(self, before: np.ndarray) -> None:
        """Halve the step until the model is stable, its gain positive and plausible (Ljung and Soderstrom, 6.6)."""
        learned = self.rls.theta
        for fraction in (0.5, 0.25, 0.0):
            if self._safe(self.rls.theta):
                return
            self.rls.theta = before + fraction * (learned - before)

    def _safe(self, theta: np.ndarray) -> bool:
        model, settings = self.factory, self.settings
        a, b, _, _ = model.split(theta.tolist())
        if model.na == 1:
            stable = abs(a[0]) <= settings.pole_max
        else:
            stable = model.na == 0 or bool(np.abs(np.roots([1.0, *(-v for v in a)])).max() <= settings.pole_max)
        if not stable:
            return False
        relative = sum(b) / (1.0 - sum(a)) / self._factory_gain
        return 1.0 / settings.gain_range <= relative <= settings.gain_range
