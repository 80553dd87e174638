"""A hidden effect: found by the diagnosis, added by the ladder, and what that is worth in closed loop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from cruise.control.controller import ControlSettings
from cruise.effects import Effect
from cruise.identification.structures import parse
from cruise.plant import PlantSettings
from cruise.validation import ladder
from cruise.validation.diagnose import diagnose
from cruise.validation.study import discrete
from tools.benchmarks.figures import Figure, Part

from . import machines
from .courses import Course
from .drive import drive, rms
from .drivers import Predictive
from .scores import to_reference


@dataclass(frozen=True)
class Case:
    """An effect that the model lacks, and the course on which it costs most."""

    effect: str
    course: str


CASES: Final = (
    Case("grade", "hill up"),
    Case("oil_temperature", "warm-up"),
    Case("engine_speed", "rpm"),
    Case("hysteresis", "hysteresis"),
)


def measure(
    plant: PlantSettings,
    seed: int,
    control: ControlSettings,
    courses: Sequence[Course],
    tell: Callable[[str], None],
) -> Part:
    """For each effect: whether it was named, and the RMS to the reference without and with it."""
    recording = machines.lesson(plant, seed, period_s=machines.PERIOD_S)
    gears = machines.gears(plant, seed)
    figures, notes = [], []
    for case in CASES:
        structure = machines.STRUCTURE.replace(f"+{case.effect}", "")
        tell(f"{case.effect}: diagnosing")
        begun = ladder.begin([recording], parse(structure), None, None, machines.PERIOD_S)
        found = diagnose(begun)
        notes.append(f"{case.effect}: diagnose says {found.verdict} {' '.join(found.effects)}")
        tell(f"{case.effect}: adding")
        added = ladder.add(begun, case.effect)
        course = next(one for one in courses if one.name == case.course)
        errors = {}
        for name, model in (("before", discrete(begun, begun.base)), ("after", added.model)):
            tell(f"{case.effect}: driving {name}")
            complete: tuple[Effect, ...] = (*model.effects, gears)
            driver = Predictive(replace(model, effects=complete), control)
            errors[name] = rms([to_reference(drive(course, plant, driver, seed))])
            figures.append(
                Figure(f"{case.effect}_{name}_mps", errors[name], "m/s", f"{case.effect}, {case.course}: RMS {name}")
            )
        share = errors["after"] / errors["before"]
        figures.append(Figure(f"{case.effect}_share", share, "1", f"{case.effect}: after / before", 1.0))
        named = case.effect in found.effects
        figures.append(Figure(f"{case.effect}_named", float(named), "1", f"{case.effect}: named", at_least=1.0))
    return Part(tuple(figures), (seed,), tuple(notes))
