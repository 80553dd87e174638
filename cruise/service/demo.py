"""The main job on one virtual bus: combine, cruise control and scripted operator, in lockstep on simulated time."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.can.log import LogWriter
from cruise.plant import Combine, PlantSettings
from cruise.service.combine_node import CombineNode
from cruise.service.course import Drive, vary
from cruise.service.cruise_node import CruiseNode
from cruise.service.figures import drive_figures
from cruise.service.loop import Ear, Lockstep
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings
from cruise.service.trace import Trace


@dataclass
class Result:
    """What a drive left behind."""

    seed: int
    seconds: float
    node: CruiseNode
    combine: Combine
    trace: Trace
    gates: Counter[str]
    states: list[tuple[float, str]] = field(default_factory=list)
    interrupted: bool = False
    last_exit: str = ""  # why it let go last; not that it did so when the drive was over

    def report(self) -> dict[str, Any]:
        """All figures under stable names; NaN becomes None, so that it is JSON."""
        status = self.node.status(self.seconds)
        limits = self.node.settings.control.limits
        figures = drive_figures(self.trace.columns(), self.node.period_s, limits.current_max_ma - limits.current_min_ma)
        names = status.learned.parameter_names
        driven = sum(self.gates.values()) or 1
        report = {
            "seed": self.seed,
            "seconds": self.seconds,
            "interrupted": self.interrupted,
            **figures,
            "error_ahead_mps": status.rms_ahead_mps,
            "parameters": dict(zip(names, status.learned.theta, strict=True)),
            "standard_errors": dict(zip(names, status.learned.theta_std, strict=True)),
            "factory_parameters": dict(zip(names, self.node.estimator.factory.theta, strict=True)),
            "models_adopted": status.adoptions,
            "decisions": [one.as_json() for one in self.node.supervisor.decisions],
            "gate_share": {gate: count / driven for gate, count in sorted(self.gates.items())},
            "states": [{"time_s": time_s, "state": state} for time_s, state in self.states],
            "exit_reason": status.exit_reason.name.lower(),
            "last_exit": self.last_exit,
            "frame_faults": {name: count for name, count in sorted(status.faults.items()) if name != "unknown"},
        }
        return _plain(report)


def run(
    settings: CruiseSettings,
    plant: PlantSettings,
    drive: Drive,
    seed: int,
    seconds: float,
    log: Path | None = None,
    pace: float = 0.0,
    show: Callable[[float, Result], None] | None = None,
) -> Result:
    """Drive for `seconds` of simulated time; the same seed gives the same drive, figure for figure."""
    drive = vary(drive, seed)
    can = msgspec.structs.replace(settings.can, bus="virtual", channel=f"demo-{seed}")
    codecs = [Codec.load(settings.database, can) for _ in range(2)]
    combine = Combine(plant, seed)
    node = CruiseNode.load(msgspec.structs.replace(settings, can=can))
    machine = CombineNode(combine, codecs[0], drive.field, drive.operator)
    panel = OperatorNode(codecs[1], drive.operator)
    result = Result(seed, seconds, node, combine, Trace(), Counter())
    buses = [open_bus(can) for _ in range(4 if log else 3)]
    writer = LogWriter.create(log) if log else None
    try:
        nodes = [machine, panel, node, *([Ear(writer.write)] if writer else [])]
        loop = Lockstep(list(zip(nodes, buses, strict=True)))
        per_frame = round(node.period_s / loop.step_s)

        def each_step(now_s: float) -> None:
            if loop.steps % per_frame:
                return
            result.trace.add(now_s, node, combine)
            if node.ticks % node.controller.frames == 1 % node.controller.frames:
                result.gates[str(node.learned.gate)] += 1
            state = str(node.engagement.state)
            if not result.states or result.states[-1][1] != state:
                result.states.append((round(now_s, 3), state))
            if show is not None:
                show(now_s, result)

        try:
            loop.run(seconds, each_step, pace)
        except KeyboardInterrupt:
            result.interrupted, result.seconds = True, loop.now_s
        result.last_exit = node.engagement.ended_by
        for frame in node.stop(loop.now_s):
            buses[2].send(frame)
        loop.run(loop.now_s + 2 * loop.step_s)
    finally:
        if writer is not None:
            writer.close()
        for bus in buses:
            bus.close()
    return result


def _plain(value: Any) -> Any:
    """Numbers as JSON knows them."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
