"""What all tests share: reproducible examples, the whole command line, and where the measured drives are."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

from cruise import cli

Run = Callable[..., tuple[int, str, str]]
HERE = Path(__file__).parent
WAITING = ("test_real_bus.py", "workbench")  # for a bus in real time, or for a browser

# The same examples in every run; no deadline, since a loaded machine is not a fault of the code.
hypothesis.settings.register_profile("cruise", derandomize=True, deadline=None, print_blob=False)
hypothesis.settings.load_profile("cruise")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that wait come first, so that one worker has them all, and the others compute meanwhile."""
    items.sort(key=lambda item: item.path.relative_to(HERE).parts[0] not in WAITING)


@pytest.fixture(scope="session")
def dart() -> Path:
    """Return the folder of the measured drives of the DART car."""
    data = os.environ.get("CRUISE_DATA")
    if not data:
        pytest.skip("CRUISE_DATA is not set: the measured drives are not here")
    folder = Path(data) / "dart"
    assert folder.is_dir(), f"CRUISE_DATA={data} holds no folder dart"
    return folder


@pytest.fixture
def verb(monkeypatch, capsys, tmp_path) -> Run:
    """Run one command line in a folder of its own; returns its exit code and what it printed on both streams."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["cruise", *(str(word) for word in words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return run
