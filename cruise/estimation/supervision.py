"""Which model drives: a learned one that proved itself in the shadow, the last good one, or the factory's.

A candidate is what was learned at one instant, and stands still from then on: what it is judged on are predictions
that begin after that instant, so that none of them taught it, and only those over which the speed changed: at a steady
speed every model is right. No prediction counts over which anything but the drive moved the machine: where its gain is
nought every model is right, too, and under a brake every model is wrong. Then `Check` has its word, a piece at every
sample. It has to go at once where its running error exceeds the factory model's by share and amount; the way back takes
a new proof.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Final

import msgspec

from cruise.estimation.shadow import Horizon, Passed, Shadow
from cruise.model.model import Model, ModelState
from cruise.settings import Positive
from cruise.signals import Sample

LAST_DECISIONS: Final = 20  # kept: those of the last minutes; what a run counts of them is in its statistics


class SupervisionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a learned model proves itself, and when it has to go."""

    horizon_s: Annotated[float, msgspec.Meta(gt=0, le=30)] = 3.0  # s, Coen et al. 2005, section II.B
    window_s: Annotated[float, msgspec.Meta(ge=5, le=300)] = 30.0  # s, time constant of the running errors
    disturbance_s: Positive = 2.0  # s, time constant of the running one step ahead error
    proof_s: Annotated[float, msgspec.Meta(ge=5, le=600)] = 20.0  # s of judged predictions before an adoption
    moved_mps: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.08  # m/s over the horizon: less proves nothing
    worse_at_most: Annotated[float, msgspec.Meta(ge=0.5, le=1.1)] = 1.0  # a candidate's error over the others'
    # It has to go where its running error is above so many times the factory model's, and above it by so much.
    return_at: Annotated[float, msgspec.Meta(ge=1.05, le=2)] = 1.2
    return_above_mps: Annotated[float, msgspec.Meta(ge=0, le=0.1)] = 0.01  # m/s


class Change(StrEnum):
    """What was decided."""

    ADOPTED = "adopted"
    RETURNED = "returned"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Decision:
    """A decision about a model, with its reason and the figures behind it, units in their names."""

    time_s: float
    change: Change
    why: str
    figures: Mapping[str, float]

    def as_json(self) -> dict[str, Any]:
        """The same as plain values, the figures beside the rest."""
        return {"time_s": self.time_s, "change": str(self.change), "why": self.why, **self.figures}

    def __str__(self) -> str:
        figures = ", ".join(f"{name} {value:.3g}" for name, value in self.figures.items())
        return f"{self.change}: {self.why} ({figures})"


@dataclass(frozen=True, slots=True)
class Finding:
    """What one piece of a check found; `against` is empty where nothing speaks against the model."""

    against: str
    figures: Mapping[str, float]


Check = Callable[[Model, Sequence[Model], ModelState, Sample], Iterator[Finding]]
"""A candidate, the models that may be right instead, and the present operating point, to findings piece by piece."""


