"""The loop: who is ticked when, in which order, on which clock, and what late ticks cost."""

import time
from types import SimpleNamespace

import pytest

from cruise.can.bus import Bus, Sent, open_bus
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from cruise.service import loop as loop_module
from cruise.service.loop import Lateness, Lockstep, Together, serve
from tests.service.drive import Wire


def frame(identifier: int, time_s: float = 0.0) -> Frame:
    return Frame(timestamp=time_s, arbitration_id=identifier, data=b"\x01")


class Fake:
    """A node that writes down what happens to it, and says one frame a tick."""

    def __init__(self, name: str, period_s: float, diary: list) -> None:
        self.name, self.period_s, self.diary = name, period_s, diary
        self.heard: list[tuple[int, float]] = []

    def receive(self, frame: Frame) -> None:
        self.heard.append((frame.arbitration_id, frame.timestamp))

    def tick(self, now_s: float) -> list[Frame]:
        self.diary.append((round(now_s, 6), self.name))
        return [frame(ord(self.name), now_s)]


def test_lockstep_ticks_each_at_its_period_and_in_the_order_given():
    diary: list = []
    wire = Wire(lambda name, frame: (frame,))
    nodes = [Fake("a", 0.01, diary), Fake("b", 0.02, diary), Fake("c", 0.05, diary)]
    loop = Lockstep([(node, wire.end()) for node in nodes])
    loop.run(0.1)
    assert loop.now_s == pytest.approx(0.1)
    assert diary == [
        (round(0.01 * step, 6), name)
        for step in range(1, 11)
        for name, every in (("a", 1), ("b", 2), ("c", 5))
        if step % every == 0
    ]
    # What stands before a node in the order is heard by it in the same step, what stands after it in the next.
    assert (ord("a"), 0.05) in nodes[2].heard
    assert [sent for sent in nodes[0].heard if sent[0] == ord("c")] == [(ord("c"), pytest.approx(0.05))]


def test_lockstep_goes_on_where_it_stood_and_neither_gains_nor_loses_a_step():
    wire = Wire(lambda name, frame: (frame,))
    once, often = [], []
    Lockstep([(Fake("a", 0.03, once), wire.end())]).run(7.0)
    parts = Lockstep([(Fake("a", 0.03, often), wire.end())])
    for until_s in (0.1, 0.1, 0.3, 1.234, 6.99, 7.0):
        parts.run(until_s)
    assert often == once
    assert len(once) == 233


def test_a_paced_loop_waits_for_the_wall_and_an_unpaced_one_does_not(monkeypatch):
    clock = SimpleNamespace(now_s=100.0, slept=[])

    def sleep(seconds):
        clock.slept.append(seconds)
        clock.now_s += seconds

    monkeypatch.setattr(loop_module, "time", SimpleNamespace(monotonic=lambda: clock.now_s, sleep=sleep))
    wire = Wire(lambda name, frame: (frame,))
    loop = Lockstep([(Fake("a", 0.01, []), wire.end())])
    loop.run(1.0)
    assert clock.slept == []
    loop.run(2.0, pace=4.0)
    assert clock.now_s - 100.0 == pytest.approx(0.25)


@pytest.mark.parametrize("period_s", [0.025, 0.004, 0.0])
def test_a_period_that_the_step_cannot_keep_is_refused(period_s):
    wire = Wire(lambda name, frame: (frame,))
    with pytest.raises(ValueError, match="no multiple"):
        Lockstep([(Fake("a", period_s, []), wire.end())])


def test_together_is_one_node_with_each_part_at_its_own_period():
    diary: list = []
    parts = [Fake("a", 0.1, diary), Fake("b", 0.02, diary), Fake("c", 0.04, diary)]
    both = Together(parts)
    assert both.period_s == 0.02
    sent = [[chr(frame.arbitration_id) for frame in both.tick(0.02 * k)] for k in range(1, 11)]
    assert sent == [["a"] * (k % 5 == 0) + ["b"] + ["c"] * (k % 2 == 0) for k in range(1, 11)]
    both.receive(frame(7))
    assert [part.heard for part in parts] == [[(7, 0.0)]] * 3
    with pytest.raises(ValueError, match="no multiple"):
        Together([Fake("a", 0.05, []), Fake("b", 0.02, [])])


class Clock:
    """A monotonic clock that moves only where something takes time; there is no other clock to ask."""

    def __init__(self) -> None:
        self.now_s = 5000.0

    def monotonic(self) -> float:
        return self.now_s


