"""A running service as it is watched: its bus is heard, nothing is ever sent.

What the service knows but does not put on the bus (parameters, gate, running errors) is what the same program makes of
the same frames: a listening twin of it learns along. With the virtual combine, the service itself is watched.
"""

import math
from collections import deque
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from statistics import median
from threading import Lock
from typing import Final

import msgspec
import numpy as np

from cruise import settings as strict
from cruise.can.bus import open_bus
from cruise.can.frame import Frame
from cruise.can.log import LogWriter
from cruise.plant import PlantSettings
from cruise.service import course, demo
from cruise.service import settings as service_settings
from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode, Status
from cruise.service.demo import Result
from cruise.service.loop import serve
from cruise.service.settings import CruiseSettings

KEPT_S: Final = 900.0  # s that are shown and can be diagnosed
EVERY_S: Final = 0.2  # s between two rows: the period of the model
SILENT_S: Final = 2.0  # s without a speed, after which nothing is heard
WORSE: Final = 1.5  # times the usual running error: the model has become worse
SETTLED_S: Final = 60.0  # s of errors, before which there is nothing usual
ROUNDS: Final = 20  # of the demo's drive, one hour
SEED: Final = 1


@dataclass(frozen=True, slots=True)
class Row:
    """One instant."""

    time_s: float
    setpoint_mps: float
    speed_mps: float
    current_ma: float
    engaged: float
    driving_mps: float  # running 3 s ahead error of the model that drives
    learned_mps: float
    persistence_mps: float


class Stopped(Exception):  # noqa: N818  # no error: the watcher has seen enough
    """Ends the watching."""


class Live:
    """What is watched at present, for all who look."""

    def __init__(self) -> None:
        self.title = ""
        self.running = False
        self.fault = ""
        self.status: Status | None = None
        self.rows: deque[Row] = deque(maxlen=round(KEPT_S / EVERY_S))
        self.log: Path | None = None
        self.settings: CruiseSettings | None = None  # of the service: its model, its database, its addresses
        self.turning = Lock()  # held while a log that is full becomes the earlier one

    def begin(self, title: str, folder: Path, settings: CruiseSettings) -> Path:
        """A new watch: everything that was heard before is forgotten. Returns where the log of the bus goes."""
        self.title, self.running, self.fault, self.status, self.settings = title, True, "", None, settings
        self.rows.clear()
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / "live.log"
        earlier(self.log).unlink(missing_ok=True)
        return self.log

    def stop(self) -> None:
        """Watch no longer."""
        self.running = False

    def see(self, now_s: float, node: CruiseNode) -> None:
        """Take in the service as it is now. Raises Stopped once nobody watches any more."""
        if not self.running:
            raise Stopped
        if self.rows and now_s - self.rows[-1].time_s < EVERY_S - 1e-6:
            return
        status = node.status(now_s)
        engaged = status.state.controls
        errors = status.rms_ahead_mps
        self.status = status
        self.rows.append(
            Row(
                time_s=now_s,
                setpoint_mps=status.setpoint_mps if engaged else math.nan,
                speed_mps=status.speed_mps,
                current_ma=status.current_ma,
                engaged=float(engaged),
                driving_mps=errors.get("driving", math.nan),
                learned_mps=errors.get("learned", math.nan),
                persistence_mps=errors.get("persistence", math.nan),
            )
        )

    def doing(self) -> tuple[str, bool]:
        """How the model is doing, and whether that is bad."""
        rows = list(self.rows)
        if (
            self.running
            and rows
            and not any(math.isfinite(row.speed_mps) for row in rows[-round(SILENT_S / EVERY_S) :])
        ):
            return "Nothing is heard of the machine's speed: does it send, and on this bus?", True
        since = worse_since(rows)
        if since is not None:
            words = (
                f"The model has become worse since {since:.0f} s: its error is above one and a half times the usual."
            )
            return words, True
        judged = any(math.isfinite(row.driving_mps) for row in rows)
        return "The model is as good as usual." if judged else "The model has not been judged yet.", False

    def columns(self) -> dict[str, np.ndarray]:
        """Everything that is kept, by the names of a row."""
        table = np.array([astuple(row) for row in list(self.rows)], float).reshape(-1, len(fields(Row)))
        return {field.name: table[:, i].copy() for i, field in enumerate(fields(Row))}

    def taken(self, folder: Path) -> Path:
        """The log of the bus so far, whole lines of it, where it can be read while more is written."""
        assert self.log is not None
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "live.log"
        with self.turning:
            text = b"".join(log.read_bytes() for log in (earlier(self.log), self.log) if log.exists())
        path.write_bytes(text[: text.rfind(b"\n") + 1])
        return path


