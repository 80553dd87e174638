"""The recorder sees an exit where the commands become inactive, and where they stop."""

from pathlib import Path

import pytest
from msgspec import structs

from cruise.can.codec import Codec
from cruise.can.ring import Ring, RingSettings
from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.black_box import BlackBox

SETTINGS = service_settings.load(CONFIG / "cruise.yaml")


def drive(folder: Path, active: list[bool | None]) -> BlackBox:
    """A command every 0.1 s, active or not; None: none comes."""
    can = structs.replace(SETTINGS.can, bus="virtual")
    sender, box = (
        Codec.load(SETTINGS.database, can),
        BlackBox(
            Codec.load(SETTINGS.database, can),
            Ring(folder, RingSettings(segment_s=1.0, before_s=0.0, after_s=0.0), "can0"),
            print,
        ),
    )
    for number, one in enumerate(active):
        if one is not None:
            values = {"pump_current_command_ma": 500.0 * one, "command_active": float(one)}
            box.receive(sender.encode("PumpCurrentCommand", values, 0.1 * number))
        box.tick(0.1 * (number + 1))
    box.ring.close()
    return box


@pytest.mark.parametrize(
    ("active", "exits"),
    [
        ([False] * 10, 0),
        ([False, True, True, True], 0),
        ([True, True, False, False, True, False], 2),
        ([True, True, None, True, True], 0),  # one was lost
        ([True, True, None, None, None, None, None], 1),  # it is gone
        ([True, None, None, None, None, None, False], 1),
    ],
)
def test_exits(tmp_path: Path, active: list[bool | None], exits: int):
    box = drive(tmp_path, active)
    assert box.exits == exits
    assert box.ring.frames == sum(one is not None for one in active)
    frozen = [path for path in box.ring.segments() if path.name.startswith("exit")]
    assert bool(frozen) is (exits > 0)


def test_a_full_disk_costs_frames_and_does_not_end_it(tmp_path: Path):
    """The kernel's full device stands for it, and a folder for a segment that can't be opened; then there is room."""
    sender, said = Codec.load(SETTINGS.database, structs.replace(SETTINGS.can, bus="virtual")), []
    box = BlackBox(sender, Ring(tmp_path, RingSettings(segment_s=1.0, after_s=0.0), "can0"), said.append)
    (tmp_path / "log-0000002.log.gz").symlink_to("/dev/full")
    (tmp_path / "log-0000003.log.gz").mkdir()
    (tmp_path / "log-0000004.log.gz").symlink_to("/dev/full")
    for k in range(80):
        frame = sender.encode("PumpCurrentCommand", {"pump_current_command_ma": 1.0, "command_active": 1.0}, 0.1 * k)
        box.receive(frame)
        box.tick(0.1 * (k + 1))
    assert "No space left on device" in box.problem
    assert 0 < box.failures < 40
    assert 1 <= len(said) < box.failures
    assert any("No space left on device" in line for line in said)
    box.close()
    assert (tmp_path / "log-0000005.log.gz").stat().st_size > 50


def test_a_folder_that_is_gone_is_said_once_however_many_segments_cannot_be_opened(tmp_path: Path):
    sender, said = Codec.load(SETTINGS.database, structs.replace(SETTINGS.can, bus="virtual")), []
    box = BlackBox(sender, Ring(tmp_path / "box", RingSettings(segment_s=1.0), "can0"), said.append)
    (tmp_path / "box").rename(tmp_path / "away")
    for k in range(80):
        box.receive(sender.encode("EEC1", {"engine_speed_rpm": 2000.0}, 0.1 * k))
        box.tick(0.1 * (k + 1))
    box.close()
    assert said == [f"{tmp_path / 'box'}: cannot be written: No such file or directory"]
