"""Who is on the bus in a drive of several processes: combine, operator, service, recorder; each is forked and served.

All of them share the kernel's monotonic clock: what they write down can be laid side by side. A drive begins for
combine and operator at the same instant, `begin_s` of that clock.
"""

import contextlib
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from cruise import settings as strict
from cruise.can.bus import Filter, open_bus
from cruise.can.codec import Codec
from cruise.can.j1939 import PGN_MASK
from cruise.can.log import LogWriter
from cruise.cli.places import CONFIG
from cruise.cli.run import Running
from cruise.plant import Combine, PlantSettings
from cruise.service.combine_node import CombineNode
from cruise.service.course import Drive
from cruise.service.cruise_node import CruiseNode
from cruise.service.daemon import Daemon
from cruise.service.loop import Ear, serve
from cruise.service.notify import Notifier
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings

TRUTH = ("time_s", "true_speed_mps", "true_accel_mps2", "by_cruise", "current_ma")
NOBODY = (Filter(0x7FF, 0x7FF, False),)  # the lowest priority there is, used by nobody here
KNOWN = ("time_s", "engaged", "setpoint_mps", "command_ma")


@dataclass(frozen=True)
class Process:
    """One of them."""

    pid: int

    def send(self, number: int) -> None:
        """Send it a signal."""
        os.kill(self.pid, number)

    def end(self, within_s: float = 20.0) -> int:
        """Ask it to stop and return its exit code. Raises TimeoutError."""
        self.send(signal.SIGINT)
        return self.ended(within_s)

    def ended(self, within_s: float) -> int:
        """Wait until it is gone and return its exit code. Raises TimeoutError."""
        deadline_s = time.monotonic() + within_s
        while time.monotonic() < deadline_s:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
        raise TimeoutError(f"process {self.pid} still runs after {within_s} s")


def start(work: Callable[[], object]) -> Process:
    """Run `work` in a process of its own; what is imported stays imported."""
    pid = os.fork()
    if pid:
        return Process(pid)
    code = 1
    try:
        work()
        code = 0
    finally:  # an error must not get into the frames of the process that was forked
        if code:
            traceback.print_exc()
        sys.stdout.flush()
        os._exit(code)


@contextlib.contextmanager
def killed_in_the_end() -> Iterator[Callable[[Callable[[], object]], Process]]:
    """Give `start`, and kill what still runs when this is left."""
    started: list[Process] = []

    def start_and_note(work: Callable[[], object]) -> Process:
        started.append(start(work))
        return started[-1]

    try:
        yield start_and_note
    finally:
        for process in started:
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                process.send(signal.SIGKILL)
                os.waitpid(process.pid, 0)


def combine(settings: CruiseSettings, drive: Drive, seed: int, begin_s: float, truth: Path) -> None:
    """The virtual combine; it writes down what it truly does."""
    with contextlib.suppress(PermissionError):  # a machine of iron is never late
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    machine = Combine(strict.load(CONFIG / "plant.yaml", PlantSettings), seed)
    node = CombineNode(machine, Codec.load(settings.database, settings.can), drive.field, drive.operator)
    running = Running()
    command = (Filter(settings.can.pgns.pump_current_command << 8, PGN_MASK, True),)
    with open_bus(settings.can, filters=command) as bus, truth.open("w", encoding="utf-8", buffering=1) as out:

        def write(now_s: float) -> None:
            true = machine.truth
            current_ma = node.command_ma if node.driven_by_cruise else 0.0
            _row(out, true.ground_speed_mps, true.acceleration_mps2, float(node.driven_by_cruise), current_ma)

        _wait_until(begin_s)
        serve(node, bus, running, write)


def operator(settings: CruiseSettings, drive: Drive, begin_s: float) -> None:
    """The operator's panel."""
    node, running = OperatorNode(Codec.load(settings.database, settings.can), drive.operator), Running()
    with open_bus(settings.can, filters=NOBODY) as bus:
        _wait_until(begin_s)
        serve(node, bus, running)


def recorder(settings: CruiseSettings, log: Path) -> None:
    """What `cruise record` does: a candump log, with the kernel's time stamps."""
    running = Running()
    with open_bus(settings.can) as bus, LogWriter.create(log, settings.can.channel) as writer:
        serve(Ear(writer.write, period_s=0.1), bus, running, wall_clock=True)


def service(settings: CruiseSettings, known: Path) -> None:
    """What `cruise run` does, with SIGHUP; it writes down what it knows, and in the end a report beside it."""
    running, states, late = Running(), [], {}
    with known.open("w", encoding="utf-8", buffering=1) as out:
        while not running.stopped:
            running.reload = False
            daemon = Daemon(settings, Notifier(""), lambda line: None)
            node = daemon.node

            def write(now_s: float, node: CruiseNode = node) -> None:
                engaged = node.engagement.state.controls
                setpoint_mps = node.engagement.setpoint_mps if engaged else float("nan")
                _row(out, float(engaged), setpoint_mps, node.command.current_ma)
                if not states or states[-1] != node.engagement.state:
                    states.append(str(node.engagement.state))

            daemon.run(running, write)
            lateness = daemon.lateness
            late = {
                "ticks": sum(lateness.counts),
                "missed": lateness.missed,
                "p50_ms": lateness.quantile_ms(0.5),
                "p99_ms": lateness.quantile_ms(0.99),
                "max_ms": lateness.worst_ms,
            }
            status = node.status(0.0)
            learned = status.learned
            report = {
                "states": states,
                "exit": [status.exit_reason.name.lower(), status.exit_condition, status.exit_detail],
                "parameters": dict(zip(learned.parameter_names, learned.theta, strict=True)),
                "standard_errors": dict(zip(learned.parameter_names, learned.theta_std, strict=True)),
                "lateness": late,
                "processor_s": time.process_time(),
            }
            known.with_suffix(".json").write_text(json.dumps(report), encoding="utf-8")


def read(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return the columns of what `combine` (TRUTH) or `service` (KNOWN) has written until now."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]  # the last one may be half written
    table = np.array([line.split() for line in lines], float).reshape(len(lines), len(names))
    return {name: table[:, i] for i, name in enumerate(names)}


def _row(out: TextIO, *values: float) -> None:
    out.write(" ".join(f"{value:.6g}" for value in values).join((f"{time.monotonic():.4f} ", "\n")))


def _wait_until(time_s: float) -> None:
    time.sleep(max(time_s - time.monotonic(), 0.0))
