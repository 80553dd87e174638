"""tools/install and tools/uninstall on a folder: what is refused, what is taken away and what stays; the units."""

import configparser
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SETTINGS, LEARNED, BOX = (
    "etc/cruise/cruise.yaml",
    "var/lib/private/cruise/state",
    "var/lib/cruise-recorder/log-1.log.gz",
)
PROGRAM, UNIT, OTHER = "opt/cruise/bin/cruise", "etc/systemd/system/cruise.service", "etc/systemd/system/other.service"


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    for name in (SETTINGS, LEARNED, BOX, PROGRAM, UNIT, OTHER):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def left(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


def uninstall(*words: str) -> None:
    subprocess.run([str(ROOT / "tools/uninstall"), *words], check=True, capture_output=True)


def test_settings_and_what_was_learned_stay(installed: Path):
    uninstall("--root", str(installed))
    assert left(installed) == {SETTINGS, LEARNED, BOX, OTHER}


def test_purge_takes_these_too_and_nothing_else(installed: Path):
    uninstall("--root", str(installed), "--purge")
    assert left(installed) == {OTHER}


def test_nothing_in_an_image_asks_any_more_for_what_is_gone(installed: Path):
    wants = installed / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    for name in ("cruise.service", "other.service"):
        (wants / name).symlink_to(f"/etc/systemd/system/{name}")  # as `systemctl --root` does
    uninstall("--root", str(installed))
    assert [link.name for link in wants.iterdir()] == ["other.service"]


@pytest.mark.parametrize("tool", ["install", "uninstall"])
@pytest.mark.parametrize("words", [["--prefix", "/x"], ["--root"], ["/x"]])
def test_what_is_not_understood_changes_nothing(tool: str, words: list[str], tmp_path: Path):
    ran = subprocess.run(
        [str(ROOT / "tools" / tool), *words], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert ran.returncode != 0
    assert "--root" in ran.stderr
    assert left(tmp_path) == set()


def test_an_image_beside_us_is_whole_and_everybody_can_run_it_whatever_the_umask(tmp_path: Path):
    """As an integrator builds one: a relative folder, a careful shell. `pip` brings the packages."""
    script = f"umask 077; '{ROOT}/tools/install' --root image"
    ran = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    image = tmp_path / "image"
    program = image / PROGRAM
    assert program.read_text().splitlines()[0] == "#!/opt/cruise/bin/python"
    assert not (ROOT / "image").exists()
    for path in (image / "opt", image / "etc", *(image / "opt").rglob("*")):
        wanted = 0o555 if path.is_dir() else 0o444
        assert path.stat().st_mode & wanted == wanted, path
    words = ["demo", "--headless", "--seconds", "2", "--out", "out"]  # with the files that it takes by default
    python = [image / "opt/cruise/bin/python", "-c", "import sys; from cruise.cli import main; sys.exit(main())"]
    drove = subprocess.run([*python, *words], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert drove.returncode == 0, drove.stderr
    subprocess.run([str(ROOT / "tools/uninstall"), "--root", "image", "--purge"], check=True, cwd=tmp_path)
    assert left(image) == set()


def test_the_black_box_is_started_until_its_bus_is_there():
    """It ends where there is none, and five ends within ten seconds would be its last by systemd's default."""
    unit = configparser.ConfigParser(strict=False)
    unit.read(ROOT / "systemd/cruise-recorder.service")
    assert unit["Service"]["Restart"] == "always"
    assert unit["Unit"].get("StartLimitIntervalSec") == "0"
