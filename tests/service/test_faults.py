"""Cruise on the bus, end to end: it drives; every fault ends in neutral, in time, for the right reason, for good."""

import math
import random
from collections.abc import Callable, Iterable
from itertools import count

import pytest

from cruise.can import protection
from cruise.can.frame import Frame
from cruise.control.engagement import ExitReason, State
from cruise.sampling import StreamSampler
from cruise.service.course import FieldRow, OperatorRow
from tests.service.drive import CAN, ENGAGE_S, Tamper, Whole, codec

FAULT_S, RETURN_S, END_S = 6.4, 7.2, 8.4  # s, the fault comes, goes again, the drive ends
IN_TIME_S = 0.3 + 0.05  # s, three messages at 10 Hz, seen at the next tick


def between(harm: Callable[[Frame], Iterable[Frame]], message: str) -> Tamper:
    """Do `harm` to the frames of one message while the fault is there."""

    def tamper(name: str | None, frame: Frame) -> Iterable[Frame]:
        if name == message and FAULT_S <= frame.timestamp < RETURN_S:
            return harm(frame)
        return (frame,)

    return tamper


def nothing(frame: Frame) -> Iterable[Frame]:
    """The frame is lost."""
    return ()


def flipped(frame: Frame) -> Iterable[Frame]:
    """One bit on the wire is another."""
    frame.data[5] ^= 0x10
    return (frame,)


def unavailable(first: int, count: int, data_id: int | None = None) -> Callable[[Frame], Iterable[Frame]]:
    """The sender is well and says that it has no value in these bytes."""

    def harm(frame: Frame) -> Iterable[Frame]:
        frame.data[first : first + count] = b"\xff" * count
        if data_id is not None:
            protection.protect(frame.data, data_id, (protection.counter_of(frame.data) - 1) % protection.COUNTS)
        return (frame,)

    return harm


def asking(setpoint_mps: float) -> Callable[[Frame], Iterable[Frame]]:
    """The panel asks for another speed, below zero in reverse."""

    def harm(frame: Frame) -> Iterable[Frame]:
        frame.data[:2] = round(1000.0 * abs(setpoint_mps)).to_bytes(2, "little")
        frame.data[7] = 0xFC | (setpoint_mps > 0.0)
        return (frame,)

    return harm


class Stuck:
    """The sender repeats its last frame: CRC intact, counter standing still."""

    def __init__(self) -> None:
        self.data = bytearray()

    def __call__(self, frame: Frame) -> Iterable[Frame]:
        self.data = self.data or bytearray(frame.data)
        frame.data[:] = self.data
        return (frame,)


SIGNAL_FAULTS = {
    "drive feedback lost": ("DriveFeedback", nothing, ExitReason.FUNCTION_FAULT),
    "drive feedback damaged": ("DriveFeedback", flipped, ExitReason.FUNCTION_FAULT),
    "drive feedback stuck": ("DriveFeedback", Stuck, ExitReason.FUNCTION_FAULT),
    "speed not available": ("DriveFeedback", unavailable(2, 2, CAN.data_ids.drive_feedback), ExitReason.FUNCTION_FAULT),
    "current not available": (
        "DriveFeedback",
        unavailable(4, 2, CAN.data_ids.drive_feedback),
        ExitReason.FUNCTION_FAULT,
    ),
    "engine speed lost": ("EEC1", nothing, ExitReason.FUNCTION_FAULT),
    "engine speed not available": ("EEC1", unavailable(3, 2), ExitReason.FUNCTION_FAULT),
    "gear lost": ("ETC2", nothing, ExitReason.FUNCTION_FAULT),
    "lever lost": ("MachineState", nothing, ExitReason.FUNCTION_FAULT),
    "lever not available": ("MachineState", unavailable(2, 2, CAN.data_ids.machine_state), ExitReason.FUNCTION_FAULT),
    "setpoint lost": ("MachineSelectedSpeedCommand", nothing, ExitReason.COMMAND_TIMEOUT),
    "setpoint not available": ("MachineSelectedSpeedCommand", unavailable(0, 2), ExitReason.COMMAND_TIMEOUT),
    "setpoint of no machine": ("MachineSelectedSpeedCommand", asking(20.0), ExitReason.COMMAND_INVALID),
    "setpoint in reverse": ("MachineSelectedSpeedCommand", asking(-1.0), ExitReason.COMMAND_INVALID),
    "panel lost": ("CCVS", nothing, ExitReason.OPERATOR_LOST),
    "switches not available": ("CCVS", unavailable(3, 1), ExitReason.OPERATOR_LOST),
}

