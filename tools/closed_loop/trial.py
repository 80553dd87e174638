"""One run: every driver over every course on one machine, and what is claimed of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cruise.control.controller import ControlSettings
from cruise.model.model import Model
from cruise.plant import PlantSettings
from cruise.signals import Sample
from tools.benchmarks.figures import Figure

from . import machines, scores
from .courses import Course
from .drive import Driven, Ripple, drive, rms
from .drivers import DRIVERS, Models

Tell = Callable[[str], None]
SLOW_HZ: Final = (0.1, 0.2, 0.3)
FAST_HZ: Final = (1.5, 2.0, 3.0, 4.0, 5.0)
RIPPLE_MPS: Final = 0.03  # amplitude that is added to the speed sensor
BEST = "learned"  # the driver that claims


class Hold:
    """What the machine does at a fixed current."""

    def __init__(self, current_ma: float) -> None:
        self.current_ma = current_ma

    def step(self, sample: Sample, setpoint_mps: float | None) -> float:
        """One frame."""
        return self.current_ma


@dataclass
class Run:
    """All drives of one run, by driver and course."""

    machine: str
    plant: PlantSettings
    seed: int
    courses: tuple[Course, ...]
    models: Models
    control: ControlSettings
    drives: dict[str, dict[str, Driven]] = field(default_factory=dict)
    held: dict[str, Driven] = field(default_factory=dict)
    gains: dict[float, float] = field(default_factory=dict)  # mA per m/s of ripple, by Hz

    def go(self, names: Sequence[str], tell: Tell) -> None:
        """Drive everything."""
        for course in self.courses:
            for name in names:
                tell(f"{course.name}: {name}")
                self.drives.setdefault(name, {})[course.name] = self.driven(course, name)
            if "hill" in course.judged:
                plant = machines.Sensors().of(self.plant)
                self.held[course.name] = drive(course, plant, Hold(course.begin.current_ma), self.seed)

    def driven(self, course: Course, name: str, ripple: Ripple | None = None) -> Driven:
        """One driver on one course."""
        kind = DRIVERS[name]
        plant = machines.Sensors(kind.noisy).of(self.plant)
        return drive(course, plant, kind.make(self.models, self.control), self.seed, ripple)

    def ripple(self, course: Course, tell: Tell) -> None:
        """How much of a ripple of the speed sensor reaches the command, over its frequency."""
        still = self.driven(course, BEST)
        for hz in (*SLOW_HZ, *FAST_HZ):
            tell(f"ripple of {hz:g} Hz")
            shaken = self.driven(course, BEST, lambda t, hz=hz: RIPPLE_MPS * math.sin(2.0 * math.pi * hz * t))
            change_ma = (shaken.current_ma - still.current_ma)[still.settled]
            time_s = still.time_s[still.settled]
            wave = np.exp(-2j * np.pi * hz * time_s)
            self.gains[hz] = float(2.0 * abs(np.mean(change_ma * wave)) / RIPPLE_MPS)

    def figures(self) -> list[Figure]:
        """Everything that is claimed and was driven, beside its target."""
        mine = self.drives.get(BEST, {})
        return [*self._ratios(), *self._steps(mine), *self._field(mine), *self._command(mine), *self._power(mine)]

    def _pooled(self, name: str, errors: Callable[[Driven], np.ndarray]) -> float:
        drives = self.drives.get(name, {})
        return rms([errors(drives[one.name]) for one in self.courses if one.pooled and one.name in drives])

    def _ratios(self) -> list[Figure]:
        ref = {name: self._pooled(name, scores.to_reference) for name in self.drives}
        point = {name: self._pooled(name, scores.to_setpoint) for name in self.drives}
        wanted = (
            (
                "reference_over_pid",
                "learned",
                "pid",
                ref,
                "RMS to the reference, learned with feed-forward / PID",
                0.45,
            ),
            ("plain_over_pid", "plain", "pid", ref, "RMS to the reference, learned without feed-forward / PID", 0.70),
            ("factory_over_pid", "factory", "pid", ref, "RMS to the reference, factory model / PID", None),
            ("setpoint_over_pid", "learned", "pid", point, "RMS to the setpoint, with feed-forward / PID", 0.75),
            (
                "over_held_pid",
                "learned",
                "pid_1hz",
                ref,
                "the same over a PID that is held to 1 Hz as the law is",
                None,
            ),
            (
                "over_factory_pid",
                "learned",
                "pid_factory",
                ref,
                "the same over a PID that learns nothing: tuned on the factory's model, with its inverse",
                None,
            ),
            ("over_bound", "learned", "bound", ref, "RMS to the reference, with feed-forward / bound", 1.25),
        )
        found = [
            Figure(key, values[one] / values[other], "1", meaning, target)
            for key, one, other, values, meaning, target in wanted
            if one in values and other in values
        ]
        return found + [Figure(f"rms_{name}_mps", value, "m/s", f"RMS, {name}") for name, value in ref.items()]

    def _steps(self, mine: Mapping[str, Driven]) -> list[Figure]:
        steps = [
            step
            for course in self.courses
            if "steps" in course.judged and course.name in mine
            for step in scores.steps(mine[course.name])
        ]
        if not steps:
            return []
        over, late = max(step.overshoot for step in steps), max(step.late_s for step in steps)
        allowed = "of 5 % of the step or 2 cm/s, whichever is more"
        return [
            Figure("overshoot", over, "1", f"largest overshoot as a share {allowed}", 1.0),
            Figure("overshoot_median", float(np.median([s.overshoot for s in steps])), "1", "median of it"),
            Figure("late_s", late, "s", "within 3 cm/s after the reference, latest", 0.6),
            Figure("late_median_s", float(np.median([s.late_s for s in steps])), "s", "median of it"),
        ]

    def _field(self, mine: Mapping[str, Driven]) -> list[Figure]:
        worst, later, found = [], [], []
        for course in self.courses:
            if "hill" in course.judged and course.name in mine:
                loss = scores.held_cost(course, self.held[course.name])
                worst += (np.array(scores.field_cost(course, mine[course.name])) / loss).tolist()
                later += (np.array(scores.field_cost(course, mine[course.name], scores.LATER_S)) / loss).tolist()
            if "rpm" in course.judged and course.name in mine:
                costs = scores.field_cost(course, mine[course.name])
                found.append(Figure("rpm_drop_mps", costs[0], "m/s", "600 rpm less in 5 s: at worst", 0.06))
                found.append(Figure("rpm_rise_mps", costs[1], "m/s", "600 rpm more in 5 s: at worst"))
        if worst:
            hill = "a slope of 5 degrees (on, off, up, down) over a fixed current"
            found.insert(0, Figure("hill", max(worst), "1", f"{hill}: at worst", 0.4))
            found.insert(1, Figure("hill_later", max(later), "1", f"{hill}: 5 s later", 0.2))
        return found

    def _command(self, mine: Mapping[str, Driven]) -> list[Figure]:
        if not mine:
            return []
        content = {name: scores.command_above_1hz_ma(one) for name, one in mine.items()}
        name = max(content, key=lambda one: content[one])
        moving = [scores.motion(mine[one.name]) for one in self.courses if one.pooled and one.name in mine]
        found = [
            Figure("above_1hz_ma", content[name], "mA", f"command above 1 Hz, worst course ({name})", 6.0),
            Figure(
                "accel_share",
                scores.within([accel for accel, _ in moving], scores.ACCEL_MPS2),
                "1",
                "samples with acceleration within 1.0 m/s2",
                at_least=0.999,
            ),
            Figure(
                "jerk_share",
                scores.within([jerk for _, jerk in moving], scores.JERK_MPS3),
                "1",
                "samples with jerk within 2.0 m/s3",
                at_least=0.99,
            ),
        ]
        if self.gains:
            fast, slow = (max(self.gains[hz] for hz in span) for span in (FAST_HZ, SLOW_HZ))
            weaker_db = 20.0 * math.log10(slow / fast)
            found.append(
                Figure("ripple_db", weaker_db, "dB", "ripple of 1.5 to 5 Hz weaker than to 0.3", at_least=20.0)
            )
        return found

    def _power(self, mine: Mapping[str, Driven]) -> list[Figure]:
        if "power limit" not in mine:
            return []
        least = float(mine["power limit"].engine_rpm.min())
        return [Figure("engine_least_rpm", least, "rpm", "engine at its power limit, slowest", at_least=1500.0)]


def models_of(plant: PlantSettings, factory: Model, seed: int, tell: Tell) -> Models:
    """The models of one machine: the factory's, the one it taught, and the one that flawless sensors would teach."""
    tell("lesson")
    learned = machines.learned(machines.lesson(plant, seed), machines.gears(plant, seed))
    exact = machines.Sensors(noisy=False).of(plant)
    tell("lesson without noise")
    return Models(factory, learned, machines.learned(machines.lesson(exact, seed), machines.gears(exact, seed)))
