"""The service as a machine's computer runs it: start, memory, exposure, random frames, and what happens on a real bus.

The last comes from the tests in tests/real_bus, which keep their figures; they run where tools/vcan_machine has a bus.
"""

import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from msgspec import structs

from cruise import settings
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.control.engagement import State
from cruise.model import files
from cruise.plant import PlantSettings
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode

from . import loop
from .figures import Figure, Part
from .recordings import CONFIG

ROOT = CONFIG.parent
SEED = 7
FRAMES = 1_000_000
FRAMES_A_TICK = 200  # twenty times of what a bus of 250 kbit/s carries in 50 ms
STARTS = 5
SHARE_S = 60.0  # s of driving over which the processor's share is taken
NOT_HERE = 77  # tools/vcan_machine: no bus can be had
NEUTRAL_MS = 300.0
# What the tests on a real bus keep: key, unit, meaning, target.
ON_THE_BUS: tuple[tuple[str, str, str, float | None], ...] = (
    ("drive_late_p50_ms", "ms", "four processes drive: lateness of the service at 20 Hz, p50", None),
    ("drive_late_p99_ms", "ms", "the same, p99", None),
    ("drive_late_max_ms", "ms", "the same, max", None),
    ("drive_late_missed", "1", "ticks left out in that drive", 0.0),
    (
        "replayed_apart_standard_errors",
        "1",
        "its log played by canplayer and offline: parameters, standard errors",
        0.1,
    ),
    ("neutral_after_stop_ms", "ms", "machine neutral after SIGINT", NEUTRAL_MS),
    ("neutral_after_reload_ms", "ms", "after SIGHUP", NEUTRAL_MS),
    ("neutral_after_kill_ms", "ms", "after SIGKILL: the drive's time-out", NEUTRAL_MS),
    ("neutral_after_pause_ms", "ms", "after SIGSTOP: the same", NEUTRAL_MS),
    ("full_bus_p50_ms", "ms", "a bus that two cangen fill: lateness, p50", None),
    ("full_bus_p99_ms", "ms", "the same, p99", None),
    ("full_bus_max_ms", "ms", "the same, max", None),
    ("full_bus_missed", "1", "ticks left out meanwhile, all counted", None),
    ("systemd_neutral_after_stop_ms", "ms", "systemd: neutral after the process ended", NEUTRAL_MS),
    ("systemd_neutral_after_reload_ms", "ms", "after systemd passed the reload on", NEUTRAL_MS),
    ("systemd_neutral_after_freeze_ms", "ms", "after the loop froze", NEUTRAL_MS),
    ("systemd_gone_after_freeze_ms", "ms", "the watchdog has killed it", None),
    ("systemd_neutral_after_crash_ms", "ms", "after it crashed", NEUTRAL_MS),
    ("systemd_memory_mb", "MB", "memory under systemd, all locked", 160.0),
)
DRIVE = ("rms_error_mps", "steady_error_mps", "overshoot_pct", "command_above_1hz_rms_pct", "accel_max_mps2")
# As tools/install has it: without the extras, one of which python-can would import.
SERVICE = "import sys; sys.modules['asammdf'] = None; from cruise.cli import main; main()"


def random_frames(count: int, known: list[int]) -> list[Frame]:
    """Half of them with an identifier of ours, so that they get past the first look."""
    draw = random.Random(SEED)
    return [
        Frame(
            arbitration_id=draw.choice(known) if draw.random() < 0.5 else draw.getrandbits(29),
            data=draw.randbytes(draw.randrange(9)),
            is_extended_id=draw.random() < 0.9,
            is_remote_frame=draw.random() < 0.01,
            is_error_frame=draw.random() < 0.01,
            timestamp=0.0,
        )
        for _ in range(count)
    ]


