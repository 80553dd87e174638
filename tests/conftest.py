"""What all tests share: reproducible examples, and where the measured drives are."""

import os
from pathlib import Path

import hypothesis
import pytest

# The same examples in every run; no deadline, since a loaded machine is not a fault of the code.
hypothesis.settings.register_profile("cruise", derandomize=True, deadline=None, print_blob=False)
hypothesis.settings.load_profile("cruise")


@pytest.fixture(scope="session")
def dart() -> Path:
    """Return the folder of the measured drives of the DART car."""
    data = os.environ.get("CRUISE_DATA")
    if not data:
        pytest.skip("CRUISE_DATA is not set: the measured drives are not here")
    folder = Path(data) / "dart"
    assert folder.is_dir(), f"CRUISE_DATA={data} holds no folder dart"
    return folder
