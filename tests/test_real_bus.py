"""The tests of tests/real_bus, run where a kernel has a CAN bus: here, or in a small virtual machine."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

ROOT = Path(__file__).parents[1]
NOT_HERE = 77  # tools/vcan_machine: no bus can be had on this machine
FAILED = 1  # pytest: some test failed
LONGEST_S = 900.0  # each; they drive in real time
INNER = ("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--confcutdir=tests/real_bus", "--junitxml")


def in_the_machine(command: list[str], keep: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(ROOT / "tools/vcan_machine"), "--keep", str(keep), *command],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )


def test_on_a_kernel_with_can_and_there_under_systemd(tmp_path: Path, record_property):
    """One after the other: side by side they would make each other late.

    They hold milliseconds on a machine that others may use as well, so that what failed has a second try.
    """
    for how, folder in ([], "tests/real_bus"), (["--systemd"], "tests/real_bus/under_systemd"):
        report = tmp_path / f"{len(how)}.xml"
        command = [*how, sys.executable, "-m", "pytest", *INNER, str(report), folder]
        ran = in_the_machine(command, tmp_path)
        if ran.returncode == FAILED:
            record_property(f"{folder}: tried again after", ran.stdout[-6000:])
            ran = in_the_machine(command, tmp_path)
        if ran.returncode == NOT_HERE and os.environ.get("CI") != "true":
            pytest.skip(f"the tests on a real bus are NOT RUN: {ran.stderr.strip().splitlines()[-1]}")
        assert ran.returncode == 0, f"{ran.stderr[-2000:]}\n{ran.stdout[-6000:]}"
        suite = next(ET.parse(report).iter("testsuite"))
        record_property(folder, suite.attrib["tests"])
        assert int(suite.attrib["tests"]) > 0
        assert suite.attrib["skipped"] == "0", ran.stdout[-3000:]
