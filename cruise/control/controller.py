"""The speed controller: through the learned model, its delay and its inverse characteristic, to a current below 1 Hz.

At every frame: the observer takes the measured speed in, the reference moves on, the predictive law plans the drive,
the command effects are inverted into a wanted current, and shaper and limits turn it into the current that is sent.
The model is the learned one at the rate of the frames. What is measured acts through the model's own effects, so that
nothing here is scaled twice: engine speed and gear scale the drive, slope and load are known before they cost speed.
What looks at the speed is shown the observer's, which knows the commands; effects that look at the pitch are shown the
slope of the ground, which a pitch sensor doesn't show while the machine accelerates.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated, Final

import msgspec
import numpy as np

from cruise.control.frame_model import at_period, servo_of
from cruise.control.inversion import Inversion, InversionSettings
from cruise.control.limits import Limits, LimitSettings
from cruise.control.observer import DisturbanceObserver, ObserverSettings, rounded
from cruise.control.power import PowerGuard, PowerSettings
from cruise.control.predictive import Bounds, Now, Plan, PredictiveSettings, Programme
from cruise.control.reference import Reference, ReferenceSettings
from cruise.control.shaping import CommandShaper
from cruise.control.slope import SlopeObserver
from cruise.control.trend import Trend
from cruise.control.width import BelievedWidth
from cruise.effects import Effect
from cruise.effects.dead_zone import DeadZone
from cruise.effects.grade import Grade
from cruise.effects.power_limit import PowerLimit
from cruise.model.model import Model, ModelState
from cruise.settings import Positive, SettingsError
from cruise.signals import OUTPUT, Sample

BEYOND_MPS: Final = 0.2  # m/s beyond what the machine can do, where the reference stops: it wants more, and not behind
REACH_STEP_MPS: Final = 0.05  # m/s, steps of that end: it wavers with what is measured
AT_ITS_END_MPS: Final = 1e-4  # m/s, by which a plan that can't be met misses the end of what the drive gives
EDGE_MA: Final = 30.0  # mA, by how much the believed end of a dead zone may be off
IDLE_MA_PER_S: Final = 100.0  # mA/s, back to no current where the machine is too fast without any drive
LAW_STEPS: Final = 20.0  # per factor e, of poles and paces: those that differ by less share one programme


class ControlSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that decides how the machine is driven."""

    # s, period of the command frames and of the plans: checks look at 0.1 s, the drive waits 0.2 s for a command; no
    # message comes more often than every 0.01 s, and a plan takes its time
    frame_s: Annotated[float, msgspec.Meta(ge=0.01, le=0.1)] = 0.05
    shaping_hz: Positive = 2.0  # Hz, corner of each lag of the shaper
    shaping_order: Annotated[int, msgspec.Meta(ge=1, le=6)] = 2
    reference: ReferenceSettings = ReferenceSettings()
    observer: ObserverSettings = ObserverSettings()
    predictive: PredictiveSettings = PredictiveSettings()
    inversion: InversionSettings = InversionSettings()
    power: PowerSettings = PowerSettings()
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
    disturbance_mps: float  # of steady speed
    limited: str  # why the current is not the wanted one, or empty
    limit_status: LimitStatus = LimitStatus.NOT_LIMITED


def _as_driven(effect: Effect, shown: float) -> Effect:
    """The effect for a pitch that is the ground's: lag and acceleration, of which `shown` was seen, are taken out.

    A dead zone gets an edge: no machine's is sharp where the model's is, and beside a corner the speed would swing.
    """
    if isinstance(effect, DeadZone):
        return effect.reshaped(edge_ma=max(effect.edge_ma, EDGE_MA))
    if isinstance(effect, Grade):
        return effect.reshaped(filter_s=0.0, acceleration_share=0.0)
    if isinstance(effect, PowerLimit):
        return effect.reshaped(acceleration_share=effect.acceleration_share - shown)
    return effect


NEUTRAL = Command(0.0, math.nan, math.nan, "")