ACTS = {
    "gear to neutral": (FieldRow(at_s=FAULT_S, gear=0), FieldRow(at_s=RETURN_S, gear=2), ExitReason.CONTROL_POSITION),
    "brake": (
        OperatorRow(at_s=FAULT_S, brake_pedal=1.0),
        OperatorRow(at_s=RETURN_S, brake_pedal=0.0),
        ExitReason.OVERRIDE,
    ),
    "clutch": (
        OperatorRow(at_s=FAULT_S, clutch_pedal=1.0),
        OperatorRow(at_s=RETURN_S, clutch_pedal=0.0),
        ExitReason.OVERRIDE,
    ),
    "lever moved": (
        OperatorRow(at_s=FAULT_S, lever_pct=61.0),
        OperatorRow(at_s=RETURN_S, lever_pct=55.0),
        ExitReason.OVERRIDE,
    ),
    "lever to rest": (
        OperatorRow(at_s=FAULT_S, lever_pct=0.0),
        OperatorRow(at_s=RETURN_S, lever_pct=55.0),
        ExitReason.OVERRIDE,
    ),
    "switched off": (
        OperatorRow(at_s=FAULT_S, cruise_enable=0.0),
        OperatorRow(at_s=RETURN_S, cruise_enable=1.0),
        ExitReason.RELEASED,
    ),
}


def left_for_good(drive: Whole, reason: ExitReason) -> None:
    """Engaged until the fault, out in time, and from then on inactive, 0 mA, with the reason on the bus."""
    assert drive.engaged_at(FAULT_S - 0.05)
    after = [heard for heard in drive.listener.commands if heard.time_s >= FAULT_S]
    first = next(i for i, heard in enumerate(after) if not heard.active)
    assert after[first].time_s <= FAULT_S + IN_TIME_S + 1e-6
    assert all((heard.active, heard.current_ma) == (False, 0.0) for heard in after[first:])
    assert all(heard.current_ma > 300.0 for heard in after[:first]), "engaged, and braking with a neutral pump"
    assert sum(state is State.ENGAGING for _, state in drive.states) == 1
    assert {reason for at_s, reason in drive.listener.reasons if at_s >= FAULT_S + IN_TIME_S + 0.1} == {reason}
    assert drive.listener.faults == 0


@pytest.mark.parametrize("fault", SIGNAL_FAULTS)
def test_a_signal_that_is_lost_ends_the_drive(fault):
    message, harm, reason = SIGNAL_FAULTS[fault]
    drive = Whole(between(Stuck() if harm is Stuck else harm, message)).run(END_S)
    left_for_good(drive, reason)
    assert drive.node.missing == ()  # everything has been there again for a while
    assert not drive.machine.lever_counts
    assert abs(drive.combine.truth.pump_current_ma) < 5.0  # the machine stands, though the lever is still out


@pytest.mark.parametrize("act", ACTS)
def test_an_act_of_the_operator_ends_the_drive(act):
    begin, end, reason = ACTS[act]
    field = tuple(row for row in (begin, end) if isinstance(row, FieldRow))
    operator = tuple(row for row in (begin, end) if isinstance(row, OperatorRow))
    drive = Whole(field=field, operator=operator).run(END_S)
    left_for_good(drive, reason)