def earlier(log: Path) -> Path:
    """Where what was heard before the log began is kept: together they hold `KEPT_S`, and twice that at most."""
    return log.with_name(f"earlier_{log.name}")


def worse_since(rows: list[Row]) -> float | None:
    """Since when [s] the running error of the model that drives is above what is usual for it; None where it is not.

    Usual is the median since the errors began; a minute of them is needed.
    """
    known = [row for row in rows if math.isfinite(row.driving_mps)]
    if not known or known[-1].time_s - known[0].time_s < SETTLED_S:
        return None
    bar_mps = WORSE * median(row.driving_mps for row in known)
    since = None
    for row in reversed(known):
        if row.driving_mps <= bar_mps:
            break
        since = row.time_s
    return since


def watch_combine(live: Live, config: Path, folder: Path, pace: float) -> None:
    """The virtual combine, service and operator in this process, `pace` times as fast as the clock."""
    settings = service_settings.load(config / "cruise.yaml")
    log = live.begin("the virtual combine", folder, settings)
    drive = again_and_again(course.load(config / "demo.yaml"), ROUNDS)

    def show(now_s: float, result: Result) -> None:
        live.see(now_s, result.node)

    try:
        plant = strict.load(config / "plant.yaml", PlantSettings)
        demo.run(settings, plant, drive, SEED, drive.seconds, log=log, pace=pace, show=show)
    except Stopped:
        pass
    finally:
        live.running = False


def watch_bus(live: Live, config: Path, folder: Path) -> None:
    """The bus of the settings, where `cruise run` drives: a twin of the service listens and learns along."""
    settings = service_settings.load(config)
    log = live.begin(f"{settings.can.bus} {settings.can.channel}", folder, settings)
    node = CruiseNode.load(settings)
    node.plausibility = None  # the service on the bus sends what this node would, and does not contradict it
    twin = Twin(node, log, live.turning)
    try:
        with open_bus(settings.can) as bus:
            serve(twin, bus, lambda: live.running, lambda now_s: live.see(now_s, twin.node))
    except Stopped:
        pass
    finally:
        live.running = False
        twin.writer.close()


class Twin:
    """The service as a listener: it takes every frame in, learns, writes the log, and sends nothing."""

    def __init__(self, node: CruiseNode, log: Path, turning: Lock) -> None:
        self.node = node
        self.period_s = node.period_s
        self.log, self.turning = log, turning
        self.writer = LogWriter.create(log)
        self.full_s = math.nan

    def receive(self, frame: Frame) -> None:
        """Take one frame in."""
        self.writer.write(frame)
        self.node.receive(frame)

    def tick(self, now_s: float) -> list[Frame]:
        """One period on; what the service would send stays here."""
        self.node.tick(now_s)
        self.writer.flush()
        if math.isnan(self.full_s):
            self.full_s = now_s + KEPT_S
        elif now_s >= self.full_s:
            self._turn(now_s)
        return []

    def _turn(self, now_s: float) -> None:
        """The log is full: it becomes the earlier one."""
        with self.turning:
            self.writer.close()
            self.log.replace(earlier(self.log))
            self.writer = LogWriter.create(self.log)
        self.full_s = now_s + KEPT_S


def again_and_again(drive: Drive, rounds: int) -> Drive:
    """A drive whose field and setpoints come again, the operator's start once."""
    field: list[FieldRow] = []
    operator: list[OperatorRow] = []
    for number in range(rounds):
        later_s = number * drive.seconds
        field += [msgspec.structs.replace(row, at_s=row.at_s + later_s) for row in drive.field]
        operator += [
            msgspec.structs.replace(row, at_s=row.at_s + later_s)
            for row in drive.operator
            if number == 0 or row.setpoint_mps is not None
        ]
    return Drive(seconds=rounds * drive.seconds, field=tuple(field), operator=tuple(operator))
