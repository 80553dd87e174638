"""The layers: a file imports only from rows above it, and only the edge touches files, buses and clocks."""

import ast
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "cruise").rglob("*.py"))

ROWS = (
    "signals",
    "units",
    "usual_names",
    "settings",
    "sampling",
    "grid",
    "recording",
    "directions",
    "times",
    "columns",
    "csv_file",
    "effects",
    "model",
    "identification",
    "estimation",
    "validation",
    "report",
    "control",
    "plant",
    "can",
    "service",
    "paper",
    "workbench",
    "cli",
)
DRIVE, LEARN = ("estimation", "control", "can"), ("identification", "validation", "report")
APART = {*product(DRIVE, LEARN), *product(LEARN, DRIVE)}  # the wings meet in service, workbench and cli
PLANT_MAY_IMPORT = {"signals", "plant"}  # independent physics, or a test on it proves nothing
BUS_LIBRARIES = {"can", "cantools", "canopen", "e2e"}
BUS_ROWS = {"can"}
CLOCKS = {"time", "datetime", "asyncio", "threading", "sched"}
CLOCK_ROWS = {"can", "service", "workbench", "cli"}  # the last two for the date in a model file
FILE_ROWS = {"settings", "csv_file", "can", "service", "workbench", "cli"}
FILE_CALLS = {"open", "read_text", "read_bytes", "write_text", "write_bytes", "loadtxt", "genfromtxt", "savetxt"}


def row_of(parts: tuple[str, ...]) -> str:
    """Return the row of the module cruise.X.Y, given as its parts; "" for cruise itself."""
    return parts[1] if len(parts) > 1 else ""


def imported(tree: ast.Module, package: tuple[str, ...]) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Yield line and absolute module path, as parts, of everything that a file in `package` imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, tuple(alias.name.split("."))
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = (*base, *(node.module.split(".") if node.module else ()))
            for alias in node.names:
                yield node.lineno, (*module, alias.name)


def violations(path: str, source: str) -> list[str]:
    """Return what the file at `path` ("cruise/plant/pump.py") does that its row must not, one sentence each."""
    parts = tuple(path.removesuffix(".py").split("/"))
    row = row_of(parts[:-1] if parts[-1] in ("__init__", "__main__") else parts)
    if row and row not in ROWS:
        return [f"{path}: {row} is in no row of the design"]
    tree = ast.parse(source)
    found = []
    for line, module in imported(tree, parts[:-1]):
        if module[0] == "cruise":
            target = row_of(module)
            if target not in ROWS:
                found.append(f"{path}:{line}: imports {'.'.join(module)}, which is in no row of the design")
            elif not row or ROWS.index(target) > ROWS.index(row):
                found.append(f"{path}:{line}: imports {target}, which is not above {row or 'cruise'}")
            elif row == "plant" and target not in PLANT_MAY_IMPORT:
                found.append(f"{path}:{line}: the plant imports {target}")
            elif (row, target) in APART:
                found.append(f"{path}:{line}: imports {target}, of the other wing")
        elif module[0] in BUS_LIBRARIES and row not in BUS_ROWS:
            found.append(f"{path}:{line}: imports {module[0]}; only cruise/can/ does")
        elif module[0] in CLOCKS and row not in CLOCK_ROWS:
            found.append(f"{path}:{line}: imports {module[0]}; time is an argument")
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and row not in FILE_ROWS:
            name = getattr(node.func, "attr", getattr(node.func, "id", None))
            if name in FILE_CALLS:
                found.append(f"{path}:{node.lineno}: calls {name}(); files are read and written at the edge")
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_file_keeps_to_its_row(file: Path):
    found = violations(file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8"))
    assert not found, "\n".join(found)


def test_the_walk_finds_the_files():
    assert {row_of(file.relative_to(ROOT).with_suffix("").parts) for file in FILES} >= {"signals", "effects", "model"}


@pytest.mark.parametrize(
    ("path", "source", "complaint"),
    [
        ("cruise/signals.py", "from cruise.settings import load", "imports settings, which is not above signals"),
        ("cruise/settings.py", "import cruise.recording", "imports recording, which is not above settings"),
        ("cruise/model/model.py", "from cruise import can", "imports can, which is not above model"),
        ("cruise/model/model.py", "from ..control import predictive", "imports control, which is not above model"),
        ("cruise/effects/__init__.py", "from ..model import Model", "imports model, which is not above effects"),
        ("cruise/__init__.py", "from cruise.cli import main", "imports cli, which is not above cruise"),
        ("cruise/model/model.py", "def late():\n    import cruise.service.loop", "imports service, which is not above"),
        ("cruise/plant/pump.py", "from cruise.effects import EFFECTS", "the plant imports effects"),
        ("cruise/plant/pump.py", "from cruise.settings import load", "the plant imports settings"),
        ("cruise/control/law.py", "from cruise.identification import arx", "of the other wing"),
        ("cruise/validation/ladder.py", "from cruise.estimation import gate", "of the other wing"),
        ("cruise/service/loop.py", "import can", "imports can; only cruise/can/ does"),
        ("cruise/cli/replay.py", "from cantools.database import load_file", "imports cantools; only"),
        ("cruise/estimation/gate.py", "import time", "time is an argument"),
        ("cruise/control/law.py", "from datetime import datetime", "time is an argument"),
        ("cruise/estimation/gate.py", "open('x')", "calls open()"),
        ("cruise/plant/pump.py", "from pathlib import Path\nPath('x').read_text()", "calls read_text()"),
        ("cruise/helpers/x.py", "", "helpers is in no row"),
        ("cruise/cli/main.py", "from cruise.helpers import x", "in no row"),
    ],
)
def test_a_planted_violation_is_found(path: str, source: str, complaint: str):
    found = violations(path, source)
    assert len(found) == 1
    assert complaint in found[0]


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("cruise/csv_file.py", "from cruise.sampling import Kind\nopen('x')"),
        ("cruise/can/bus.py", "import time\nimport can\nfrom cruise.settings import SettingsError"),
        ("cruise/plant/combine.py", "from cruise.plant.pump import Pump\nfrom cruise import signals"),
        ("cruise/service/loop.py", "import time\nfrom cruise.identification import x\nfrom cruise.control import law"),
        ("cruise/estimation/gate.py", "from .recursive import update\nfrom ..model import Model"),
    ],
)
def test_what_the_design_allows_passes(path: str, source: str):
    assert violations(path, source) == []
