"""What every identified model can do, whatever its family, and how the linear ones predict.

ARX, ARMAX and output error share one core, a `Model` with its effects; they differ in the error that they minimise and
in how they predict. NARX has polynomials in place of effects. All of them meet `Identified`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from cruise.identification.regressors import FitError, Smooth, checked_signals, smoothed_runs
from cruise.model import prediction
from cruise.model.model import Model
from cruise.model.prediction import Driven
from cruise.recording import Recording


class Identified(Protocol):
    """A model that was fitted to recordings.

    `smooth`, where given, filters what drives the model during the prediction (after the effects, zero phase); the
    measured speeds stay as they are.
    """

    @property
    def period_s(self) -> float:
        """The sampling period of the model."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """The signals beside current and speed that a recording must hold."""
        ...

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `theta`, with units."""
        ...

    @property
    def theta(self) -> tuple[float, ...]:
        """The linear parameters."""
        ...

    @property
    def theta_std(self) -> tuple[float, ...]:
        """Their standard errors, which hold for coloured residuals."""
        ...

    @property
    def residual_std_mps(self) -> float:
        """Standard deviation of the error that the fit minimised."""
        ...

    @property
    def converged(self) -> bool:
        """Whether the search for the parameters came to its end."""
        ...

    @property
    def message(self) -> str:
        """How the fit went, in words."""
        ...

    @property
    def poles(self) -> np.ndarray:
        """Poles of the predictor in the z plane."""
        ...

    @property
    def unstable(self) -> str:
        """Why predictions of this model run away; empty where they don't."""
        ...

    def ahead(self, recording: Recording, horizon: int, smooth: Smooth | None = None) -> np.ndarray:
        """The speed (N,) in m/s at every sample as predicted `horizon` samples before, NaN where no start was."""
        ...

    def free_run(self, recording: Recording, smooth: Smooth | None = None) -> np.ndarray:
        """The model's own speeds (N,) in m/s from the first samples on, begun again after holes."""
        ...


@dataclass(frozen=True)
class Linear:
    """What ARX, ARMAX and output error have in common: a core that can be saved and driven with. Meets `Identified`."""

    model: Model
    message: str
    converged: bool = True

    @property
    def period_s(self) -> float:
        """The sampling period of the model."""
        return self.model.period_s

    @property
    def needs(self) -> tuple[str, ...]:
        """The signals beside current and speed that a recording must hold."""
        return self.model.needs

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """a_1.., b_0.., the load effects, c_0."""
        return self.model.parameter_names

    @property
    def theta(self) -> tuple[float, ...]:
        """The linear parameters."""
        return self.model.theta

    @property
    def theta_std(self) -> tuple[float, ...]:
        """Their standard errors."""
        return self.model.theta_std

    @property
    def residual_std_mps(self) -> float:
        """Standard deviation of the error that the fit minimised."""
        return self.model.residual_std_mps

    @property
    def poles(self) -> np.ndarray:
        """Poles of the predictor in the z plane."""
        return self.model.poles

    @property
    def unstable(self) -> str:
        """Which poles make predictions run away; empty where none does."""
        return why_unstable(self.poles)

    def ahead(self, recording: Recording, horizon: int, smooth: Smooth | None = None) -> np.ndarray:
        """The speed (N,) in m/s at every sample as predicted `horizon` samples before, restarted at every sample."""
        return ahead(self.model, recording, horizon, smooth)

    def free_run(self, recording: Recording, smooth: Smooth | None = None) -> np.ndarray:
        """The model's own speeds (N,) in m/s from the first samples on, begun again after holes."""
        return free_run(self.model, recording, smooth)


def why_unstable(poles: np.ndarray) -> str:
    """Which poles lie on or outside the unit circle, in words; empty where none does."""
    out = sorted((pole for pole in poles if abs(pole) >= 1.0 and pole.imag >= 0.0), key=abs, reverse=True)
    named = [
        f"pole at {pole.real:.4g}" if pole.imag == 0.0 else f"pair of poles at {pole.real:.4g} +- {pole.imag:.4g}j"
        for pole in out
    ]
    return ", ".join(named)


def split_over(model: Model, recording: Recording, smooth: Smooth | None) -> Driven | None:
    """The model over a recording as what past speeds do and what the rest does, filtered; None if effects read speed.

    Raises FitError where they do and a filter is wanted: what is filtered then is not known before the prediction.
    """
    signals = checked_signals(model, recording)
    state = prediction.states_over(model, recording.input, recording.output, signals)
    if model.reads_speed:
        if smooth is not None:
            names = ", ".join(effect.name for effect in model.effects)
            raise FitError(f"an effect of {names} reads the speed: the input can't be filtered before the prediction")
        return None
    split = prediction.driven(model, state, len(recording))
    return split if smooth is None else replace(split, forced=smoothed_runs(split.forced, smooth))


def ahead(
    model: Model, recording: Recording, horizon: int, smooth: Smooth | None = None, noise: Sequence[np.ndarray] = ()
) -> np.ndarray:
    """`Identified.ahead` of a linear core; `noise[m - 1]` (N,) is what a noise model adds m samples ahead."""
    split = split_over(model, recording, smooth)
    with np.errstate(over="ignore", invalid="ignore"):
        if split is not None:
            return prediction.ahead_driven(split, recording.output, horizon, noise)
        signals = checked_signals(model, recording)
        state = prediction.states_over(model, recording.input, recording.output, signals)
        return prediction.ahead_stepwise(model, state, recording.input, recording.output, signals, horizon, noise)


def free_run(model: Model, recording: Recording, smooth: Smooth | None = None) -> np.ndarray:
    """`Identified.free_run` of a linear core."""
    split = split_over(model, recording, smooth)
    with np.errstate(over="ignore", invalid="ignore"):
        if split is not None:
            return prediction.run_driven(split, recording.output)
        signals = checked_signals(model, recording)
        return prediction.free_run(model, recording.input, recording.output, signals)
