"""The driver that learns while it drives: the service's own estimator, supervisor and controller, frame by frame."""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from cruise.control.controller import Command, Controller, ControlSettings
from cruise.control.proof import ProofSettings
from cruise.estimation.estimator import EstimatorSettings
from cruise.estimation.supervision import Decision, SupervisionSettings
from cruise.model.model import Model
from cruise.service.learning import Learning
from cruise.signals import Sample


class Watched(Controller):
    """A controller that knows what it would have sent without the new model: `bumps_ma` are the differences."""

    def __init__(self, model: Model, settings: ControlSettings) -> None:
        self.bumps_ma: list[float] = []
        self._twin: Self | None = None
        super().__init__(model, settings)

    def adopt(self, model: Model) -> None:
        """Another model from now on."""
        self._twin = self._copied() if self.engaged else None
        super().adopt(model)

    def step(self, sample: Sample, setpoint_mps: float | None, gently: bool = False) -> Command:
        """One frame."""
        command, twin = super().step(sample, setpoint_mps, gently), self._twin
        if twin is not None and setpoint_mps is not None:
            self._twin = None
            self.bumps_ma.append(command.current_ma - twin.step(sample, setpoint_mps, gently).current_ma)
        return command

    def _copied(self) -> Self:
        twin = copy.copy(self)
        twin.__dict__ = {name: {} if name == "_programmes" else copy.deepcopy(one) for name, one in vars(self).items()}
        return twin


class Adaptive:
    """Begins with the factory's model; `samples`, of the model's period, taught it, and `decisions` came of that."""

    def __init__(
        self,
        factory: Model,
        control: ControlSettings,
        supervision: SupervisionSettings | None = None,
        proof: ProofSettings | None = None,
    ) -> None:
        self.controller = Watched(factory, control)
        self.learning = Learning(
            factory,
            self.controller,
            EstimatorSettings(),
            supervision or SupervisionSettings(),
            proof or ProofSettings(),
        )
        self.samples: list[Sample] = []
        self.decisions: list[Decision] = []
        self._frames: list[Sample] = []

    def step(self, sample: Sample, setpoint_mps: float | None) -> float:
        """One frame."""
        if self._frames and sample.time_s < self._frames[-1].time_s:
            self._frames = []
        self._frames.append(sample)
        if len(self._frames) == self.controller.frames:
            self.samples.append(mean(self._frames, self.controller.reference.speed_mps))
            self._frames = []
            self.learning.learn(self.samples[-1])
            last = self.learning.supervisor.decision
            if last is not None and (not self.decisions or self.decisions[-1] is not last):
                self.decisions.append(last)
        return self.controller.step(sample, setpoint_mps).current_ma


def mean(frames: Sequence[Sample], reference_mps: float) -> Sample:
    """The frames as one sample of the model's period."""
    last = frames[-1]
    signals = {name: math.fsum(one.signals[name] for one in frames) / len(frames) for name in last.signals}
    return replace(
        last,
        current_ma=float(np.mean([one.current_ma for one in frames])),
        speed_mps=float(np.mean([one.speed_mps for one in frames])),
        signals={**signals, "gear": last.signals["gear"]},
        reference_mps=reference_mps,
    )
