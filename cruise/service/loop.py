"""The only clock of the program: nodes are ticked at their periods and given the frames in between.

Two loops, one contract. `Lockstep` runs any number of nodes on simulated time, as fast as it can or paced to the wall
clock; the same nodes in the same order give the same frames. `serve` runs one node on a real bus, on the monotonic
clock.
"""

import time
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Protocol

from cruise.can.bus import Bus
from cruise.can.frame import Frame
from cruise.settings import SettingsError


class Node(Protocol):
    """Something on the bus: it is handed frames and the time, and returns frames."""

    period_s: float

    def receive(self, frame: Frame) -> Sequence[Frame] | None:
        """Take one frame in; returns what to answer at once, if anything."""
        ...

    def tick(self, now_s: float) -> list[Frame]:
        """One period on; returns what to send."""
        ...


class Lockstep:
    """Nodes, each at its own end of one virtual bus, on simulated time in steps of `step_s`."""

    step_s = 0.01

    def __init__(self, ends: Sequence[tuple[Node, Bus]]) -> None:
        self.ends = ends
        self.steps = 0
        self.every = [_steps(node.period_s, self.step_s) for node, _ in ends]

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.steps * self.step_s

    def run(self, until_s: float, each_step: Callable[[float], None] | None = None, pace: float = 0.0) -> None:
        """Run to `until_s`; `pace` > 0 is the speed relative to the wall clock, 0 is as fast as it goes."""
        begin, begin_s = time.monotonic(), self.now_s
        while self.now_s < until_s - 0.5 * self.step_s:
            self.steps += 1
            now_s = self.now_s
            for (node, bus), every in zip(self.ends, self.every, strict=True):
                for frame in bus.drain():
                    _send(node.receive(frame), bus)
                if self.steps % every == 0:
                    _send(node.tick(now_s), bus)
            if each_step is not None:
                each_step(now_s)
            if pace > 0.0:
                ahead_s = (now_s - begin_s) / pace - (time.monotonic() - begin)
                if ahead_s > 0.0:
                    time.sleep(ahead_s)


class Together:
    """Several nodes as one, for a process that plays more than one part on the bus."""

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.nodes = nodes
        self.period_s = min(node.period_s for node in nodes)
        self.every = [_steps(node.period_s, self.period_s) for node in nodes]
        self.ticks = 0

    def receive(self, frame: Frame) -> Sequence[Frame]:
        """Every node hears it."""
        return [answer for node in self.nodes for answer in node.receive(frame) or ()]

    def tick(self, now_s: float) -> list[Frame]:
        """Those whose time it is speak, in order."""
        self.ticks += 1
        due = (node for node, every in zip(self.nodes, self.every, strict=True) if self.ticks % every == 0)
        return [frame for node in due for frame in node.tick(now_s)]


@dataclass
class Ear:
    """A node that only listens: it writes every frame of the bus into a log."""

    write: Callable[[Frame], None]
    period_s: float = 1.0

    def receive(self, frame: Frame) -> None:
        """Write one frame down."""
        self.write(frame)

    def tick(self, now_s: float) -> list[Frame]:
        """It says nothing."""
        return []


class Lateness:
    """How late the ticks came, in ms: a histogram of bounded size."""

    def __init__(self) -> None:
        self.counts = [0] * 1001  # bins of 0.1 ms, the last one open
        self.worst_ms = 0.0
        self.missed = 0  # whole periods that were left out

    def add(self, late_s: float) -> None:
        """Count one tick."""
        late_ms = 1000.0 * late_s
        self.worst_ms = max(self.worst_ms, late_ms)
        self.counts[min(int(late_ms * 10.0), 1000)] += 1

    def quantile_ms(self, share: float) -> float:
        """The upper edge of the bin in which the quantile lies."""
        seen = list(accumulate(self.counts))
        i = bisect_left(seen, share * seen[-1])
        return self.worst_ms if i >= len(seen) - 1 else min((i + 1) / 10.0, self.worst_ms)


def serve(
    node: Node,
    bus: Bus,
    running: Callable[[], bool],
    each_tick: Callable[[float], None] | None = None,
    lateness: Lateness | None = None,
    wall_clock: bool = False,
) -> None:
    """Run one node on the monotonic clock while `running()`; time starts at zero.

    A tick that comes more than a period late is counted, and what it missed is left out rather than made up. Frames
    get the loop's own time of arrival; a log keeps the kernel's instead, on the wall clock.
    """
    begin = time.monotonic()
    ticks = 0
    while running():
        due = begin + (ticks + 1) * node.period_s
        while (frame := bus.receive(due)) is not None:
            _send(node.receive(frame if wall_clock else _stamped(frame, time.monotonic() - begin)), bus)
        late_s = time.monotonic() - due
        ticks += 1
        if late_s > node.period_s:
            skipped = int(late_s / node.period_s)
            ticks += skipped
            if lateness is not None:
                lateness.missed += skipped
        if lateness is not None:
            lateness.add(max(late_s, 0.0))
        now_s = time.monotonic() - begin
        _send(node.tick(now_s), bus)
        if each_tick is not None:
            each_tick(now_s)


def _send(frames: Sequence[Frame] | None, bus: Bus) -> None:
    for frame in frames or ():
        bus.send(frame)


def _steps(period_s: float, step_s: float) -> int:
    """How many steps a period has. SettingsError where that is no whole number: the node would run at another rate."""
    steps = round(period_s / step_s)
    if steps < 1 or abs(steps * step_s - period_s) > 1e-9:
        raise SettingsError(f"a period of {period_s} s is no multiple of the loop's step of {step_s} s")
    return steps


def _stamped(frame: Frame, now_s: float) -> Frame:
    """The frame with the loop's own time of arrival: the wall clock in it may be set by anybody at any time."""
    frame.timestamp = now_s
    return frame