def fuzz(count: int = FRAMES) -> list[Figure]:
    """Hand random frames to a codec and to a whole node; anything that raises ends the benchmark."""
    settings = service_settings.load(CONFIG / "cruise.yaml")
    codec, node = Codec.load(settings.database, settings.can), CruiseNode.load(settings)
    known = [one.identifier | draw for one in codec.filters for draw in (0x00, 0x03, 0x11, 0x31, 0xE2, 0xF0)]
    frames, engaged, taken_s = random_frames(min(count, 100_000), known), 0, 0.0
    for begin in range(0, count, len(frames)):
        begin_s = time.perf_counter()
        for frame in frames:
            codec.decode(frame)
        taken_s += time.perf_counter() - begin_s
        for k, frame in enumerate(frames if begin == 0 else ()):
            frame.timestamp = now_s = node.period_s * (k // FRAMES_A_TICK + 1)
            node.receive(frame)
            if k % FRAMES_A_TICK == 0:
                node.tick(now_s)
                engaged += node.engagement.state is not State.OFF and node.engagement.state.controls
    return [
        Figure("fuzz_frames", float(count), "1", "random frames at the codec, none raised"),
        Figure("fuzz_us", 1e6 * taken_s / count, "us", "decoding one of them"),
        Figure("fuzz_engaged", float(engaged), "1", "ticks engaged under random frames", 0.0),
    ]


def start(folder: Path) -> tuple[float, float, float]:
    """Start the service once: s to ready, s of processor until then, MB of memory while it runs."""
    config = folder / "cruise.yaml"
    text = (CONFIG / "cruise.yaml").read_text(encoding="utf-8").replace("bus: socketcan", "bus: virtual")
    for name in ("factory_model.yaml", "cruise.dbc"):
        text = text.replace(f" {name}", f" {CONFIG / name}")
    config.write_text(f"{text}\ndictionary: {CONFIG / 'cruise.eds'}\n", encoding="utf-8")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        address = folder / "notify"
        address.unlink(missing_ok=True)
        systemd.bind(str(address))
        systemd.settimeout(300.0)
        begin_s = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-c", SERVICE, "run", str(config), "--quiet"],
            env={**os.environ, "NOTIFY_SOCKET": str(address)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            assert systemd.recv(1000).startswith(b"READY=1")
            ready_s = time.monotonic() - begin_s
            used = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]
            time.sleep(1.0)
            status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        finally:
            process.terminate()
            process.wait()
    memory_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    return ready_s, sum(map(int, used)) / os.sysconf("SC_CLK_TCK"), memory_kb / 1024.0


def exposure(unit: str) -> float | None:
    """What systemd-analyze makes of a unit; None where it isn't here."""
    try:
        shown = subprocess.run(
            ["systemd-analyze", "security", "--offline=true", "--no-pager", str(ROOT / "systemd" / unit)],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return float(next(line for line in shown.splitlines() if "exposure level" in line).split(":")[1].split()[0])


def share(seconds: float = SHARE_S) -> float:
    """The share of a core that the node takes while 100 speeds a second come in; the kernel's calls are not in it."""
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    fast = structs.replace(plant.sensors.drive_feedback, rate_hz=100.0)
    plant = structs.replace(plant, sensors=structs.replace(plant.sensors, drive_feedback=fast))
    model = files.load(cruise.model)
    frames, node, ticks = loop.frames_of(cruise, plant, model, seconds), CruiseNode.load(cruise), 0
    begin_s = time.process_time()
    for at_s, frame in frames:
        while (ticks + 1) * node.period_s < at_s:
            ticks += 1
            node.tick(ticks * node.period_s)
        node.receive(frame)
    return (time.process_time() - begin_s) / seconds


def on_the_bus(folder: Path) -> dict[str, float] | None:
    """Run the tests on a real bus and return the figures that they keep; None where no bus can be had."""
    kept: dict[str, float] = {}
    for how, where in ([], "tests/real_bus"), (["--systemd"], "tests/real_bus/under_systemd"):
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
        ran = subprocess.run(
            [
                str(ROOT / "tools/vcan_machine"),
                "--keep",
                str(folder),
                *how,
                *command,
                "--confcutdir=tests/real_bus",
                where,
            ],
            cwd=ROOT,
            env={**os.environ, "CRUISE_KEEP": str(folder)},
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.returncode == NOT_HERE:
            return None
        if ran.returncode != 0:
            raise RuntimeError(f"{where} fails:\n{ran.stdout[-3000:]}")
    for line in (folder / "figures.jsonl").read_text(encoding="utf-8").splitlines():
        kept |= json.loads(line)
    return kept


def measure() -> Part:
    """All of it."""
    figures, notes = fuzz(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        starts = [start(folder) for _ in range(STARTS)]
        figures += [
            Figure("start_s", min(ready for ready, _, _ in starts), "s", f"start to ready, best of {STARTS}", 1.5),
            Figure(
                "start_processor_s", min(used for _, used, _ in starts), "s", "its processor time: all, if idle", 1.5
            ),
            Figure("memory_mb", max(memory for _, _, memory in starts), "MB", "memory of the idle service", 160.0),
        ]
        for unit in ("cruise.service", "cruise-recorder.service"):
            value = exposure(unit)
            if value is None:
                notes.append(f"exposure of {unit} not measured: no systemd-analyze here")
            else:
                figures.append(Figure(f"exposure_{unit}", value, "1", f"systemd-analyze security, {unit}", 1.1))
        figures.append(Figure("share_100_hz_pct", 100.0 * share(), "%", "of a core, driving with input at 100 Hz"))
        kept = on_the_bus(folder)
    if kept is None:
        notes.append("nothing measured on a real bus: no SocketCAN here, and no virtual machine")
    else:
        figures += [Figure(key, kept[key], unit, meaning, most) for key, unit, meaning, most in ON_THE_BUS]
        for name in DRIVE:
            unit = name.rpartition("_")[2].replace("mps2", "m/s2").replace("mps", "m/s").replace("pct", "%")
            demo = f"four processes on a bus; cruise demo with the same seed: {kept[f'demo_{name}']:.4g}"
            figures.append(Figure(f"drive_{name}", kept[f"drive_{name}"], unit, demo))
    return Part(tuple(figures), (SEED,), tuple(notes))
