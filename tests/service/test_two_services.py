"""Two services where one should be: on one bus with one address."""

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
from cruise.service.persistence import PersistenceSettings
from cruise.service.settings import CruiseSettings

OURS = 0x20000E0000000000  # NAME in config/cruise.yaml


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