class Timetable(Bus):
    """Frames that arrive at set times of the clock."""

    def __init__(self, clock: Clock, arrivals: list[tuple[float, Frame]]) -> None:
        super().__init__("timetable")
        self.clock, self.arrivals = clock, arrivals
        self.sent: list[Frame] = []

    def receive(self, deadline_s: float) -> Frame | None:
        if self.arrivals and self.arrivals[0][0] < deadline_s:
            at_s, arrived = self.arrivals.pop(0)
            self.clock.now_s = max(self.clock.now_s, at_s)
            return arrived
        self.clock.now_s = max(self.clock.now_s, deadline_s)
        return None

    def send(self, frame: Frame) -> Sent:
        self.sent.append(frame)
        return Sent.SENT

    def close(self) -> None:
        pass

    def _take(self, timeout_s: float) -> Frame | None:
        raise AssertionError("serve waits with receive")


def served(monkeypatch, node, arrivals=(), ticks=6):
    """Run `serve` for some ticks on a clock of its own."""
    clock = Clock()
    monkeypatch.setattr(loop_module, "time", clock)
    node.clock = clock
    bus = Timetable(clock, [(5000.0 + at_s, arrived) for at_s, arrived in arrivals])
    lateness = Lateness()
    serve(node, bus, lambda: len(node.diary) < ticks, None, lateness)
    return bus, lateness


def test_serve_ticks_on_time_and_stamps_frames_with_its_own_clock(monkeypatch):
    node = Fake("a", 0.05, [])
    yesterday = frame(1, time_s=-86400.0)
    bus, lateness = served(monkeypatch, node, [(0.03, yesterday), (0.12, frame(2, 1e9))], ticks=4)
    assert node.diary == [(0.05, "a"), (0.1, "a"), (0.15, "a"), (0.2, "a")]
    assert node.heard == [(1, pytest.approx(0.03)), (2, pytest.approx(0.12))]
    assert len(bus.sent) == 4
    assert (lateness.missed, lateness.worst_ms) == (0, pytest.approx(0.0, abs=1e-6))


class Slow(Fake):
    """Its second tick takes 130 ms."""

    clock: Clock

    def tick(self, now_s: float) -> list[Frame]:
        if len(self.diary) == 1:
            self.clock.now_s += 0.13
        return super().tick(now_s)


def test_serve_leaves_out_what_it_missed_and_counts_it(monkeypatch):
    node = Slow("a", 0.05, [])
    _, lateness = served(monkeypatch, node, ticks=5)
    # The tick due at 0.15 comes at 0.23; the one of 0.20 is left out, the next is on the old grid again.
    assert [at_s for at_s, _ in node.diary] == [0.05, 0.1, 0.23, 0.25, 0.3]
    assert lateness.missed == 1
    assert lateness.worst_ms == pytest.approx(80.0)
    assert sum(lateness.counts) == 5


def test_serve_on_the_virtual_bus_does_not_care_for_the_wall_clock(monkeypatch):
    wall = iter(range(10**9, 0, -3600))  # an hour back at every look
    monkeypatch.setattr(time, "time", lambda: float(next(wall)))
    settings = CanSettings(bus="virtual", channel="test-serve")
    node = Fake("a", 0.01, [])
    with open_bus(settings) as here, open_bus(settings) as there:
        there.send(frame(5, 77.0))
        begin_s = time.monotonic()
        serve(node, here, lambda: len(node.diary) < 5)
        assert time.monotonic() - begin_s >= 0.05
        assert [arrived.arbitration_id for arrived in there.drain()] == [ord("a")] * 5
    assert [identifier for identifier, _ in node.heard] == [5]
    assert 0.0 <= node.heard[0][1] <= node.diary[0][0]
    times_s = [at_s for at_s, _ in node.diary]
    assert times_s == sorted(times_s)


def test_lateness_gives_the_upper_edge_of_the_quantiles_bin():
    lateness = Lateness()
    assert lateness.quantile_ms(0.99) == 0.0
    for _ in range(98):
        lateness.add(0.00012)
    lateness.add(0.0042)
    lateness.add(0.5)
    assert lateness.quantile_ms(0.5) == pytest.approx(0.2)
    assert lateness.quantile_ms(0.99) == pytest.approx(4.3, abs=0.11)
    assert lateness.quantile_ms(1.0) == lateness.worst_ms == pytest.approx(500.0)


def test_lateness_never_says_more_than_the_worst_nor_less_in_its_open_bin():
    lateness = Lateness()
    for _ in range(10):
        lateness.add(0.25)
    assert lateness.quantile_ms(0.5) == pytest.approx(250.0)
    quick = Lateness()
    quick.add(0.00001)
    assert quick.quantile_ms(0.5) == pytest.approx(0.01)