class Supervisor:
    """Holds the model that drives and lets a better one take its place."""

    def __init__(self, factory: Model, settings: SupervisionSettings, check: Check) -> None:
        self.settings, self.check, self.period_s = settings, check, factory.period_s
        samples = max(round(settings.horizon_s / self.period_s), 1)
        share, lasting = (min(self.period_s / one, 1.0) for one in (settings.window_s, settings.disturbance_s))
        self._horizon = Horizon(samples, share, lasting)
        self._factory = self._driving = self._last = self._learned = Shadow(factory, self._horizon)
        self._past: deque[Passed] = deque(maxlen=samples + 1)
        self._persistence = math.nan  # mean square
        self._since = self._proved = 0  # samples of the candidate, and those of its proof
        self._findings: Iterator[Finding] | None = None
        self._figures: dict[str, float] = {}
        self.adoptions = 0
        self.decisions: deque[Decision] = deque(maxlen=LAST_DECISIONS)

    @property
    def driving(self) -> Model:
        """The model that drives."""
        return self._driving.model

    @property
    def proved_s(self) -> float:
        """How much of a proof there is."""
        return self._proved * self.period_s

    @property
    def decision(self) -> Decision | None:
        """The last one."""
        return self.decisions[-1] if self.decisions else None

    @property
    def rms_mps(self) -> dict[str, float]:
        """Running RMS 3 s ahead errors, and that of persistence; empty before anything was judged."""
        found = {
            "learned": self._learned.rms_mps,
            "driving": self._driving.rms_mps,
            "factory": self._factory.rms_mps,
            "persistence": math.sqrt(self._persistence),
        }
        return {name: value for name, value in found.items() if math.isfinite(value)}

    def restart(self) -> None:
        """Forget the way here, after a hole in the samples; the errors stay, a proof begins anew."""
        self._past.clear()
        for shadow in self._shadows():
            shadow.restart()
        self._begin(self._learned)

    def forget(self) -> None:
        """Begin anew with the factory's model."""
        self._driving = self._last = self._factory
        self._learned = self._factory
        self.restart()

    def step(self, before: ModelState, sample: Sample, learned: Callable[[], Model]) -> Decision | None:
        """One sample on; `before` is the state once its current was applied and before its speed was observed.

        `learned` gives the next candidate. Returns what was decided, where it is news; `driving` is the model to drive
        with from now on.
        """
        self._judge((before, sample))
        if self._driving is not self._factory and self._has_to_go():
            self._figures = {f"{name}_mps": value for name, value in self.rms_mps.items()}
            better = min((self._last, self._factory), key=lambda shadow: shadow.rms_mps)
            why = "its error is above that of the factory's model"
            return self._drive_with(better, self._factory, Change.RETURNED, why, sample)
        if self._learned is self._driving:
            candidate = learned()
            if candidate.theta != self.driving.theta:
                self._begin(Shadow(candidate, self._horizon, self._past, self._learned))
            return None
        if not before.gain > 0.0:  # in neutral there is no operating point to check it at
            return None
        if self.proved_s < self.settings.proof_s:
            return None
        return self._decide(before, sample)

    def _shadows(self) -> list[Shadow]:
        """Each that has a part, once."""
        parts = (self._factory, self._last, self._driving, self._learned)
        return list({id(shadow): shadow for shadow in parts}.values())

    def _judge(self, passed: Passed) -> None:
        """A sample in which the drive has no part, or is not alone, may begin a prediction and is part of none."""
        before, sample = passed
        neutral = sample.signals.get("gear", math.nan) <= 0.0 or not before.gain > 0.0
        void = sample.overridden or neutral
        if void:
            self._past.clear()
        self._past.append(passed)
        self._since += 1
        counts = False
        if len(self._past) > self._horizon.samples:
            moved_mps = sample.speed_mps - self._past[0][1].speed_mps
            counts = abs(moved_mps) >= self.settings.moved_mps and self._since > self._horizon.samples
            known = self._persistence if math.isfinite(self._persistence) else moved_mps**2
            self._persistence = known + self._horizon.window * (moved_mps**2 - known)
        for shadow in self._shadows():
            shadow.step(passed, counts, void)
        self._proved += counts

    def _has_to_go(self) -> bool:
        factory_mps = self._factory.rms_mps
        most_mps = max(self.settings.return_at * factory_mps, factory_mps + self.settings.return_above_mps)
        return self._driving.rms_mps > most_mps

    def _begin(self, learned: Shadow) -> None:
        """A new proof."""
        self._learned = learned
        self._since = self._proved = 0
        self._findings = None
        for shadow in self._shadows():
            shadow.proof = 0.0

    def _decide(self, before: ModelState, sample: Sample) -> Decision | None:
        """Compare the errors, then ask for one finding at every sample; the first that speaks against it ends it."""
        learned, driving, factory = self._learned, self._driving, self._factory
        if self._findings is None:
            errors = {"learned": learned, "driving": driving, "factory": factory}
            self._figures = {f"{name}_mps": math.sqrt(one.proof / self._proved) for name, one in errors.items()}
            allowed = self.settings.worse_at_most**2
            for other, whose in ((driving, "the one that drives"), (factory, "the factory's model")):
                if not learned.proof <= allowed * other.proof:
                    return self._refuse(f"its error is above that of {whose}", sample)
            self._findings = self.check(learned.model, (driving.model, factory.model), before, sample)
            return None
        finding = next(self._findings, None)
        if finding is None:
            self.adoptions += 1
            return self._drive_with(learned, driving, Change.ADOPTED, "it proved itself", sample)
        for name, value in finding.figures.items():
            self._figures[name] = min(value, self._figures.get(name, math.inf))
        return self._refuse(finding.against, sample) if finding.against else None

    def _refuse(self, why: str, sample: Sample) -> Decision | None:
        """The same reason twice in a row is said once."""
        self._begin(self._driving)
        last = self.decision
        if last is not None and (last.change, last.why) == (Change.REFUSED, why):
            return None
        return self._said(Change.REFUSED, why, sample)

    def _drive_with(self, shadow: Shadow, last: Shadow, change: Change, why: str, sample: Sample) -> Decision:
        self._driving, self._last = shadow, last
        self._begin(shadow)
        return self._said(change, why, sample)

    def _said(self, change: Change, why: str, sample: Sample) -> Decision:
        self.decisions.append(Decision(sample.time_s, change, why, self._figures))
        self._figures = {}
        return self.decisions[-1]
