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
    """Give a worker of pytest's one of the cores: a search takes all that there are, and two of them would share."""
    cores = sorted(os.sched_getaffinity(0))
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if worker:
        os.sched_setaffinity(0, {cores[int(worker.removeprefix("gw")) % len(cores)]})
    yield
    os.sched_setaffinity(0, cores)


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
