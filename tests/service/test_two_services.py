"""Two services where one should be: on one bus with one address, and with one folder for what is kept."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec import structs

from cruise.can.bus import open_bus
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.daemon import Daemon
from cruise.service.notify import Notifier
from cruise.service.persistence import PersistenceSettings, held
from cruise.service.settings import CruiseSettings
from cruise.settings import SettingsError

OURS = 0x20000E0000000000  # NAME in config/cruise.yaml
HOLDER = """
import sys
from pathlib import Path
from cruise.service.persistence import held
with held(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> CruiseSettings:
    found = service_settings.load(CONFIG / "cruise.yaml")
    can = CanSettings(bus="virtual", channel=request.node.name)
    kept = PersistenceSettings(machine="A1", folder=str(tmp_path / "kept"))
    return structs.replace(found, can=can, persistence=kept)


def run(daemon: Daemon, ticks: int) -> None:
    daemon.run(iter([True] * ticks + [False]).__next__, lambda now_s: None)


@pytest.mark.parametrize(
    ("name", "words"), [(OURS, "our very NAME"), (OURS - 1, "lost to NAME 20000DFFFFFFFFFF, smaller than ours, 2000")]
)
def test_whose_the_address_is_now_is_said_once(settings: CruiseSettings, name: int, words: str):
    said: list[str] = []
    daemon = Daemon(structs.replace(settings, persistence=None), Notifier(""), said.append)
    with open_bus(settings.can) as other:
        claim = Frame(arbitration_id=0x18EEFF11, data=name.to_bytes(8, "little"))
        other.send(claim)
        other.send(claim)
        run(daemon, 4)
    (line,) = said
    assert line.startswith("address 0x11 is ")
    assert words in line


def test_a_folder_that_another_process_has_is_refused_before_the_bus_and_free_when_that_one_has_ended(
    settings: CruiseSettings, tmp_path: Path
):
    (tmp_path / "kept").mkdir()
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "kept")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(SettingsError, match=r"persistence\.folder: another `cruise run` has .*/kept; stop that"):
            Daemon(settings, Notifier(""), print)
        other.kill()
    run(Daemon(settings, Notifier(""), print), 1)


def test_a_run_gives_the_folder_to_the_next_one(settings: CruiseSettings, tmp_path: Path):
    first = Daemon(settings, Notifier(""), print)
    with pytest.raises(SettingsError), held(tmp_path / "kept"):
        pass
    run(first, 1)
    run(Daemon(settings, Notifier(""), print), 1)


def test_a_start_that_fails_leaves_the_folder_free(settings: CruiseSettings, tmp_path: Path):
    absent = structs.replace(settings, can=CanSettings(bus="socketcan", channel="never0"))
    with pytest.raises(SettingsError) as failed:
        Daemon(absent, Notifier(""), print)
    assert "persistence.folder" not in str(failed.value)
    with held(tmp_path / "kept"):
        pass


def test_a_file_system_without_locks_is_said_and_ends_nothing(settings: CruiseSettings, monkeypatch):
    def none(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("cruise.service.persistence.fcntl.flock", none)
    said: list[str] = []
    run(Daemon(settings, Notifier(""), said.append), 2)
    assert sum("can't be locked (No locks available)" in line for line in said) == 1
