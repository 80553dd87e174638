"""The drive of `cruise demo` by four processes on the kernel's bus, and its log played back by can-utils."""

import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from cruise import settings as strict
from cruise.can.bus import open_bus
from cruise.cli.places import CONFIG
from cruise.plant import PlantSettings
from cruise.service import course, demo, replay
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import serve
from cruise.service.recordings import ReadingSettings
from tools.vcan import drive, players

SEED, SECONDS = 1, 180.0
REPLAYED_S = 30.0
# The figures of `cruise demo` with this seed, and how far they lie apart where only the sensors' noise is another one
# (6 seeds): twice that is noise.
NOISE = {
    "rms_error_mps": 0.002,
    "steady_error_mps": 0.0016,
    "overshoot_pct": 5.6,
    "command_above_1hz_rms_pct": 0.0076,
    "accel_max_mps2": 0.075,
    "engaged_s": 0.5,
}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return drive.run(drive.settings(), SECONDS, SEED, tmp_path_factory.mktemp("drive"))


def test_four_processes_drive_as_the_demo_does(driven: dict, note):
    plant = strict.load(CONFIG / "plant.yaml", PlantSettings)
    expected = demo.run(drive.settings(), plant, course.load(CONFIG / "demo.yaml"), SEED, SECONDS).report()
    for name in NOISE:
        note(f"drive_{name}", driven[name])
        note(f"demo_{name}", expected[name])
    for name in ("p50_ms", "p99_ms", "max_ms", "missed"):
        note(f"drive_late_{name}", driven["lateness"][name])
    far_off = {
        name: (driven[name], expected[name])
        for name, noise in NOISE.items()
        if not abs(driven[name] - expected[name]) <= noise
    }
    assert not far_off, "four processes, and the demo"
    assert driven["states"] == [one["state"] for one in expected["states"]]


def test_its_log_played_by_canplayer_teaches_what_it_teaches_offline(driven: dict, tmp_path: Path, note):
    log = tmp_path / "first.log"
    log.write_text("".join(_first(Path(driven["log"]), REPLAYED_S)), encoding="utf-8")
    settings = drive.settings()

    def learn() -> None:
        node = CruiseNode.load(settings)
        node.plausibility = None  # as in a replay: what the log holds was commanded by another run
        running = players.Running()
        with open_bus(settings.can, filters=node.codec.filters) as bus:
            (tmp_path / "ready").touch()
            serve(node, bus, running)
        np.save(tmp_path / "theta.npy", node.estimator.snapshot().theta)

    with players.killed_in_the_end() as start:
        learner = start(learn)
        while not (tmp_path / "ready").exists():
            time.sleep(0.05)
        subprocess.run(["canplayer", "-I", str(log)], check=True)
        assert learner.end() == 0
    estimator = replay.replay([log], settings, ReadingSettings()).node.estimator
    offline, factory = estimator.snapshot(), estimator.factory
    online = np.load(tmp_path / "theta.npy")
    assert not np.allclose(offline.theta, factory.theta, rtol=0.05), "it learned something"
    apart = float(np.max(np.abs(online - offline.theta) / offline.theta_std))
    note("replayed_apart_standard_errors", apart)
    assert apart <= 0.1


def _first(log: Path, seconds: float) -> list[str]:
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    times_s = [float(line.split(")")[0][1:]) for line in lines]
    return [line for line, time_s in zip(lines, times_s, strict=True) if time_s - times_s[0] <= seconds]
