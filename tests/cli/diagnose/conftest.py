"""Diagnoses of two drives, which many tests look at and none changes."""

import pytest

from cruise.effects import EFFECTS
from cruise.validation.diagnose import Diagnosis
from tests.cli.diagnose.drives import PULL, TRIED, drive, found_in
from tools.trial.run import table_without


@pytest.fixture(scope="package", autouse=True)
def few():
    """Fewer effects are tried, for speed; those that lack a signal cost nothing."""
    with table_without([name for name, kind in EFFECTS.items() if not kind.needs and name not in TRIED]):
        yield


@pytest.fixture(scope="package")
def hills() -> Diagnosis:
    """What is found where grade is hidden."""
    return found_in(drive(1, PULL))


@pytest.fixture(scope="package")
def flat() -> Diagnosis:
    """What is found where nothing is."""
    return found_in(drive(2, 0.0))
