"""Who drives: the baseline, the predictive controller with one model or another, and what none can beat.

Without measured feed-forward a driver sees gear and drive only: every other signal stands still at a plain value. The
PID is one of those, and so is the predictive controller of the second column.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from cruise.control.controller import Controller, ControlSettings
from cruise.effects.grade import Grade
from cruise.model.model import Model
from cruise.report.colours import BLUE
from cruise.signals import Sample

from .drive import Driver
from .pid import Pid

PLAIN: Final[Mapping[str, float]] = {
    "engine_speed_rpm": 2100.0,
    "pitch_deg": 0.0,
    "machine_mass_kg": 16000.0,
    "oil_temperature_c": 50.0,
    "engine_load_pct": 20.0,
    "line_pressure_bar": 50.0,
}
EXACT_MPS: Final = 0.001  # m/s, noise of a speed that has none


@dataclass(frozen=True)
class Models:
    """The three models of one machine."""

    factory: Model
    learned: Model
    exact: Model  # from data without noise and delay


@dataclass(frozen=True)
class Kind:
    """One column of the tables."""

    title: str
    colour: str  # in the picture
    make: Callable[[Models, ControlSettings], Driver]
    noisy: bool = True  # sensors


class Predictive:
    """The project's controller as a driver; `plain` are signals that it is not shown."""

    def __init__(self, model: Model, settings: ControlSettings, plain: Mapping[str, float] | None = None) -> None:
        self.plain = plain or {}
        self.controller = Controller(_level(model) if plain else model, settings)

    def step(self, sample: Sample, setpoint_mps: float | None) -> float:
        """One frame."""
        return self.controller.step(_blind(sample, self.plain), setpoint_mps).current_ma


class BlindPid(Pid):
    """The PID, to which nothing is fed forward but reference and gear.

    It keeps the model's grade: what that takes for slope while the machine accelerates is a further derivative to it,
    without which it is a fifth worse.
    """

    def step(self, sample: Sample, setpoint_mps: float | None) -> float:
        """One frame."""
        return super().step(_blind(sample, PLAIN), setpoint_mps)


def _blind(sample: Sample, plain: Mapping[str, float]) -> Sample:
    return replace(sample, signals={**sample.signals, **plain}) if plain else sample


def _level(model: Model) -> Model:
    """The model for a pitch that stands still: no acceleration is in it that would have to be taken out."""
    effects = (one.reshaped(acceleration_share=0.0) if isinstance(one, Grade) else one for one in model.effects)
    return replace(model, effects=tuple(effects))


def _exact(models: Models, settings: ControlSettings) -> Driver:
    observer = msgspec.structs.replace(settings.observer, speed_noise_mps=EXACT_MPS)
    return Predictive(models.exact, msgspec.structs.replace(settings, observer=observer))


DRIVERS: Final[dict[str, Kind]] = {
    "pid": Kind("PID (SIMC)", "#c44e52", lambda models, settings: BlindPid(models.learned, settings)),
    "pid_factory": Kind("PID, factory model", "#e7a3a6", lambda models, settings: BlindPid(models.factory, settings)),
    "pid_1hz": Kind(
        "PID held to 1 Hz", "#937860", lambda models, settings: BlindPid(models.learned, settings, held=True)
    ),
    "factory": Kind("factory model", "#dd8452", lambda models, settings: Predictive(models.factory, settings)),
    "plain": Kind(
        "learned, no feed-forward", "#55a868", lambda models, settings: Predictive(models.learned, settings, PLAIN)
    ),
    "learned": Kind("learned", BLUE, lambda models, settings: Predictive(models.learned, settings)),
    "bound": Kind("bound", "#8172b3", _exact, noisy=False),
}