UNNEEDED = ("VF", "EEC2", "WBSD", "GBSD", "SSI2")


def test_signals_that_the_model_does_not_need_may_go_and_come():
    def tamper(name: str | None, frame: Frame) -> Iterable[Frame]:
        return () if name in UNNEEDED and frame.timestamp >= FAULT_S else (frame,)

    drive = Whole(tamper).run(FAULT_S + 4.0)  # oil temperature is stale 3 s later
    assert drive.engaged_at(drive.now_s)
    assert drive.node.engagement.setpoint_mps == pytest.approx(1.2)


def test_an_engine_speed_that_comes_at_5_hz_may_follow_the_throttle():
    numbers = count()
    throttle = (
        FieldRow(at_s=1.0, over_s=0.5, engine_speed_setpoint_rpm=1500.0),
        FieldRow(at_s=2.5, over_s=1.0, engine_speed_setpoint_rpm=2100.0),
    )
    drive = Whole(lambda name, frame: () if name == "EEC1" and next(numbers) % 10 else (frame,), throttle).run(END_S)
    assert drive.engaged_at(END_S)


def test_another_sources_speed_is_not_taken_for_the_drives():
    def harm(frame: Frame) -> Iterable[Frame]:
        frame.data[:2] = (5000).to_bytes(2, "little")  # 5 m/s
        return (frame,)

    quiet, other = Whole().run(END_S), Whole(between(harm, "GBSD")).run(END_S)
    assert other.listener.commands == quiet.listener.commands


def test_a_frame_of_the_setpoint_that_is_missing_is_no_new_word_of_the_operator():
    def tamper(name: str | None, frame: Frame) -> Iterable[Frame]:
        missing = name == "MachineSelectedSpeedCommand" and FAULT_S <= frame.timestamp < FAULT_S + 0.095
        return () if missing else (frame,)

    press = OperatorRow(at_s=ENGAGE_S + 0.8, press="accelerate")
    drive = Whole(tamper, operator=(press,)).run(END_S)
    assert drive.engaged_at(END_S)
    assert drive.node.engagement.setpoint_mps == pytest.approx(1.3)


def test_foreign_frames_of_any_kind_change_nothing():
    rng = random.Random(5)

    def tamper(name: str | None, frame: Frame) -> Iterable[Frame]:
        yield frame
        for _ in range(3):
            yield Frame(
                timestamp=frame.timestamp,
                arbitration_id=rng.getrandbits(29),
                data=rng.randbytes(rng.randrange(9)),
            )
        yield Frame(timestamp=frame.timestamp, is_error_frame=True)
        stranger = frame.arbitration_id & ~0xFF | 0xFD  # our message, from an address that is not its sender's
        yield Frame(timestamp=frame.timestamp, arbitration_id=stranger, data=b"\x00" * 8)
        yield Frame(timestamp=frame.timestamp, arbitration_id=rng.getrandbits(11), is_extended_id=False, data=b"\x11")

    quiet, loud = Whole().run(FAULT_S), Whole(tamper).run(FAULT_S)
    assert loud.engaged_at(FAULT_S)
    assert loud.listener.commands == quiet.listener.commands


@pytest.mark.parametrize(
    ("message", "values"),
    [
        ("PumpCurrentCommand", {"pump_current_command_ma": 100.0, "command_active": 1.0}),
        ("MachineSelectedSpeed", {"machine_selected_speed_mps": 3.0}),
    ],
)
def test_another_sender_of_its_own_messages_ends_the_drive(message, values):
    drive = Whole().run(FAULT_S)
    drive.node.receive(drive.panel.codec.encode(message, values, FAULT_S))
    drive.run(END_S)
    left_for_good(drive, ExitReason.FUNCTION_FAULT)
    assert drive.node.engagement.exit_condition == "implausible"


