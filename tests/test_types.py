"""The types: all of the program, its tests and its tools, as pyproject.toml asks. It takes minutes of one core."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# pyright and its node come whole out of their wheels; without this it asks the network for a newer version.
ALONE = {"PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}


def test_the_types_hold():
    line = [sys.executable, "-m", "pyright"]
    done = subprocess.run(line, cwd=ROOT, env=os.environ | ALONE, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
