"""The service as a machine's computer runs it: start, memory, exposure, and a million random frames."""

import os
import random
import resource
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.control.engagement import State
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode

from .figures import Figure, Part
from .recordings import CONFIG

ROOT = CONFIG.parent
SEED = 7
FRAMES = 1_000_000
FRAMES_A_TICK = 200  # twenty times of what a bus of 250 kbit/s carries in 50 ms
STARTS = 5
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
        before_s, begin_s = _child_s(), time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-c", SERVICE, "run", str(config), "--quiet"],
            env={**os.environ, "NOTIFY_SOCKET": str(address)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            assert systemd.recv(1000).startswith(b"READY=1")
            ready_s = time.monotonic() - begin_s
            time.sleep(1.0)
            status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        finally:
            process.terminate()
            process.wait()
    memory_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    return ready_s, _child_s() - before_s, memory_kb / 1024.0


def _child_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


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


def measure() -> Part:
    """All of it."""
    figures, notes = fuzz(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        starts = [start(folder) for _ in range(STARTS)]
        figures += [
            Figure("start_s", min(ready for ready, _, _ in starts), "s", f"start to ready, best of {STARTS}", 1.5),
            Figure("start_processor_s", min(used for _, used, _ in starts), "s", "processor time of a start and 1 s"),
            Figure("memory_mb", max(memory for _, _, memory in starts), "MB", "memory of the idle service", 160.0),
        ]
        for unit in ("cruise.service", "cruise-recorder.service"):
            value = exposure(unit)
            if value is None:
                notes.append(f"exposure of {unit} not measured: no systemd-analyze here")
            else:
                figures.append(Figure(f"exposure_{unit}", value, "1", f"systemd-analyze security, {unit}", 1.1))
    return Part(tuple(figures), (SEED,), tuple(notes))