def test_once_that_sender_is_silent_the_fault_is_left_by_switching_off_and_on():
    operator = (
        OperatorRow(at_s=RETURN_S, press="resume"),
        OperatorRow(at_s=RETURN_S + 1.0, cruise_enable=0.0, lever_pct=0.0),
        OperatorRow(at_s=RETURN_S + 2.0, cruise_enable=1.0),
        OperatorRow(at_s=RETURN_S + 2.1, over_s=1.5, lever_pct=55.0),
        OperatorRow(at_s=RETURN_S + 7.0, press="resume"),
    )
    drive = Whole(operator=operator).run(FAULT_S)
    for k in range(3):
        command = {"pump_current_command_ma": 100.0, "command_active": 1.0}
        drive.node.receive(drive.panel.codec.encode("PumpCurrentCommand", command, FAULT_S + 0.02 * k))
    drive.run(RETURN_S + 0.9)
    assert drive.states[-1][1] is State.FAULT
    drive.run(RETURN_S + 9.0)
    assert drive.engaged_at(drive.now_s)


def test_a_panel_whose_setpoint_begins_with_the_press_is_no_second_sender():
    def tamper(name: str | None, frame: Frame) -> Iterable[Frame]:
        return () if name == "MachineSelectedSpeedCommand" and frame.timestamp < ENGAGE_S + 0.05 else (frame,)

    assert Whole(tamper).run(END_S).engaged_at(END_S)


class Holey(StreamSampler):
    """Too little of the period was measured, though the newest reading is fresh: a speed that comes and goes."""

    def sample(self, until_s: float, period_s: float) -> dict[str, float]:
        return super().sample(until_s, period_s) | {"ground_speed_mps": math.nan}


@pytest.mark.parametrize("sampler", ["sampler", "frame_sampler"])
def test_a_hole_in_the_sample_ends_the_drive_before_a_neutral_pump_is_commanded_as_active(sampler):
    drive = Whole().run(FAULT_S)
    setattr(drive.node, sampler, Holey(drive.node.settings.sampling))
    drive.run(END_S)
    left_for_good(drive, ExitReason.FUNCTION_FAULT)
    assert drive.node.engagement.exit_condition == "signals_lost"
    assert "ground_speed_mps" in drive.node.engagement.exit_detail


@pytest.mark.parametrize("crop_power_kw", [300.0, 350.0])
def test_a_plugged_machine_stands_lets_go_and_does_not_drive_off_by_itself(crop_power_kw):
    """300 kW are more than the engine has, with 350 it stalls; 12 s later all is well again, and nobody pressed."""
    plugged = (FieldRow(at_s=12.0, crop_power_kw=crop_power_kw), FieldRow(at_s=30.0, crop_power_kw=0.0))
    drive = Whole(field=plugged).run(48.0)
    assert drive.engaged_at(11.9)
    assert drive.states[-1][1] in (State.STANDBY, State.FAULT)
    assert drive.states[-1][0] < 30.0, "while it stood"
    assert not any(heard.active for heard in drive.listener.commands if heard.time_s > 30.0)
    assert abs(drive.combine.truth.ground_speed_mps) < 0.05


@pytest.fixture(scope="module")
def steady() -> Whole:
    return Whole().run(ENGAGE_S + 14.0)


def test_it_takes_over_drives_at_the_setpoint_and_stops_with_neutral(steady):
    assert [state for _, state in steady.states] == [State.OFF, State.STANDBY, State.ENGAGING, State.ENGAGED]
    assert steady.states[-2][0] == pytest.approx(ENGAGE_S, abs=0.11)
    assert steady.combine.truth.ground_speed_mps == pytest.approx(1.2, abs=0.1)
    for frame in steady.node.stop(steady.now_s):
        steady.loop.ends[2][1].send(frame)
    steady.run(steady.now_s + 1.0)
    stopped = [heard for heard in steady.listener.commands if heard.time_s >= ENGAGE_S + 14.0 + 0.005]
    assert stopped
    assert all((heard.active, heard.current_ma) == (False, 0.0) for heard in stopped)
    assert steady.listener.reasons[-1][1] == ExitReason.RELEASED
    assert not steady.machine.driven_by_cruise


