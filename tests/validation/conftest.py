"""Diagnoses of four drives, which many tests look at and none changes."""

import numpy as np
import pytest

from cruise.validation.diagnose import Diagnosis
from tests.validation.diagnosing import HEADER, PITCH, found
from tests.validation.driving import GRAVITY_MPS2


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
