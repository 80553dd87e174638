"""What feedback does to learning: the same courses in closed loop, and with the same law made deaf, which is open loop.

In closed loop the current answers to hills and soil, and a fit takes a part of the answer for the machine (Ljung 1999,
section 13.4). The deaf law plans from its model alone: its current knows the setpoint and nothing of the field. What a
fit finds there is the machine, and all models are judged on such a drive that taught none of them.
"""

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from cruise.control.controller import ControlSettings
from cruise.control.frame_model import cumulants_s
from cruise.identification.least_squares import fit
from cruise.identification.shapes import ahead_rms_mps
from cruise.model.model import Model
from cruise.plant import PlantSettings
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT, Sample
from tools.benchmarks.figures import Figure, Part

from .adaptive import Adaptive
from .courses import Course
from .drive import drive

COURSES: Final = ("steps", "hill up", "hill down", "soft soil", "bin", "rpm", "crop", "field")  # in second gear
DEAF_MPS: Final = 1e3  # m/s, noise of a speed that nobody would listen to
HORIZON_S: Final = 3.0


def deaf(control: ControlSettings) -> ControlSettings:
    """The law that does not listen to the speed."""
    observer = msgspec.structs.replace(control.observer, speed_noise_mps=DEAF_MPS)
    return msgspec.structs.replace(control, observer=observer)


def driven(
    plant: PlantSettings, courses: Sequence[Course], driver: Adaptive, seed: int, tell: Callable[[str], None]
) -> list[Recording]:
    """What the driver's estimator was given on each of the courses."""
    found = []
    for number, course in enumerate(courses):
        tell(f"bias: {course.name}")
        known = len(driver.samples)
        drive(course, course.machine(plant), driver, seed + number)
        found.append(_recording(driver.samples[known:], driver.learning.estimator.factory, course.name))
    return found


def measure(
    plant: PlantSettings,
    factory: Model,
    courses: Sequence[Course],
    seed: int,
    tell: Callable[[str], None] = lambda text: None,
) -> Part:
    """Gain, delay and error of the model that was learned online, and of fits to what taught it and to open loop."""
    chosen = [course for course in courses if course.name in COURSES]
    control = ControlSettings()
    learner = Adaptive(factory, control)
    closed = driven(plant, chosen, learner, seed, tell)
    opened, unseen = (driven(plant, chosen, Adaptive(factory, deaf(control)), one, tell) for one in (seed, seed + 1000))
    true = fit(factory, opened)
    models = {
        "open": ("batch fit, open loop", true),
        "online": ("learned online, closed loop", learner.learning.estimator.snapshot()),
        "batch": ("batch fit to the same samples, closed loop", fit(factory, closed)),
        "factory": ("factory's model", factory),
    }
    figures = []
    for key, (title, model) in models.items():
        gain_pct = 100.0 * (model.dc_gain_mps_per_ma / true.dc_gain_mps_per_ma - 1.0)
        figures += [
            Figure(f"bias_{key}_gain_pct", gain_pct, "%", f"{title}: steady gain beside that of open loop"),
            Figure(f"bias_{key}_delay_s", cumulants_s(model)[0], "s", f"{title}: mean delay, lags included"),
            Figure(
                f"bias_{key}_error_mps", ahead_rms_mps(model, unseen, HORIZON_S), "m/s", f"{title}: 3 s ahead, unseen"
            ),
        ]
    return Part(tuple(figures), (seed, seed + 1000), ("unseen: in open loop, on another seed",))


def _recording(samples: Sequence[Sample], model: Model, source: str) -> Recording:
    names = [name for name in (*model.needs, *model.uses) if name in samples[0].signals]
    columns = {name: np.array([one.signals[name] for one in samples]) for name in dict.fromkeys(names)}
    columns[INPUT] = np.array([one.current_ma for one in samples])
    columns[OUTPUT] = np.array([one.speed_mps for one in samples])
    time_s = model.period_s * np.arange(1, len(samples) + 1)
    return Recording(time_s, columns, model.period_s, source, averaged=True)
