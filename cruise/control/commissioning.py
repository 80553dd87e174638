"""Commissioning: an experiment that the operator chose drives the pump, within limits of its own.

What bounds the harm while the current jumps at 20 Hz is not its rate (that limit only keeps it to the pump's whole
stroke a frame) and not a predicted acceleration (there is no model yet to predict with). It is, in this order: the
operator, whose pedals, lever, switch and held request end it within a frame; the range of the current, and with it the
steady speed in the gear that the experiment was written for; the pump itself, whose servo turns any step into a stroke
of 0.5 to 1.5 s; the measured speed, beyond which it ends; the duration; and that it begins near standstill, gently.
"""

from collections.abc import Sequence
from enum import IntEnum
from itertools import combinations
from typing import Annotated

import msgspec

from cruise.control.excitation import ROUNDING, Excitation, Kind, Phase
from cruise.control.limits import Limits, LimitSettings
from cruise.settings import Positive, SettingsError

Number = Annotated[int, msgspec.Meta(ge=1, le=250)]  # a byte on the bus; 0 asks for none, above 250 is no measurement
Gear = Annotated[int, msgspec.Meta(ge=1, le=4)]


class Conditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Under which the experiment is driven; but for the gear it is the engineer who sees to them on a real machine."""

    gear: Gear = 2  # the paper: 2nd is for harvesting
    machine_mass_kg: Annotated[float, msgspec.Meta(ge=5000, le=40000)] = 15700.0  # kg, the paper: 15700, 17200, 18800
    grade_deg: Annotated[float, msgspec.Meta(ge=-15, le=15)] = 0.0  # deg, + uphill; the paper: -3.5 to +4.4
    engine_speed_rpm: Annotated[float, msgspec.Meta(ge=800, le=2600)] = 2100.0  # 1/min, the paper: maximum; 1300..2100
    rolling_resistance: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.02  # -, ASAE D497: 0.02 on concrete


class Experiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One experiment: what the pump is given, under which conditions, and where it has to end."""

    name: str
    number: Number  # by which the panel asks for it
    excitation: Kind
    speed_max_mps: Positive  # m/s, measured speed beyond which it ends
    conditions: Conditions = Conditions()
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    lead_s: Positive = 5.0  # s, from neutral to the first current and back at the end: 2..10
    settle_s: Positive = 5.0  # s, at the first current; ten time constants of the drive: 3..20

    @property
    def duration_s(self) -> float:
        """From the press of the button to the pump's neutral."""
        return self.settle_s + self.excitation.duration_s + 2.0 * self.lead_s

    def current(self) -> Excitation:
        """The whole current. Equal experiments give equal currents; other numbers or seeds give others."""
        return Excitation.of(self.excitation, (self.number, self.seed), self.lead_s, self.settle_s)


