"""Learning while driving: a sample goes to the estimator, what it learned to the supervisor, what proved itself to the
controller.
"""

import math

from cruise.control.controller import Controller
from cruise.control.proof import Proof, ProofSettings
from cruise.estimation.estimator import Estimator, EstimatorSettings, Learned
from cruise.estimation.supervision import Change, SupervisionSettings, Supervisor
from cruise.model.model import Model
from cruise.signals import Sample


class Learning:
    """`estimator` and `supervisor` of a `controller`."""

    def __init__(
        self,
        factory: Model,
        controller: Controller,
        estimator: EstimatorSettings,
        supervision: SupervisionSettings,
        proof: ProofSettings,
    ) -> None:
        self.controller = controller
        self.estimator = Estimator(factory, estimator)
        self.supervisor = Supervisor(factory, supervision, Proof(controller.settings, proof))

    def forget(self) -> None:
        """Back to the factory's model: what is learned, what drives, what it is compared with."""
        self.estimator.forget()
        self.supervisor.forget()
        self.controller.adopt(self.supervisor.driving)

    def learn(self, sample: Sample) -> Learned:
        """One sample of the model's period."""
        learned, before = self.estimator.learn(sample), self.estimator.applied
        if before is None or math.isnan(learned.predicted_mps):
            self.supervisor.restart()  # a hole in the samples
            return learned
        decision = self.supervisor.step(before, sample, self.estimator.snapshot)
        if decision is not None and decision.change is not Change.REFUSED:
            self.controller.adopt(self.supervisor.driving)
        return learned