class Controller:
    """Runs all the time: it watches while a person drives, so that it can take over without a bump."""

    def __init__(self, model: Model, settings: ControlSettings) -> None:
        self.settings = settings
        self.frame_s = settings.frame_s
        self.frames = round(model.period_s / self.frame_s)  # in a period of the model
        if self.frames < 1 or abs(self.frames * self.frame_s - model.period_s) > 1e-9:
            raise SettingsError(
                f"control.frame_s: {self.frame_s} s does not fit; "
                f"the model's period of {model.period_s} s must be a multiple of it"
            )
        self.observer = DisturbanceObserver(self.frame_s, settings.observer)
        self.reference = Reference(settings.reference)
        self.shaper = CommandShaper(settings.shaping_hz, settings.shaping_order, self.frame_s)
        self.limits = Limits(settings.limits)
        self.power = PowerGuard(settings.power, self.frame_s)
        self.inversion = Inversion(settings.inversion, self.frame_s)
        self.trend = Trend(settings.predictive.trend_s, self.frame_s)
        self.slope: SlopeObserver | None = None  # where the model knows slopes
        self.state: ModelState | None = None
        self.signals: Mapping[str, float] = {}  # with the observer's speed, and the slope of the ground
        self.pace = 1.0  # by which its gear slows the drive, at most 1
        self.current_ma = math.nan  # as measured last
        self.wanted_ma = 0.0  # current that the shaper moves to
        self.wanted_mps = 0.0  # what drive and loads shall give together
        self.plan: Plan | None = None
        self.engaged = False
        self.limited = ""
        self._sent_ma = 0.0
        self.width = BelievedWidth(model)
        self.past_references: deque[float] = deque([0.0])
        self.reach_mps = 0.0, math.inf  # least and greatest that the drive gives, in m/s of steady speed
        self.most_mps = math.inf  # that the machine can do as it is, with loads and what the model does not explain
        self._drive_with(model)
        self.pole = self._pole  # as its pace changes it

    @property
    def model(self) -> Model:
        """What it drives with: the adopted model at the rate of the frames, with the width that is believed."""
        return self.width.model

    @property
    def upset(self) -> bool:
        """Whether what is kept twice is no longer the same: nothing in the program did that."""
        return self.observer.upset or (self.engaged and self.limits.last_ma != self._sent_ma)

    @property
    def asked_mps(self) -> float:
        """The reference as the operator moves it; NaN while it gives way to what engine or drive can bear."""
        return math.nan if self.power.limiting else self.reference.speed_mps

    @property
    def coming_mps(self) -> tuple[float, ...]:
        """By how much the currents on their way will change the speed in each of the next frames, by the model."""
        state, delay = self.state, self.model.delay
        if state is None:
            return ()
        pole = self.observer.pole(self.pole, self._stroke_yielding(state.drives))
        ahead_mps = self._load_mps(state) + self.observer.disturbance_mps - self.observer.speed_mps
        changes, changed_mps = [], 0.0
        on_their_way = state.drives[: delay + len(self._share) - 1]  # v_k is felt in delay frames for the first time
        for drive_ma in np.correlate(on_their_way, self._share)[::-1].tolist() if delay else ():
            step_mps = (1.0 - pole) * (self._gain * state.gain * drive_ma + ahead_mps - changed_mps)
            changed_mps += step_mps
            changes.append(step_mps)
        return tuple(changes)

    @property
    def coming_mps2(self) -> float:
        """The greatest acceleration that they will cause, which no command can undo."""
        return max(map(abs, self.coming_mps), default=math.nan) / self.frame_s

    def adopt(self, model: Model) -> None:
        """Drive with other parameters of the same structure from now on, without a bump."""
        before_mps = self._steady_mps() if self.state is not None else 0.0
        self._drive_with(model)
        self.trend.restart()
        if self.state is not None:
            self.state = self._resized(self.state)
            more_mps = self._steady_mps() - before_mps
            self.observer.shift(-more_mps)
            self.wanted_mps += more_mps

    def step(self, sample: Sample, setpoint_mps: float | None, gently: bool = False) -> Command:
        """One frame: `sample` the means over it, `setpoint_mps` while it drives; `gently` while it takes over."""
        self._watch(sample)
        if setpoint_mps is None or self.state is None:
            self.engaged = False
            self.limits.neutral()
            return NEUTRAL if setpoint_mps is None else Command(0.0, math.nan, math.nan, "no measurement")
        if not self.engaged:
            self._take_over()
        engine_rpm, bar = (sample.signals.get(name, math.nan) for name in ("engine_speed_rpm", "line_pressure_bar"))
        bearable_mps = self.power.step(engine_rpm, bar, self.observer.speed_mps, setpoint_mps)
        self._plan(self.state, bearable_mps, gently)
        if bearable_mps < setpoint_mps:
            self.limited = "engine or drive at its limit"
        shaped_ma = self.shaper.step(self.wanted_ma)
        current_ma = self.limits.step(shaped_ma, self.frame_s)
        if current_ma != shaped_ma:
            self.shaper.reset(current_ma)
            self.limited = "current or its rate"
        self._sent_ma = current_ma
        return Command(
            current_ma, self.reference.speed_mps, self.observer.disturbance_mps, self.limited, self._limit_status()
        )

    def _drive_with(self, model: Model) -> None:
        self.adopted = model
        share = next((effect.acceleration_share for effect in model.effects if isinstance(effect, Grade)), None)
        effects = tuple(_as_driven(effect, share or 0.0) for effect in model.effects)
        fast = at_period(replace(model, effects=effects), self.frame_s)
        self.width.adopt(fast)
        (self._pole,), b, *_ = fast.split(fast.theta)
        self._gain = fast.dc_gain_mps_per_ma
        self._share = np.array(b) / sum(b)
        self._servo = servo_of(fast)
        self._programmes: dict[tuple[int, int], Programme] = {}
        if share != (self.slope and self.slope.acceleration_share):
            self.slope = (
                None if share is None else SlopeObserver(share, self.frame_s, self.settings.observer.speed_noise_mps)
            )
        # The reference that the machine can follow lies the dead time in the past; lags are led.
        late = max(fast.delay - round(self.settings.predictive.lead_s / self.frame_s), 0)
        past = (*self.past_references,)
        self.past_references = deque((*past[:1] * (late + 1), *past), maxlen=late + 1)

    def _resized(self, state: ModelState) -> ModelState:
        """The state for the delay and the taps of the present model."""
        depth = self.model.delay + self.model.nb
        drives = (*state.drives, *[state.drives[-1]] * depth)[:depth]
        return state._replace(drives=drives)

    def _steady_mps(self) -> float:
        """The steady speed that drive and loads as felt now give by the model."""
        assert self.state is not None
        return self._felt_mps(self.state, self.state.drives) + self._load_mps(self.state)

    def _felt_mps(self, state: ModelState, drives_ma: Sequence[float] | np.ndarray) -> float:
        return self._gain * state.gain * float(self._share.dot(drives_ma[self.model.delay :]))

    def _load_mps(self, state: ModelState) -> float:
        a, _, loads, c_0 = self.model.split(self.model.theta)
        return (c_0 + sum(c * phi for c, phi in zip(loads, state.loads, strict=True))) / (1.0 - a[0])

    def _stroke_yielding(self, drives_ma: Sequence[float]) -> float:
        """How far the drive yields at its stroke, beside what the gear does."""
        return self.model.yielding(drives_ma, self.signals) / self.model.gear_yielding(self.signals)

    def _limit_status(self) -> LimitStatus:
        low_mps, high_mps = self.reach_mps
        wanted_mps = self.plan.wanted_mps if self.plan is not None else math.nan
        if wanted_mps >= high_mps - AT_ITS_END_MPS or self.power.limiting:
            return LimitStatus.LIMITED_HIGH
        return LimitStatus.LIMITED_LOW if wanted_mps <= low_mps + AT_ITS_END_MPS else LimitStatus.NOT_LIMITED

    def _watch(self, sample: Sample) -> None:
        """Take a measured sample in, whoever drives."""
        self.power.watch(*(sample.signals.get(name, math.nan) for name in ("engine_load_pct", "engine_speed_rpm")))
        model = self.model
        known = math.isfinite(sample.current_ma) and math.isfinite(sample.speed_mps) and model.usable(sample.signals)
        if not known:
            self.state = None
            return
        if self.state is None:
            self.state = model.start(sample.speed_mps, sample.current_ma, sample.signals)
            self.observer.reset(sample.speed_mps)
            self.width.restart()
            self.trend.restart()
            if self.slope is not None:
                self.slope.restart()
        signals = {**sample.signals, OUTPUT: self.observer.speed_mps}
        if self.slope is not None:
            signals["pitch_deg"] = self.slope.step(signals["pitch_deg"], self.observer.speed_mps, self.pace)
        self.signals = signals
        state = model.apply(self.state, sample.current_ma, signals)
        # Equation 12 at the period of the frames: at that of the model it would be half a time constant too slow.
        pace = model.usual_pace(state, signals)
        self.pole, self.pace = 1.0 - pace * (1.0 - self._pole), min(pace, 1.0)
        load_mps = self._load_mps(state)
        self.trend.step(state.gain, load_mps)
        self.width.step(self.state, state, sample.current_ma, signals)
        steady_mps, width_mps = (self._felt_mps(state, drives) for drives in (state.drives, self.width.drives_ma))
        yielding = self._stroke_yielding(state.drives)
        self.observer.step(self.pole, steady_mps + load_mps, sample.speed_mps, self.pace, width_mps, yielding)
        self.state = self.width.believe(self.observer.width_share, model.observe(state, self.observer.speed_mps))
        self.current_ma = sample.current_ma

    def _take_over(self) -> None:
        """Begin where the machine is: its current, its speed."""
        self.engaged = True
        self.power.restart()
        self.inversion.restart()
        self.limits.take_over(self.current_ma)
        self.shaper.reset(self.limits.last_ma)
        self.wanted_ma = self.limits.last_ma
        assert self.state is not None
        drive_ma = self.model.drive_for(self.wanted_ma, self.state, self.signals)
        self.wanted_mps = self._gain * self.state.gain * drive_ma + self._load_mps(self.state)
        speed_mps = self.observer.speed_mps
        self.reference.reset(speed_mps)
        self.past_references.extend([speed_mps] * len(self.past_references))
        self.limited, self.plan, self.most_mps = "", None, math.inf

    def _programme(self, state: ModelState) -> Programme:
        """The law for the pole that the drive is about to have, in its gear, made when it is met first."""
        pole = self.observer.pole(self.pole, self._stroke_yielding(state.drives[:1] * len(state.drives)))
        key = rounded(pole, self.pace, LAW_STEPS)
        found = self._programmes.get(key)
        if found is None:
            settings = self.settings.predictive
            found = Programme(
                pole, self._share, self.model.delay, self.shaper, self.frame_s, settings, self.pace, self._servo.lag_s
            )
            self._programmes[key] = found
        return found

    def _trend_mps2(self) -> float:
        """At which rate what is measured moves the speed; an engine freed of its load goes back to its own speed."""
        speed_mps = self.observer.speed_mps
        believed_mps2 = self.trend.rate_mps2(speed_mps, self.observer.calm)
        regains = self.power.regains(self.signals.get("engine_speed_rpm", math.nan))
        if regains is None:
            return believed_mps2
        return min(believed_mps2, regains * abs(speed_mps) / self.settings.predictive.believed_s)

    def _within_reach_mps(self) -> float:
        """What the reference may move to: from farther beyond what the machine can do it would come back too late."""
        most_mps = self.most_mps + BEYOND_MPS
        return max(math.floor(most_mps / REACH_STEP_MPS) * REACH_STEP_MPS, 0.0) if math.isfinite(most_mps) else math.inf

    def _plan(self, state: ModelState, setpoint_mps: float, gently: bool) -> None:
        model, settings, signals = self.model, self.settings, self.signals
        setpoint_mps = min(setpoint_mps, self._within_reach_mps())
        self.past_references.append(self.reference.step(setpoint_mps, self.frame_s))
        if not state.gain > 0.0:  # neutral gear, or no drive at this engine speed
            self.limited = "no drive"
            return
        believed, load_mps = self.trend.believed(self.observer.calm)
        gain = self._gain * believed
        programme = self._programme(state)
        coming = [*self.past_references, *self.reference.preview(setpoint_mps, self.frame_s, programme.count)]
        reference = np.array(coming[1 : 1 + programme.count])
        limits = settings.limits

        def steady_mps(current_ma: float) -> float:
            return gain * model.drive_for(current_ma, state, signals)

        now = Now(
            self.observer.speed_mps,
            gain * np.array(state.drives),
            np.array([steady_mps(value) for value in self.shaper.states_ma]),
            load_mps + self.observer.disturbance_mps,
            self._trend_mps2(),
            self.wanted_mps - load_mps,
        )
        low, high = self.reach_mps = steady_mps(limits.current_min_ma), steady_mps(limits.current_max_ma)
        self.most_mps = high + load_mps + self.observer.disturbance_mps
        slope = (high - low) / (limits.current_max_ma - limits.current_min_ma)
        servo_ma_per_s = self._servo.rate_ma_per_s
        rise = slope * min(limits.rate_max_ma_per_s, servo_ma_per_s)
        fall = slope * min(limits.rate_max_ma_per_s, servo_ma_per_s * self._servo.return_share)
        share = settings.predictive.engaging_share if gently else 1.0
        quicker = self.observer.quicker()  # a plan for a slow drive asks for much, and a quick one gives it
        self.plan = programme.solve(now, reference, Bounds(low, high, rise, fall, share, 1.0 / quicker))
        self.wanted_mps = self.plan.wanted_mps + load_mps
        inverse = self.inversion.step(model, self.plan.wanted_mps / gain, state, signals)
        wanted_ma = inverse.nearest(self.wanted_ma)
        if self.plan.wanted_mps <= low + AT_ITS_END_MPS:  # any current of a dead zone would do: slowly to its middle
            wanted_ma = min(wanted_ma, self.wanted_ma) - IDLE_MA_PER_S * self.frame_s
        self.limited = inverse.refused or ("" if self.plan.solved else "no plan found")
        if math.isfinite(wanted_ma):
            self.wanted_ma = min(max(wanted_ma, limits.current_min_ma), limits.current_max_ma)
