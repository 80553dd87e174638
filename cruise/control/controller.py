"""The speed controller: through the learned model, its delay and its inverse characteristic, to a current below 1 Hz.

At every model sample: the observer takes the measured speed in, the reference moves on, the predictive law plans the
drive signal, the command effects are inverted into a wanted current. At every frame: the shaper and the limits turn
it into the current that is sent. Engine speed and gear act through the model's own effects, so that nothing here is
scaled twice.
"""

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import msgspec
import numpy as np

from cruise.control.limits import Limits, LimitSettings
from cruise.control.observer import DisturbanceObserver, ObserverSettings
from cruise.control.predictive import Plan, PredictiveSettings, solve
from cruise.control.reference import Reference, ReferenceSettings
from cruise.control.shaping import CommandShaper
from cruise.model.model import DriveResponse, Model, ModelState
from cruise.settings import Positive, SettingsError
from cruise.signals import Sample


class ControlSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that decides how the machine is driven."""

    frame_s: Positive = 0.05  # s, period of the command frames
    shaping_hz: Positive = 1.2  # Hz, corner of each lag of the shaper
    shaping_order: Annotated[int, msgspec.Meta(ge=1, le=6)] = 2
    reference: ReferenceSettings = ReferenceSettings()
    observer: ObserverSettings = ObserverSettings()
    predictive: PredictiveSettings = PredictiveSettings()
    limits: LimitSettings = LimitSettings()


class LimitStatus(IntEnum):
    """ISO 11783-7, SPN 4307: what keeps the machine from the speed that it is asked for. Only those that we use."""

    NOT_LIMITED = 0
    LIMITED_HIGH = 2  # it can't go faster
    LIMITED_LOW = 3  # it can't go slower


@dataclass(frozen=True, slots=True)
class Command:
    """What is sent, and how it came about."""

    current_ma: float
    reference_mps: float
    disturbance_mps: float
    limited: str  # why the current is not the wanted one, or empty
    limit_status: LimitStatus = LimitStatus.NOT_LIMITED


NEUTRAL = Command(0.0, math.nan, math.nan, "")


class Controller:
    """Runs all the time: it watches while a person drives, so that it can take over without a bump."""

    def __init__(self, model: Model, settings: ControlSettings) -> None:
        self.settings = settings
        self.model = model
        self.frames = round(model.period_s / settings.frame_s)
        if self.frames < 1 or abs(self.frames * settings.frame_s - model.period_s) > 1e-9:
            raise SettingsError(
                f"control.frame_s: {settings.frame_s} s does not fit; "
                f"the model's period of {model.period_s} s must be a multiple of it"
            )
        self.horizon = max(round(settings.predictive.horizon_s / model.period_s), model.delay + model.nb)
        self.observer = DisturbanceObserver(model.na, model.period_s, settings.observer)
        self.reference = Reference(settings.reference)
        self.shaper = CommandShaper(settings.shaping_hz, settings.shaping_order, settings.frame_s)
        self.limits = Limits(settings.limits)
        self._from_states, self._from_wanted = self.shaper.response(self.frames, self.horizon)
        # Dead time of model and shaper: the reference that the machine can follow lies that much in the past.
        lag_s = settings.shaping_order / (2.0 * math.pi * settings.shaping_hz)
        self.lag = model.delay + round(lag_s / model.period_s)
        self.past_references = deque([0.0] * (self.lag + 1), maxlen=self.lag + 1)
        self.state: ModelState | None = None
        self.current_ma = math.nan  # as measured last
        self.wanted_ma = 0.0  # current that the shaper moves to
        self.plan: Plan | None = None
        self.engaged = False
        self.limited = ""

    def adopt(self, model: Model) -> None:
        """Drive with other parameters of the same structure from now on, without a bump."""
        if self.state is not None:
            self.observer.shift(float(self.model.next_speed(self.state) - model.next_speed(self.state)))
        self.model = model

    def step(self, sample: Sample | None, setpoint_mps: float | None) -> Command:
        """One frame: `sample` where a model period has just ended, `setpoint_mps` while engaged and None otherwise."""
        if sample is not None:
            self._watch(sample)
        if setpoint_mps is None:
            self.engaged = False
            self.limits.neutral()
            return NEUTRAL
        if self.state is None:  # nothing is known of the machine: the engagement will end this
            self.engaged = False
            self.limits.neutral()
            return Command(0.0, math.nan, math.nan, "no measurement")
        if not self.engaged:
            self._take_over()
        if sample is not None:
            self._plan(sample, setpoint_mps)
        shaped_ma = self.shaper.step(self.wanted_ma)
        current_ma = self.limits.step(shaped_ma, self.settings.frame_s)
        if current_ma != shaped_ma:
            self.shaper.reset(current_ma)
            self.limited = "current or its rate"
        return Command(
            current_ma, self.reference.speed_mps, self.observer.disturbance_mps, self.limited, self._limit_status()
        )

    def _limit_status(self) -> LimitStatus:
        limits = self.settings.limits
        if self.wanted_ma >= limits.current_max_ma:
            return LimitStatus.LIMITED_HIGH
        return LimitStatus.LIMITED_LOW if self.wanted_ma <= limits.current_min_ma else LimitStatus.NOT_LIMITED

    def _watch(self, sample: Sample) -> None:
        """Take a measured sample in, whoever drives."""
        model = self.model
        known = math.isfinite(sample.current_ma) and math.isfinite(sample.speed_mps) and model.usable(sample.signals)
        if not known:
            self.state = None
            return
        if self.state is None:
            self.state = model.start(sample.speed_mps, sample.current_ma, sample.signals)
            self.observer.reset(sample.speed_mps)
        self.state = model.apply(self.state, sample.current_ma, sample.signals)
        response = model.linearise(self.state, sample.signals)
        drives = self.state.drives[model.delay : model.delay + model.nb]
        known_mps = response.offset_mps + sum(b * v for b, v in zip(response.drive_coefficients, drives, strict=True))
        self.observer.step(response, known_mps, sample.speed_mps)
        self.state = model.observe(self.state, sample.speed_mps)
        self.current_ma = sample.current_ma

    def _take_over(self) -> None:
        """Begin where the machine is: its current, its speed."""
        self.engaged = True
        self.limits.take_over(self.current_ma)
        self.shaper.reset(self.limits.last_ma)
        self.wanted_ma = self.limits.last_ma
        speed_mps = self.observer.speeds_mps[0]
        self.reference.reset(speed_mps)
        self.past_references.extend([speed_mps] * (self.lag + 1))
        self.limited = ""

    def _plan(self, sample: Sample, setpoint_mps: float) -> None:
        model, state, settings = self.model, self.state, self.settings
        assert state is not None
        period_s, signals = model.period_s, sample.signals
        self.past_references.append(self.reference.step(setpoint_mps, period_s))
        coming = [*self.past_references, *self.reference.preview(setpoint_mps, period_s, self.horizon)]
        reference = np.array(coming[1 : 1 + self.horizon])
        response: DriveResponse = model.linearise(state, signals)
        if not response.dc_gain > 0.0:  # neutral gear, or no drive at this engine speed
            self.limited = "no drive"
            return
        free = response.free(self.observer.speeds_mps, state.drives, self.observer.disturbance_mps, self.horizon)
        forced = response.forced(self.horizon)
        in_shaper = np.array([model.drive_for(value, state, signals) for value in self.shaper.states_ma])
        limits = settings.limits
        bounds = tuple(
            model.drive_for(value, state, signals) for value in (limits.current_min_ma, limits.current_max_ma)
        )
        self.plan = solve(
            free + forced @ (self._from_states @ in_shaper),
            forced @ self._from_wanted,
            reference,
            self.observer.speeds_mps[0],
            model.drive_for(self.wanted_ma, state, signals),
            (bounds[0], bounds[1]),
            response.dc_gain,
            period_s,
            settings.predictive,
        )
        inverse = model.current_for(self.plan.wanted_ma, state, signals)
        wanted_ma = inverse.nearest(self.wanted_ma)
        self.limited = inverse.refused or ("" if self.plan.solved else "no plan found")
        if math.isfinite(wanted_ma):
            self.wanted_ma = min(max(wanted_ma, limits.current_min_ma), limits.current_max_ma)
