"""One model in the shadow of the drive: its 3 s ahead error, from residuals that are one sample old.

    e_i = alpha sum_j a_j e_(i-j) + (1 - alpha) e_(i-1) + r_i - d,   i = k-h+1 .. k,   e_(k-h) = 0
    E_k = E_(k-1) + (T / W) (e_k^2 - E_(k-1)),   RMS = sqrt(E)

e_k = y_k - y_k|k-h error of the free run from h samples ago with the measured currents and signals, r residual one
step ahead, d what was known of it h samples ago: a running mean of r, as the observer would carry it; alpha pace of the
gears, T period, W window. A free run costs h times a few products this way; effects that look at the speed are shown
the measured one. Judged by predictions, not by parameters: below 1 Hz the single b_j can't be told apart.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import mul

from cruise.model.model import Model, ModelState
from cruise.signals import Sample

Passed = tuple[ModelState, Sample]
"""A sample, and the model's state once its current was applied and before its speed was observed."""


@dataclass(frozen=True, slots=True)
class Horizon:
    """How far ahead a model is judged, and over which times the means run."""

    samples: int  # h
    window: float  # T / W
    disturbance: float  # share of a residual that is taken for lasting


class Shadow:
    """`model`, judged sample by sample; `mean_square` runs, `proof` is the sum since it was made."""

    def __init__(
        self, model: Model, horizon: Horizon, past: Sequence[Passed] = (), like: "Shadow | None" = None
    ) -> None:
        """A model that takes the place of `like` in the shadow has its running mean, with residuals of its own."""
        self.model = model
        self.horizon = horizon
        self._residuals = deque((self._residual(one) for one in past), maxlen=horizon.samples)
        self._disturbances: deque[float] = deque(like._disturbances if like else (), maxlen=horizon.samples + 1)
        self.mean_square = like.mean_square if like else math.nan
        self.proof = 0.0

    @property
    def rms_mps(self) -> float:
        """Running RMS error; NaN before anything was judged."""
        return math.sqrt(self.mean_square)

    def restart(self) -> None:
        """Forget the way here, after a hole in the samples; the mean stays."""
        self._residuals.clear()
        self._disturbances.clear()

    def step(self, passed: Passed, counts: bool, void: bool = False) -> None:
        """One sample on; `counts` where it is a part of the proof, `void` where it says nothing about a model.

        What was known of d stays over void samples, and no e_k reaches over one.
        """
        residual = self._residual(passed)
        self._residuals.append(residual)
        known = self._disturbances[-1] if self._disturbances else 0.0
        if void:
            self._disturbances.clear()
        else:
            known += self.horizon.disturbance * (residual[0] - known)
        self._disturbances.append(known)
        if len(self._disturbances) <= self.horizon.samples:
            return
        square = self._error_mps() ** 2
        self.proof += square if counts else 0.0
        share = 1.0 if math.isnan(self.mean_square) else self.horizon.window
        self.mean_square = square if share == 1.0 else self.mean_square + share * (square - self.mean_square)

    def _residual(self, passed: Passed) -> tuple[float, float]:
        before, sample = passed
        return float(sample.speed_mps - self.model.next_speed(before)), float(before.pace)

    def _error_mps(self) -> float:
        """e_k."""
        a, *_ = self.model.split(self.model.theta)
        known = self._disturbances[0]
        errors = deque([0.0] * max(len(a), 1), maxlen=max(len(a), 1))  # newest first
        for residual, pace in self._residuals:
            errors.appendleft(pace * sum(map(mul, a, errors)) + (1.0 - pace) * errors[0] + residual - known)
        return errors[0]
