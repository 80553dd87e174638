"""What the tests of the verbs share: the whole command line, from the words to the exit code."""

import sys
from collections.abc import Callable

import pytest

from cruise import cli

Run = Callable[..., tuple[int, str, str]]


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