def test_a_stopped_service_does_not_engage_again():
    drive = Whole(operator=(OperatorRow(at_s=FAULT_S + 0.5, press="resume"),)).run(FAULT_S)
    for frame in drive.node.stop(drive.now_s):
        drive.loop.ends[2][1].send(frame)
    drive.run(END_S)
    assert not any(heard.active for heard in drive.listener.commands if heard.time_s > FAULT_S)


def test_a_new_press_engages_again_after_the_fault():
    again = OperatorRow(at_s=RETURN_S + 4.0, press="resume")
    # The lever has to be moved before it drives again, and the machine has to move before cruise may.
    move = OperatorRow(at_s=RETURN_S + 0.2, lever_pct=48.0)
    drive = Whole(between(nothing, "EEC1"), operator=(move, again)).run(RETURN_S + 5.0)
    assert drive.machine.lever_counts
    assert [state for _, state in drive.states][-1].controls
    assert drive.listener.reasons[-1][1] == ExitReason.NONE


def test_a_paused_process_lets_go_and_stays_let_go():
    """The loop stands still for 0.4 s: the drive has gone to neutral, and neither end takes up where it was."""
    whole = Whole().run(10.0)
    assert whole.node.engagement.state is State.ENGAGED
    ticking, whole.node.tick = whole.node.tick, lambda now_s: []
    whole.run(10.4)
    assert not whole.machine.driven_by_cruise
    whole.node.tick = ticking
    whole.run(10.6)
    assert whole.node.engagement.state is State.FAULT
    assert whole.node.engagement.ended_by == "unhealthy, no turn for 0.45 s (ISO exit reason 9, function fault)"
    whole.run(14.0)
    assert not whole.machine.driven_by_cruise
    assert whole.node.command.current_ma == 0.0


def test_after_a_time_out_the_drive_wants_to_see_an_inactive_command_first():
    def frame(now_s, active):
        values = {"pump_current_command_ma": 700.0, "command_active": active}
        return sender.encode("PumpCurrentCommand", values, now_s)

    sender, whole = codec(), Whole()
    machine = whole.machine
    for k in range(1, 400):
        now_s = 0.01 * k
        silent = 1.0 < now_s < 1.5
        if k % 5 == 0 and not silent:
            machine.receive(frame(now_s, 0.0 if 2.5 < now_s < 2.7 else 1.0))
        machine.tick(now_s)
        if k in (90, 140, 200, 260, 390):
            expected = {90: True, 140: False, 200: False, 260: False, 390: True}[k]
            assert machine.driven_by_cruise is expected, now_s


def test_what_the_drive_itself_does_is_told_from_a_force():
    """While the operator leads the machine up from standstill, and then while it goes on evenly."""
    whole, own = Whole(), []
    for k in range(2, 50):
        plausibility = whole.run(0.1 * k).node.plausibility
        assert plausibility is not None
        own.append(plausibility.memory.suddenness.own_mps)
    assert max(own) > 0.2
    assert own[-1] < 0.1


def test_a_reference_that_gives_way_to_the_engine_teaches_nobody():
    whole = Whole().run(ENGAGE_S + 2.0)
    node = whole.node
    assert node.sample is not None
    assert node.sample.engaged
    assert node.sample.reference_mps == pytest.approx(1.2, abs=0.1)
    node.controller.power.cap_mps = 1.0  # as an overloaded engine would have it; it comes back by 0.05 m/s2
    whole.run(ENGAGE_S + 3.0)
    assert node.engagement.state.controls
    assert math.isnan(node.sample.reference_mps)
    assert node.controller.reference.speed_mps < 1.2
