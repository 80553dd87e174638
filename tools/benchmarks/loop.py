"""How late the real-time loop is at 100 Hz: the service's own loop and node, on a virtual bus, fed in real time.

The frames of combine and operator are taken down from a drive in lockstep and then played at their times by a thread,
so that nothing but the node computes while it is timed. The node engages and plans as it did in that drive; its
commands go nowhere. Between sending thread and loop lies Python's lock, not a kernel's CAN interface.
"""

import os
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec import structs

from cruise import settings
from cruise.can.bus import Bus, open_bus
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.identification.least_squares import fit
from cruise.model import files
from cruise.model.model import Model
from cruise.plant import Combine, PlantSettings
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import Drive, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lateness, Lockstep, Node, serve
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings

from .figures import Figure, Part
from .recordings import CONFIG, drive

SEED = 21
SECONDS = 20.0
FRAME_S = 0.01  # issue 2: the loop at 100 Hz
FAST_PERIOD_S = 0.05  # design: the model's highest rate while driving, 20 Hz
COMMISSIONED_S = 120.0  # s of driving to which the 20 Hz model is fitted
OPERATOR = (
    OperatorRow(at_s=0.5, cruise_enable=1.0),
    OperatorRow(at_s=0.6, over_s=1.5, lever_pct=55.0),
    OperatorRow(at_s=6.0, press="set"),
    *(OperatorRow(at_s=8.0 + 6.0 * i, setpoint_mps=1.3 if i % 2 else 1.0) for i in range(2)),
)


@dataclass
class Timed:
    """A node with a stop watch: times of its ticks in ms, and which of them closed a model period."""

    node: CruiseNode
    times_ms: list[float] = field(default_factory=list)
    planned: list[bool] = field(default_factory=list)
    engaged: int = 0

    def __post_init__(self) -> None:
        self.period_s = self.node.period_s

    def receive(self, frame: Frame) -> None:
        """Hand one frame on."""
        self.node.receive(frame)

    def tick(self, now_s: float) -> list[Frame]:
        """One tick, timed."""
        before = self.node.sample
        begin_s = time.perf_counter()
        frames = self.node.tick(now_s)
        self.times_ms.append(1e3 * (time.perf_counter() - begin_s))
        self.planned.append(self.node.sample is not before)
        self.engaged += self.node.engagement.state.controls
        return frames


@dataclass
class Heard:
    """A node that takes down what others send."""

    node: Node
    frames: list[tuple[float, Frame]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.period_s = self.node.period_s

    def receive(self, frame: Frame) -> None:
        """Hand one frame on."""
        self.node.receive(frame)

    def tick(self, now_s: float) -> list[Frame]:
        """What the node sends, taken down."""
        frames = self.node.tick(now_s)
        self.frames += [(now_s, frame) for frame in frames]
        return frames


def fast_model(plant: PlantSettings, model: Model) -> Model:
    """The factory's structure at 20 Hz, fitted to a drive of the virtual combine."""
    ratio = model.period_s / FAST_PERIOD_S
    structure = Model(
        FAST_PERIOD_S, model.na, model.nb, round(model.delay * ratio), model.effects, (0.0,) * len(model.theta)
    )
    return fit(structure, [drive(plant, SEED, COMMISSIONED_S, FAST_PERIOD_S)])


def frames_of(cruise: CruiseSettings, plant: PlantSettings, model: Model, seconds: float) -> list[tuple[float, Frame]]:
    """What combine and operator send in a drive with this very cruise control, with the times of sending."""
    can = structs.replace(cruise.can, bus="virtual", channel="bench-lockstep")
    codecs = [Codec.load(cruise.database, can) for _ in range(3)]
    machine = Heard(CombineNode(Combine(plant, SEED), codecs[0], Drive(seconds=seconds).field, OPERATOR))
    panel = Heard(OperatorNode(codecs[1], OPERATOR))
    buses = [open_bus(can) for _ in range(3)]
    try:
        nodes: list[Node] = [machine, panel, CruiseNode(cruise, model, codecs[2])]
        Lockstep(list(zip(nodes, buses, strict=True))).run(seconds)
    finally:
        for bus in buses:
            bus.close()
    return sorted(machine.frames + panel.frames, key=lambda sent: sent[0])


def feed(frames: Sequence[tuple[float, Frame]], bus: Bus, begin_s: float, stop: threading.Event) -> None:
    """Send every frame at its time after `begin_s` of the monotonic clock."""
    for at_s, frame in frames:
        wait_s = begin_s + at_s - time.monotonic()
        if wait_s > 0.0 and stop.wait(wait_s):
            return
        bus.send(frame)


def serve_fed(
    cruise: CruiseSettings, model: Model, frames: Sequence[tuple[float, Frame]], seconds: float
) -> tuple[Timed, Lateness]:
    """Run the service's loop for `seconds` while the frames come in."""
    can = structs.replace(cruise.can, bus="virtual", channel="bench-loop")
    timed, lateness = Timed(CruiseNode(cruise, model, Codec.load(cruise.database, can))), Lateness()
    stop = threading.Event()
    with open_bus(can) as near, open_bus(can) as far:
        begin_s = time.monotonic()
        feeder = threading.Thread(target=feed, args=(frames, far, begin_s, stop))
        feeder.start()
        try:
            serve(timed, near, lambda: time.monotonic() - begin_s < seconds, lateness=lateness)
        finally:
            stop.set()
            feeder.join()
    return timed, lateness


def measure(seconds: float = SECONDS) -> Part:
    """With the factory's model at 5 Hz, and with one at 20 Hz."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    cruise = structs.replace(cruise, control=structs.replace(cruise.control, frame_s=FRAME_S))
    factory = files.load(cruise.model)
    figures = []
    for name, model in (("5hz", factory), ("20hz", fast_model(plant, factory))):
        frames = frames_of(cruise, plant, model, seconds)
        timed, lateness = serve_fed(cruise, model, frames, seconds)
        times_ms = np.array(timed.times_ms)
        planned = times_ms[np.array(timed.planned)]
        shown = f"model at {name.removesuffix('hz')} Hz"
        figures += [
            Figure(f"late_p50_{name}_ms", lateness.quantile_ms(0.5), "ms", f"{shown}: lateness, p50"),
            Figure(f"late_p99_{name}_ms", lateness.quantile_ms(0.99), "ms", f"{shown}: lateness, p99"),
            Figure(f"late_max_{name}_ms", lateness.worst_ms, "ms", f"{shown}: lateness, max"),
            Figure(f"missed_{name}", float(lateness.missed), "1", f"{shown}: ticks missed of {len(times_ms)}"),
            Figure(f"tick_p50_{name}_ms", float(np.median(times_ms)), "ms", f"{shown}: tick, p50"),
            Figure(f"tick_p99_{name}_ms", float(np.quantile(times_ms, 0.99)), "ms", f"{shown}: tick, p99"),
            Figure(f"plan_p50_{name}_ms", float(np.median(planned)), "ms", f"{shown}: tick that learns and plans, p50"),
            Figure(
                f"plan_p99_{name}_ms",
                float(np.quantile(planned, 0.99)),
                "ms",
                f"{shown}: tick that learns and plans, p99",
            ),
            Figure(f"engaged_share_{name}", timed.engaged / len(times_ms), "1", f"{shown}: share of ticks engaged"),
        ]
    note = f"load average {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; ordinary scheduling, no real-time kernel"
    return Part(tuple(figures), (SEED,), (note,))
