"""The black box's ring: readable to the last second, bounded, frozen around an exit, numbers that go on."""

import errno
import os
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest
from msgspec import structs

from cruise.can.frame import Frame
from cruise.can.log import LogError, read_log
from cruise.can.ring import Ring, RingSettings

SETTINGS = RingSettings(size_bytes=1_000_000, segment_s=10.0, before_s=15.0, after_s=12.0)


def frame(number: int, time_s: float) -> Frame:
    data = (number * 2654435761 % 2**64).to_bytes(8, "little")  # nothing that compresses well
    return Frame(arbitration_id=0x18FF1003, data=data, timestamp=1.7e9 + time_s)


def fill(ring: Ring, begin_s: float, end_s: float, per_s: int = 10) -> None:
    for number in range(round(begin_s * per_s), round(end_s * per_s)):
        ring.write(frame(number, number / per_s), number / per_s)


def names(ring: Ring) -> list[str]:
    return [path.name.removesuffix(".log.gz") for path in ring.segments()]


def test_every_frame_is_there_once_and_in_order(tmp_path: Path):
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 35.0)
    ring.close()
    assert names(ring) == ["log-0000001", "log-0000002", "log-0000003", "log-0000004"]
    read = [one for path in ring.segments() for one in read_log(path)]
    assert [one.timestamp for one in read] == pytest.approx([1.7e9 + k / 10 for k in range(350)], abs=1e-6)
    assert [bytes(one.data) for one in read] == [bytes(frame(k, 0.0).data) for k in range(350)]


def test_where_the_power_goes_all_but_the_last_second_can_be_read(tmp_path: Path):
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 8.0)
    copy = tmp_path / "cut.log.gz"
    copy.write_bytes(ring.segments()[-1].read_bytes())
    read: list[Frame] = []
    with pytest.raises(LogError, match="cannot be read"):
        read.extend(read_log(copy))  # it takes what comes before the error
    assert 69 <= len(read) <= 80
    ring.close()


