"""Drives with something hidden in them, and what the search begins with and finds there."""

from contextlib import AbstractContextManager

import numpy as np

from cruise.effects import EFFECTS
from cruise.identification.structures import parse
from cruise.validation.candidates import candidates
from cruise.validation.diagnose import Diagnosis, diagnose
from cruise.validation.judged import Judged
from cruise.validation.study import Study, study
from cruise.validation.tried import Step
from cruise.validation.trying import tried_beside
from tests.validation.driving import drive, wander
from tools.trial.run import table_without

SECONDS, DT_S, PERIOD_S = 160.0, 0.1, 0.2
SAMPLES = round(SECONDS / DT_S)
STRUCTURE = parse("arx:na=1,nb=3,delay_s=0.4")
PITCH = wander(SAMPLES, DT_S, 11, 2.5, 5.0)
HEADER = 300.0 + wander(SAMPLES, DT_S, 12, 60.0, 2.0)

FEW = ("dead_zone", "quadratic_gain", "saturation", "coulomb_friction")


def few() -> AbstractContextManager[None]:
    """Fewer effects are tried, for speed: of those that need no signal these alone."""
    return table_without([name for name, kind in EFFECTS.items() if not kind.needs and name not in FEW])


def begun(**hidden) -> Study:
    columns = {"pitch_deg": PITCH, "header_height_mm": HEADER}
    return study([drive(SECONDS, 4, DT_S, 0.02, columns=columns, **hidden)], STRUCTURE, None, PERIOD_S)


def found(**hidden) -> Diagnosis:
    return diagnose(begun(**hidden))


def tried(one: Study, present: Judged) -> Step:
    """Every effect beside what is there, none chosen yet."""
    everyone, _ = candidates(one.recordings, present.explanation)
    return tried_beside(one, present, everyone, [], np.random.default_rng(1), lambda text: None)
