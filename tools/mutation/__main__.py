"""`tools/mutate`: every mutant of the limits, and those that their tests let live.

The mutants are made by cosmic-ray in a copy of the tree: nothing here is touched.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

ROOT = Path(__file__).resolve().parents[2]
SUBJECT, TESTS = "cruise/control/limits.py", "tests/control/test_limits.py"
TIMEOUT_S = 120.0  # s, a mutant that never ends counts as caught
CONFIG = """
[cosmic-ray]
module-path = "{subject}"
timeout = {timeout_s}
excluded-modules = []
test-command = "{python} -m pytest -x -q -p no:cacheprovider {tests}"
[cosmic-ray.distributor]
name = "local"
"""


def mutate(
    subject: Annotated[str, typer.Option(help="The file that is broken.")] = SUBJECT,
    tests: Annotated[str, typer.Option(help="The tests that have to notice.")] = TESTS,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Break the file in every way, run its tests each time, and print what they let pass."""
    with TemporaryDirectory() as folder:
        tree = Path(folder)
        for name in ("cruise", "tests", "config"):
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", tree)
        config = CONFIG.format(subject=subject, tests=tests, timeout_s=TIMEOUT_S, python=sys.executable)
        (tree / "mutation.toml").write_text(config, encoding="utf-8")
        for arguments in (
            ["baseline", "mutation.toml"],
            ["init", "mutation.toml", "s"],
            ["exec", "mutation.toml", "s"],
        ):
            _cosmic_ray(tree, *arguments)
        found = [_mutant(json.loads(line)) for line in _cosmic_ray(tree, "dump", "s").splitlines()]
    alive = [mutant for mutant in found if not mutant["caught"]]
    if as_json:
        typer.echo(json.dumps({"subject": subject, "mutants": len(found), "alive": alive}, indent=2))
    else:
        typer.echo(f"{subject}: {len(found)} mutants, {len(found) - len(alive)} caught by {tests}")
        for mutant in alive:
            typer.echo(f"ALIVE: {mutant['operator']}\n{mutant['diff']}")
    raise typer.Exit(1 if alive or not found else 0)


def _cosmic_ray(tree: Path, *arguments: str) -> str:
    program = shutil.which("cosmic-ray", path=str(Path(sys.executable).parent))
    if program is None:
        raise typer.BadParameter("cosmic-ray is not installed; pip install 'cruise-control-combine[dev]'")
    # The copy comes first, before the tree that is installed.
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([program, *arguments], cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise typer.BadParameter(f"cosmic-ray {arguments[0]}: {done.stdout}{done.stderr}")
    return done.stdout


def _mutant(line: list[dict[str, Any]]) -> dict[str, Any]:
    """One line of a dump: the mutation, and what the tests said of it."""
    work, result = line
    (mutation,) = work["mutations"]
    return {
        "operator": mutation["operator_name"],
        "line": mutation["start_pos"][0],
        "caught": result["test_outcome"] == "killed" or result["worker_outcome"] != "normal",
        "diff": result["diff"],
    }


if __name__ == "__main__":
    typer.run(mutate)