def test_what_is_flushed_is_brought_to_the_disk_and_no_frame_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The system alone would keep it in memory for half a minute, and the power takes that with it."""
    brought, ready = [], Event()

    def slow(descriptor: int) -> None:
        brought.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        assert ready.wait(60.0)

    monkeypatch.setattr(os, "fdatasync", slow)
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 8.0)
    ready.set()
    ring.close()
    assert brought == 2 * ["log-0000001.log.gz"], "once for all the time that the disk took, and once at the end"


def test_what_did_not_reach_the_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def broken(descriptor: int) -> None:
        raise OSError(errno.EIO, "on purpose")

    def disk_is_done() -> None:
        ring._disk.submit(lambda: None).result()

    ring = Ring(tmp_path, SETTINGS, "can0")
    monkeypatch.setattr(os, "fdatasync", broken)
    fill(ring, 0.0, 1.5)
    disk_is_done()
    monkeypatch.undo()
    with pytest.raises(OSError, match="on purpose"):
        fill(ring, 1.5, 2.5)
    disk_is_done()
    fill(ring, 2.5, 4.5)
    ring.close()


def test_the_end_of_a_segment_is_brought_to_the_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    on_disk: dict[str, bytes] = {}

    def held(descriptor: int) -> None:
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        on_disk[path.name] = path.read_bytes()

    monkeypatch.setattr(os, "fdatasync", held)
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 25.5)
    ring.close()
    assert on_disk == {path.name: path.read_bytes() for path in ring.segments()}
    assert len(on_disk) == 3


def test_an_end_that_did_not_reach_the_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def broken(descriptor: int) -> None:
        raise OSError(errno.EIO, "on purpose")

    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 0.5)
    monkeypatch.setattr(os, "fdatasync", broken)
    with pytest.raises(OSError, match="on purpose"):
        ring.close()


def test_around_an_exit_it_is_frozen(tmp_path: Path):
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 45.0)
    ring.freeze(45.0)
    fill(ring, 45.0, 80.0)
    ring.close()
    kinds = {name: name.split("-")[0] for name in names(ring)}
    # Segments begin every 10 s: the exit at 45 s keeps from 30 s at the latest to 57 s at least.
    assert [kinds[name] for name in names(ring)] == ["log", "log", "exit", "exit", "exit", "exit", "log", "log"]


def test_it_never_exceeds_its_bound_and_exits_outlive_the_rest(tmp_path: Path):
    small = RingSettings(size_bytes=20_000, segment_s=10.0, before_s=0.0, after_s=0.0)
    ring = Ring(tmp_path, small, "can0")
    fill(ring, 0.0, 20.0)
    ring.freeze(20.0)
    largest = 0
    for begin_s in range(20, 400, 10):
        fill(ring, float(begin_s), begin_s + 10.0)
        largest = max(largest, sum(path.stat().st_size for path in ring.segments()))
    ring.close()
    assert largest <= small.size_bytes + 1_500, "but for what has not been flushed"
    assert any(name.startswith("exit") for name in names(ring))
    assert names(ring)[-1] == "log-0000040"
    assert len(names(ring)) < 40


def test_many_exits_do_not_push_the_present_out(tmp_path: Path):
    small = RingSettings(size_bytes=20_000, segment_s=10.0, before_s=5.0, after_s=5.0)
    ring = Ring(tmp_path, small, "can0")
    for begin_s in range(0, 400, 10):
        fill(ring, float(begin_s), begin_s + 10.0)
        ring.freeze(begin_s + 10.0)
    ring.close()
    assert sum(path.stat().st_size for path in ring.segments()) <= small.size_bytes
    assert names(ring)[-1].endswith("40")


def test_a_disk_smaller_than_its_bound_is_not_filled_and_exits_outlive_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def of_a_small_disk(folder: Path) -> SimpleNamespace:
        return SimpleNamespace(free=40_000 - others - sum(path.stat().st_size for path in folder.iterdir()))

    others = 0
    monkeypatch.setattr("shutil.disk_usage", of_a_small_disk)
    ring = Ring(tmp_path, structs.replace(SETTINGS, left_bytes=10_000), "can0")
    least = 40_000
    for begin_s in range(0, 600, 10):
        fill(ring, float(begin_s), begin_s + 10.0)
        least = min(least, of_a_small_disk(tmp_path).free)
        if begin_s == 100:
            ring.freeze(begin_s + 10.0)
    assert least >= 10_000 - 1_500, "but for what has not been flushed"
    assert names(ring)[-1] == "log-0000060"
    assert [name for name in names(ring) if name.startswith("exit")] == [f"exit-{k:07}" for k in (10, 11, 12, 13)]
    others = 40_000
    fill(ring, 600.0, 620.0)
    ring.close()
    assert [name for name in names(ring) if name.startswith("log")] == ["log-0000062"], "the present"
    assert len(names(ring)) == 5, "who else fills the disk takes no exit away"


def test_numbers_go_on_at_the_next_start(tmp_path: Path):
    for _ in range(3):
        ring = Ring(tmp_path, SETTINGS, "can0")
        fill(ring, 0.0, 1.0)
        ring.close()
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert kept == [f"log-{number:07}.log.gz" for number in (1, 2, 3)]


def test_other_files_in_the_folder_are_left_alone(tmp_path: Path):
    others = [
        tmp_path / name for name in ("drive-20240101.log.gz", "drive-2.log.gz", "log-1.log.gz", "log-0000009.log")
    ]
    for other in others:
        other.write_bytes(b"x" * 100_000)
    ring = Ring(tmp_path, SETTINGS, "can0")
    fill(ring, 0.0, 60.0)
    ring.close()
    assert all(other.exists() for other in others)
    assert names(ring) == [f"log-{number:07}" for number in range(1, 7)]


def test_a_folder_that_is_gone_when_a_segment_ends_costs_no_more_than_a_second_beyond(tmp_path: Path):
    folder, away = tmp_path / "box", tmp_path / "away"
    ring = Ring(folder, SETTINGS, "can0")
    lost = 0
    for number in range(300):
        if number == 95:
            folder.rename(away)
        if number == 115:
            away.rename(folder)
        try:
            ring.write(frame(number, number / 10), number / 10)
        except (OSError, ValueError):
            lost += 1
    ring.close()
    assert 15 <= lost <= 25
    assert len(names(ring)) == 3
    assert sum(1 for path in ring.segments() for _ in read_log(path)) == 300 - lost
