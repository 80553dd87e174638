"""What surrounds the virtual machine: what is said where it can't be had, modules in order, the command as it was."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tools.vcan import debian, machine

ROOT = Path(__file__).parents[2]


def test_a_machine_without_qemu_and_without_root_is_told_what_is_missing(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(debian.UnavailableError, match=r"qemu-system-x86_64 is not installed.*by hand"):
        debian.parts(lambda line: None)


def test_a_machine_with_qemu_but_without_debian_is_told_too(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda name: name if name == debian.QEMU else None)
    with pytest.raises(debian.UnavailableError, match="apt-get and dpkg-deb"):
        debian.parts(lambda line: None)


def test_modules_come_after_what_they_need_and_once(tmp_path: Path):
    folder = tmp_path / "lib/modules/6.1"
    folder.mkdir(parents=True)
    (folder / "modules.dep").write_text(
        "kernel/can-j1939.ko: kernel/can.ko\n"
        "kernel/can.ko:\n"
        "kernel/9pnet_virtio.ko: kernel/virtio_ring.ko kernel/9pnet.ko\n"
        "kernel/9pnet.ko:\n"
        "kernel/virtio_ring.ko: kernel/virtio.ko\n"
        "kernel/virtio.ko:\n"
        "kernel/sound.ko:\n"
        "kernel/can-raw.ko: kernel/can.ko\n"
    )
    order = [path.stem for path in debian._ordered(tmp_path, Path("vmlinuz-6.1"))]
    assert order == ["virtio", "virtio_ring", "9pnet", "9pnet_virtio", "can", "can-raw", "can-j1939"]


def test_the_command_runs_where_and_as_it_was_given(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CRUISE_WORD", "it's $HOME")
    monkeypatch.setenv("SECRET", "not passed on")
    script = machine._script(["sh", "-c", 'pwd; echo "$CRUISE_WORD,$SECRET,$CRUISE_VCAN,$1"', "sh", "a  b"], Path("/x"))
    shown = subprocess.run(
        ["sh", "-c", script], capture_output=True, text=True, check=True, env={"PATH": os.environ["PATH"]}
    ).stdout
    assert shown.splitlines() == [str(tmp_path), "it's $HOME,,vcan0,a  b"]


def test_where_only_the_kernel_at_hand_may_serve_it_serves_or_says_why_not():
    ran = subprocess.run(
        [str(ROOT / "tools/vcan_machine"), "--here", "sh", "-c", "ip -brief link show vcan0"],
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode == 0:
        assert ran.stdout.startswith("vcan0")
    else:
        assert ran.returncode == 77
        assert "NOT RUN" in ran.stderr
