"""What surrounds the virtual machine: what is said where it can't be had, what it is made of, the command as it was."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tools.vcan import debian, machine

ROOT = Path(__file__).parents[2]


def test_a_machine_without_debian_is_told_what_is_missing(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(debian.UnavailableError, match="apt-get and dpkg-deb"):
        debian.parts(lambda line: None)


def test_what_apt_says_is_passed_on_and_nothing_half_fetched_is_kept(tmp_path: Path, monkeypatch):
    for name in ("apt-get", "dpkg-deb"):
        (tmp_path / name).write_text("#!/bin/sh\necho 'E: Unable to locate package' >&2; exit 100\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(debian.UnavailableError, match=r"apt-get .* failed: E: Unable to locate package"):
        debian.parts(lambda line: None)
    assert [path.name for path in (tmp_path / "cruise-vcan").iterdir()] == ["lock"]


def test_the_parts_are_where_the_packages_have_them_whatever_their_version(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "cruise-vcan/unpacked/usr/lib/uml/modules/6.1.999").mkdir(parents=True)
    parts = debian.parts(lambda line: None)
    assert parts.kernel == tmp_path / "cruise-vcan/unpacked/usr/bin/linux.uml"
    names = [path.stem for path in parts.modules]
    assert names.index("can") < names.index("can-raw") < names.index("can-j1939")
    assert names.index("can-dev") < names.index("vcan")
    assert all("6.1.999/kernel" in str(path) for path in parts.modules)


def test_a_processor_with_more_registers_than_the_kernel_knows_asks_for_a_compiler(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(machine, "NEW_REGISTERS", "in no processor")
    assert machine._with_all_registers(tmp_path) == []
    monkeypatch.setattr(machine, "NEW_REGISTERS", "")
    if shutil.which("cc"):
        *_, preloaded = machine._with_all_registers(tmp_path)
        assert Path(preloaded.removeprefix("LD_PRELOAD=")).is_file()
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(debian.UnavailableError, match="apt: gcc"):
        machine._with_all_registers(tmp_path)


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
