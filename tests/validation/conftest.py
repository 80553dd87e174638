"""A study of a plain drive, and diagnoses of four drives, which many tests look at and none changes."""

import os
from collections.abc import Iterator

import numpy as np
import pytest

from cruise.validation.diagnose import Diagnosis
from cruise.validation.study import Study, study
from tests.validation.diagnosing import HEADER, PERIOD_S, PITCH, SECONDS, STRUCTURE, found
from tests.validation.driving import GRAVITY_MPS2, drive


@pytest.fixture(scope="module", autouse=True)
def own_core() -> Iterator[None]:
    """Have a search work on one core where pytest has workers: it takes all that there are, and they would share."""
    with pytest.MonkeyPatch.context() as patch:
        if "PYTEST_XDIST_WORKER" in os.environ:
            patch.setattr(os, "sched_getaffinity", lambda process: {0})
        yield


@pytest.fixture(scope="module")
def plain() -> Study:
    """A drive of current and speed alone. What is tried beside it learns a disturbance, so that each module has one."""
    return study([drive(SECONDS)], STRUCTURE, None, PERIOD_S)


@pytest.fixture(scope="session")
def nothing() -> Diagnosis:
    return found()


@pytest.fixture(scope="session")
def grade() -> Diagnosis:
    return found(load_mps=-0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH)))


@pytest.fixture(scope="session")
def dead_zone() -> Diagnosis:
    return found(command=lambda u: np.maximum(u - 400.0, 0.0))


@pytest.fixture(scope="session")
def unlisted() -> Diagnosis:
    return found(load_mps=0.3 * np.cos((HEADER - 300.0) / 60.0))
