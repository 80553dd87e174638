"""Learning while driving: hours over all courses on a machine that wears, with what is learned and with what was given.

Every 5 minutes that there are, sliding, are compared: the RMS to the reference of the one that learns may be above that
of the fixed one by 5 % and 0.005 m/s. Both drive the same machine over the same ground with the same noise; between two
courses the machine is approached by hand, and what was learned stays.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from cruise.control.controller import ControlSettings
from cruise.control.proof import ProofSettings
from cruise.estimation.supervision import Change, Decision
from cruise.model.model import Model
from cruise.plant import PlantSettings
from tools.benchmarks.figures import Figure, Part

from .adaptive import Adaptive
from .courses import Course, laid_over
from .drive import APPROACH_S, FRAME_S, drive
from .drivers import Predictive
from .scores import to_reference

WINDOW_S: Final = 300.0
STRIDE_S: Final = 5.0
SHARE, AMOUNT_MPS = 1.05, 0.005
BUMP_MA: Final = 5.0
WEAR, WEAR_HOURS = 0.12, 3.0  # of the pump's size up and down, and the time of one such wave
VALVE, VALVE_HOURS = 0.02, 5.0  # of the current at which it begins to move
SUDDENLY: Final = 0.85  # of the pump's size, for the third hour of every four
LOADED_KG: Final = 2500.0

MARGINS: Final = {  # of a proof: unit and meaning
    "gain_margin": ("1", "gain margin"),
    "phase_margin_deg": ("deg", "phase margin"),
    "wrong_gain_margin": ("1", "gain margin if the driving or the factory's model is right"),
    "wrong_phase_margin_deg": ("deg", "phase margin then"),
}

Tell = Callable[[str], None]


def machine_at(plant: PlantSettings, hours: float, rng: np.random.Generator) -> PlantSettings:
    """The machine after so many hours: a worn pump, a valve that drifts, cold or warm oil, something in the bin."""
    size = 1.0 + WEAR * math.sin(2.0 * math.pi * hours / WEAR_HOURS)
    size *= SUDDENLY if int(hours) % 4 == 2 else 1.0
    valve = 1.0 + VALVE * math.sin(2.0 * math.pi * hours / VALVE_HOURS)
    pump, vehicle = plant.pump, plant.vehicle
    changes = {
        "pump": {"displacement_cm3": size * pump.displacement_cm3, "threshold_ma": valve * pump.threshold_ma},
        "vehicle": {"mass_kg": vehicle.mass_kg + float(rng.uniform(0.0, LOADED_KG))},
        "oil": {"start_temperature_c": float(rng.uniform(15.0, 60.0))},
    }
    return laid_over(plant, changes)


def itinerary(courses: Sequence[Course], rng: np.random.Generator) -> Iterator[Course]:
    """All courses in an order drawn anew each round, without end."""
    while True:
        yield from (courses[i] for i in rng.permutation(len(courses)))


@dataclass
class Hours:
    """What was driven: errors at the rate of the frames, and what was decided at which hour."""

    learning: list[np.ndarray] = field(default_factory=list)
    fixed: list[np.ndarray] = field(default_factory=list)
    names: list[str] = field(default_factory=list)  # of the courses
    decisions: list[tuple[float, str, Decision]] = field(default_factory=list)  # hour and course
    bumps_ma: list[float] = field(default_factory=list)
    hours: float = 0.0

    def drive(
        self,
        hours: float,
        plant: PlantSettings,
        courses: Sequence[Course],
        learner: Adaptive,
        fixed: Callable[[], Predictive],
        seed: int,
        tell: Tell,
    ) -> None:
        """Drive courses until the hours are over."""
        rng = np.random.default_rng(seed)
        for number, course in enumerate(itinerary(courses, rng)):
            if self.hours >= hours:
                self.bumps_ma = learner.controller.bumps_ma
                return
            tell(f"{self.hours:.2f} of {hours:g} h: {course.name}, {self._said()}")
            machine, known = machine_at(plant, self.hours, rng), len(learner.decisions)
            self.learning.append(to_reference(drive(course, machine, learner, seed + number)))
            self.fixed.append(to_reference(drive(course, machine, fixed(), seed + number)))
            self.names.append(course.name)
            self.decisions += [(self.hours, course.name, one) for one in learner.decisions[known:]]
            self.hours += (APPROACH_S + course.seconds) / 3600.0

    def windows(self) -> np.ndarray:
        """Rows of RMS errors in m/s in every 5 minutes: learning, fixed; one row over all where there is less."""
        squares = np.array([np.concatenate(self.learning), np.concatenate(self.fixed)]) ** 2
        count, stride = round(WINDOW_S / FRAME_S), round(STRIDE_S / FRAME_S)
        if squares.shape[1] <= count:
            return np.sqrt(squares.mean(axis=1))[None, :]
        sums = np.cumsum(np.pad(squares, ((0, 0), (1, 0))), axis=1)
        return np.sqrt((sums[:, count::stride] - sums[:, :-count:stride]) / count).T

    def figures(self, proof: ProofSettings) -> list[Figure]:
        """What is claimed of it."""
        learning, fixed = self.windows().T
        worst = int(np.argmax(above := learning - SHARE * fixed - AMOUNT_MPS))
        whole = [math.sqrt(float(np.mean(np.concatenate(one) ** 2))) for one in (self.learning, self.fixed)]
        count = {change: sum(one.change is change for _, _, one in self.decisions) for change in Change}
        adopted = [one.figures for _, _, one in self.decisions if one.change is Change.ADOPTED]
        least = {name: min((one[name] for one in adopted), default=math.nan) for name in MARGINS}
        allowed = f"{SHARE:g} of the fixed one's and {AMOUNT_MPS:g} m/s"
        return [
            Figure("hours", self.hours, "h", "simulated hours"),
            Figure("worst_above_mps", float(above[worst]), "m/s", f"worst 5 minutes above {allowed}", 0.0),
            Figure("worst_learning_mps", float(learning[worst]), "m/s", "there: RMS while learning"),
            Figure("worst_fixed_mps", float(fixed[worst]), "m/s", "there: RMS with the factory's model"),
            Figure("ratio", whole[0] / whole[1], "1", "all hours: RMS while learning / with the factory's model"),
            Figure("adopted", count[Change.ADOPTED], "1", "models adopted"),
            Figure("returned", count[Change.RETURNED], "1", "returns to the last good or the factory's model"),
            Figure("refused", count[Change.REFUSED], "1", "refusals, the same reason in a row said once"),
            *(
                Figure(name, least[name], unit, f"{meaning}, least of the adopted", at_least=getattr(proof, name))
                for name, (unit, meaning) in MARGINS.items()
                if adopted
            ),
            Figure(
                "bump_ma",
                max((abs(one) for one in self.bumps_ma), default=math.nan),
                "mA",
                "jump of the command where another model takes over, largest",
                BUMP_MA if self.bumps_ma else None,
            ),
        ]

    def as_json(self) -> list[dict[str, Any]]:
        """Every decision with its hour, course, reason and figures."""
        return [{"hour": hour, "course": course} | one.as_json() for hour, course, one in self.decisions]

    def _said(self) -> str:
        if not self.fixed:
            return "nothing yet"
        learning, fixed = self.windows().T
        worst = float(np.max(learning - SHARE * fixed - AMOUNT_MPS))
        adopted = sum(one.change is Change.ADOPTED for _, _, one in self.decisions)
        return f"adopted {adopted}, worst 5 minutes {1e3 * worst:+.1f} mm/s from what is allowed"


def measure(
    plant: PlantSettings, factory: Model, courses: Sequence[Course], hours: float, seed: int, tell: Tell
) -> tuple[Part, Hours]:
    """Drive the hours with the factory's model as the fixed one."""
    control, proof, run = ControlSettings(), ProofSettings(), Hours()
    learner = Adaptive(factory, control, proof=proof)
    run.drive(hours, plant, courses, learner, lambda: Predictive(factory, control), seed, tell)
    learning, fixed = run.windows()[:: round(WINDOW_S / STRIDE_S)].T
    series = {"learning_mps": learning.tolist(), "fixed_mps": fixed.tolist()}
    return Part(tuple(run.figures(proof)), (seed,), ("one row of the series is 5 minutes",), series), run
