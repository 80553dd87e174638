"""The drive's own electronics: a command counts while it is active, intact and fresh; after it, neutral until moved."""

import math

import pytest

from cruise.can.frame import Frame
from cruise.plant import Combine
from cruise.service.combine_node import MESSAGES, CombineNode
from cruise.service.course import OperatorRow
from tests.service.drive import FIELD, codec, plant_settings

LEVER = (OperatorRow(at_s=0.0, lever_pct=50.0),)
LEVER_MA = 360.0 + 0.5 * (1150.0 - 360.0)
COMMAND_MA = 600.0
LAST_S = 1.0  # s, when the last good command was sent


class Cruise:
    """Sends commands as the service does."""

    def __init__(self) -> None:
        self.codec = codec()

    def command(self, time_s: float, current_ma: float = COMMAND_MA, active: float = 1.0) -> Frame:
        values = {"pump_current_command_ma": current_ma, "command_active": active}
        return self.codec.encode("PumpCurrentCommand", values, time_s)


def machine(operator=LEVER) -> CombineNode:
    return CombineNode(Combine(plant_settings(), 1), codec(), FIELD, operator)


def commanded(node: CombineNode) -> float:
    """The current that the drive's electronics ask of the solenoid."""
    return node.combine.state.inputs.pump_current_ma


def run(node: CombineNode, until_s: float, frames=lambda step: ()) -> list[float]:
    """Drive on, with the frames that `frames(step)` gives in each step; the currents step by step."""
    currents = []
    while node.ticks < round(until_s * 100):
        step = node.ticks + 1
        for frame in frames(step):
            node.receive(frame)
        node.tick(0.01 * step)
        currents.append(commanded(node))
    return currents


def every_50_ms(cruise: Cruise, **fields):
    return lambda step: (cruise.command(0.01 * step, **fields),) if step % 5 == 0 else ()


def under_command(operator=LEVER) -> tuple[CombineNode, Cruise]:
    node, cruise = machine(operator), Cruise()
    run(node, LAST_S, every_50_ms(cruise))
    assert commanded(node) == pytest.approx(COMMAND_MA)
    return node, cruise


def test_the_lever_drives_until_there_is_a_command():
    node = machine()
    run(node, 0.5)
    assert commanded(node) == pytest.approx(LEVER_MA)


@pytest.mark.parametrize(("lever_pct", "current_ma"), [(0.0, 0.0), (2.9, 0.0), (-50.0, -LEVER_MA), (100.0, 1150.0)])
def test_the_levers_characteristic(lever_pct, current_ma):
    node = machine((OperatorRow(at_s=0.0, lever_pct=lever_pct),))
    run(node, 0.02)
    assert commanded(node) == pytest.approx(current_ma)


def same_again(cruise: Cruise):
    """Frame after frame with the counter standing still."""
    stuck = cruise.command(LAST_S)
    first = [stuck]

    def frames(step):
        return (Frame(timestamp=0.01 * step, arbitration_id=stuck.arbitration_id, data=first[0].data),)

    return frames


def damaged(cruise: Cruise):
    def frames(step):
        frame = cruise.command(0.01 * step)
        frame.data[3] ^= 1
        return (frame,)

    return frames


def of_another(cruise: Cruise):
    def frames(step):
        frame = cruise.command(0.01 * step)
        frame.arbitration_id ^= 0x80
        return (frame,)

    return frames


ENDS = {
    "silence": lambda cruise: lambda step: (),
    "inactive": lambda cruise: every_50_ms(cruise, active=0.0),
    "active not available": lambda cruise: every_50_ms(cruise, active=math.nan),
    "current not available": lambda cruise: every_50_ms(cruise, current_ma=math.nan),
    "damaged": damaged,
    "counter stands still": same_again,
    "another sender": of_another,
}


@pytest.mark.parametrize("end", ENDS)
def test_without_a_good_command_the_pump_is_neutral_in_time_until_the_lever_is_moved(end):
    move = OperatorRow(at_s=3.0, lever_pct=54.0)
    node, cruise = under_command((*LEVER, OperatorRow(at_s=2.0, lever_pct=52.0), move))
    frames = ENDS[end](cruise)
    currents = run(node, 2.99, frames)
    # The stuck sender's first frame is good: it counts from there.
    neutral = next(i for i, current_ma in enumerate(currents, 1) if current_ma == 0.0)
    assert neutral <= 22  # steps of 0.01 s: 0.2 s from the last good one, and the step that notices
    assert set(currents[neutral - 1 :]) == {0.0}, "a lever in its place, or moved by a trifle, drives by itself"
    run(node, 3.1, frames)
    assert commanded(node) == pytest.approx(360.0 + 0.54 * (1150.0 - 360.0))


def test_two_lost_commands_do_not_matter():
    node, cruise = under_command()
    currents = run(node, LAST_S + 0.14)
    currents += run(node, LAST_S + 0.5, every_50_ms(cruise))
    assert currents == pytest.approx([COMMAND_MA] * len(currents))


def test_one_damaged_command_among_good_ones_does_not_matter():
    node, cruise = under_command()

    def frames(step):
        due = every_50_ms(cruise)(step)
        for frame in due:
            frame.data[3] ^= step % 15 == 0
        return due

    currents = run(node, LAST_S + 1.0, frames)
    assert currents == pytest.approx([COMMAND_MA] * len(currents))


def test_a_command_that_comes_back_after_a_time_out_is_not_taken_by_itself():
    node, cruise = under_command()
    run(node, 2.0)
    assert commanded(node) == 0.0
    run(node, 2.2, every_50_ms(cruise))
    assert commanded(node) == 0.0


def test_its_messages_come_at_their_rates_and_say_what_the_sensors_show():
    node, ear, counts = machine(), codec(), {}
    values = {}
    for step in range(1, 301):
        for frame in node.tick(0.01 * step):
            decoded = ear.decode(frame)
            assert decoded.fault is None
            counts[decoded.message] = counts.get(decoded.message, 0) + 1
            values |= {(decoded.message, reading.name): reading.value for reading in decoded.readings}
            assert frame.timestamp <= 0.01 * step + 1e-9
    for outgoing in MESSAGES:
        assert counts[outgoing.message] == round(3.0 / outgoing.period_s)
    assert 145 <= counts["DriveFeedback"] <= 151
    truth = node.combine.truth
    assert values["MachineState", "lever_pct"] == pytest.approx(50.0)
    assert values["ETC2", "gear"] == 2.0
    assert values["EEC1", "engine_speed_rpm"] == pytest.approx(truth.engine_speed_rpm, abs=30.0)
    assert values["DriveFeedback", "pump_current_ma"] == pytest.approx(truth.pump_current_ma, abs=15.0)
    assert values["GBSD", "ground_speed_mps"] == pytest.approx(truth.ground_speed_mps, abs=0.1)