class Experiments(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A file of experiments."""

    experiments: tuple[Experiment, ...]

    def __post_init__(self) -> None:
        for one, other in combinations(self.experiments, 2):
            if one.number == other.number or one.name == other.name:
                raise ValueError(f"{one.name} ({one.number}) and {other.name} ({other.number}) share name or number")


class CommissioningLimits(LimitSettings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the pump may be asked for by an experiment."""

    rate_max_ma_per_s: Positive = 24000.0  # mA/s, the whole range in one frame of 0.05 s: white noise has to pass


class CommissioningSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Within what experiments may be driven. Without these settings the service drives none."""

    experiments: str  # file of the experiments
    limits: CommissioningLimits = CommissioningLimits()
    speed_max_mps: Positive = 8.5  # m/s, that no experiment's own limit may exceed; just over 30 km/h
    duration_max_s: Annotated[float, msgspec.Meta(gt=0.0, le=6400.0)] = (
        1200.0  # s, of one experiment; 20 minutes are a long time to hold a track free
    )
    start_speed_max_mps: Positive = 0.3  # m/s, at which one may begin: standstill, or creeping on a slope
    lever_rest_pct: Positive = 3.0  # %, within which the lever is at rest: after the end nothing drives


def check(experiments: Sequence[Experiment], settings: CommissioningSettings, frame_s: float) -> None:
    """Raise SettingsError, one line a problem, where an experiment would not come out as it is written."""
    problems = [problem for experiment in experiments for problem in _problems(experiment, settings, frame_s)]
    if problems:
        raise SettingsError("\n".join(f"{settings.experiments}: {problem}" for problem in problems))


def _problems(experiment: Experiment, settings: CommissioningSettings, frame_s: float) -> list[str]:
    limits, signal, name = settings.limits, experiment.excitation, experiment.name
    low_ma, high_ma = signal.range_ma
    reach_ma = limits.rate_max_ma_per_s * frame_s
    problems = []
    if high_ma > limits.current_max_ma or low_ma < limits.current_min_ma:
        problems.append(
            f"{name}: {low_ma:g} to {high_ma:g} mA is not within commissioning.limits, "
            f"{limits.current_min_ma:g} to {limits.current_max_ma:g} mA; change the one or the other"
        )
    if (jump_ma := signal.jump_ma(frame_s)) > reach_ma * (1.0 + ROUNDING):
        problems.append(
            f"{name}: changes by {jump_ma:g} mA a frame, commissioning.limits let {reach_ma:g} mA pass; "
            "raise rate_max_ma_per_s or narrow the range"
        )
    if experiment.speed_max_mps > settings.speed_max_mps:
        problems.append(
            f"{name}: speed_max_mps {experiment.speed_max_mps:g} is above that of commissioning, "
            f"{settings.speed_max_mps:g}; lower it"
        )
    if experiment.duration_s > settings.duration_max_s:
        problems.append(
            f"{name}: takes {experiment.duration_s:g} s, commissioning.duration_max_s is "
            f"{settings.duration_max_s:g}; shorten it, or drive it in parts"
        )
    if not_given := signal.not_given(frame_s):
        problems.append(f"{name}: {not_given}; change it")
    return problems


class Progress(IntEnum):
    """What the bus is told of an experiment."""

    NONE = 0  # none was begun since the start of the service
    LEADING_IN = Phase.LEADING_IN
    EXCITING = Phase.EXCITING
    LEADING_OUT = Phase.LEADING_OUT
    FINISHED = Phase.OVER
    ENDED_EARLY = 5


class Commissioning:
    """The experiment that runs: `excitation`, `started_s` and what the limits sent last are all its state."""

    def __init__(self, limits: LimitSettings, frame_s: float) -> None:
        self.frame_s = frame_s
        self.limits = Limits(limits)
        self.excitation: Excitation | None = None
        self.started_s = 0.0
        self.progress = Progress.NONE

    def left_s(self, now_s: float) -> float:
        """Time to the end of the running experiment; 0 where none runs."""
        return max(self.excitation.over_s - self._elapsed_s(now_s), 0.0) if self.excitation else 0.0

    def over(self, now_s: float) -> bool:
        """Whether the running experiment has come to its end."""
        return self.excitation is not None and self.excitation.phase(self._elapsed_s(now_s)) is Phase.OVER

    def begin(self, experiment: Experiment, now_s: float) -> None:
        """From neutral, now."""
        self.excitation, self.started_s = experiment.current(), now_s
        self.limits.neutral()

    def end(self, now_s: float) -> None:
        """To neutral, whatever ran."""
        if self.excitation is not None:
            self.progress = Progress.FINISHED if self.over(now_s) else Progress.ENDED_EARLY
        self.excitation = None
        self.limits.neutral()

    def step(self, now_s: float) -> float:
        """The current of the frame that begins now; one call a frame while an experiment runs."""
        assert self.excitation is not None
        elapsed_s = self._elapsed_s(now_s)
        self.progress = Progress(self.excitation.phase(elapsed_s))
        return self.limits.step(self.excitation.current_ma(elapsed_s), self.frame_s)

    def _elapsed_s(self, now_s: float) -> float:
        """In whole frames: a tick that comes a millisecond late must neither repeat nor leave out a value of noise."""
        return self.frame_s * round((now_s - self.started_s) / self.frame_s)
