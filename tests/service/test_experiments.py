"""Experiments over the whole bus in lockstep: they agree with driving directly, and every end is at once."""

import math
from functools import cache

import msgspec
import numpy as np
import pytest

from cruise.can import protection
from cruise.can.frame import Frame
from cruise.control.commissioning import CommissioningSettings, Conditions, Experiment, Progress
from cruise.control.engagement import ExitReason, State
from cruise.control.excitation import Multisine, Ramp, Steps, WhiteNoise
from cruise.estimation.gate import Gate
from cruise.model import files
from cruise.plant import Combine
from cruise.recording import RecordingError
from cruise.service import experiments
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.experiments import Driven, Recorder, altered, drive, drive_on_bus
from cruise.service.loop import Lockstep
from cruise.service.operator_node import OperatorNode
from cruise.settings import SettingsError
from cruise.signals import INPUT, OUTPUT
from tests.service.drive import CAN, CONFIG, Listener, Tamper, Wire, codec, cruise_settings, plant_settings

NOISE = Experiment(
    name="noise",
    number=3,
    excitation=WhiteNoise(low_ma=450.0, high_ma=1050.0, seconds=12.0),
    speed_max_mps=3.0,
    lead_s=1.0,
    settle_s=1.0,
)
EXCITING_S = 4.0  # s, when the excitation begins: 2 s of standstill, 1 s in, 1 s of waiting
FRAME_S = 0.05
FINISHED_S = 20.0
KINDS = {
    "white noise": NOISE.excitation,
    "steps": Steps(low_ma=450.0, high_ma=1050.0, hold_min_s=1.0, hold_max_s=3.0, seconds=12.0),
    "ramp": Ramp(low_ma=350.0, high_ma=1150.0, rate_ma_per_s=160.0, repeats=1),
    "multisine": Multisine(
        mean_ma=750.0, peak_ma=250.0, low_hz=0.2, high_hz=3.0, period_s=5.0, periods=2, phases="random"
    ),
}
STEPS = msgspec.structs.replace(NOISE, excitation=KINDS["steps"])


def with_commissioning():
    return msgspec.structs.replace(cruise_settings(), commissioning=CommissioningSettings(experiments="here"))


class Whole:
    """Combine, panel, cruise and recorder on one wire that a test may tamper with."""

    def __init__(self, *operator: OperatorRow, tamper: Tamper = lambda name, frame: (frame,), gear: int = 2) -> None:
        rows = tuple(sorted((*OPERATOR, *operator), key=lambda row: row.at_s))
        self.wire = Wire(tamper)
        self.combine = Combine(plant_settings(), 7)
        self.machine = CombineNode(self.combine, codec(), (FieldRow(at_s=0.0, gear=gear),), rows)
        settings = with_commissioning()
        self.node = CruiseNode(settings, files.load(settings.model), codec(), experiments=(NOISE,))
        self.listener, self.recorder = Listener(), Recorder(codec(), NOISE.number, 20.0)
        nodes = (self.machine, OperatorNode(codec(), rows), self.node, self.listener, self.recorder)
        self.loop = Lockstep([(node, self.wire.end()) for node in nodes])
        self.states: list[tuple[float, State]] = []
        self.gates: list[tuple[Gate, State]] = []

    def run(self, until_s: float) -> "Whole":
        """Drive on to `until_s`."""

        def each_step(now_s: float) -> None:
            state = self.node.engagement.state
            self.gates.append((self.node.learned.gate, state))
            if not self.states or self.states[-1][1] is not state:
                self.states.append((round(now_s, 3), state))

        self.loop.run(until_s, each_step)
        return self

    def active(self) -> list[float]:
        """Times of the commands that count."""
        return [heard.time_s for heard in self.listener.commands if heard.active]


OPERATOR = (
    OperatorRow(at_s=0.2, cruise_enable=1.0),
    OperatorRow(at_s=0.5, requested_experiment=3),
    OperatorRow(at_s=1.85, press="set"),
)


@cache
def on_bus(kind: str, rate_hz: float = 20.0) -> Driven:
    return drive_on_bus(
        msgspec.structs.replace(NOISE, excitation=KINDS[kind]), cruise_settings(), plant_settings(), rate_hz
    )


@pytest.mark.parametrize("kind", KINDS)
def test_over_the_bus_it_is_what_it_is_directly(kind):
    """Both show one machine: they differ by the sensors' noise, 15 mm/s and 1 mA, over 2.5 readings each."""
    driven = on_bus(kind)
    direct = drive(msgspec.structs.replace(NOISE, excitation=KINDS[kind]), plant_settings())
    heard = driven.recording
    assert driven.ended_by == ""
    assert len(heard) == len(direct) == round(KINDS[kind].duration_s * 20.0)
    assert heard.columns.keys() == direct.columns.keys()
    assert all(np.isfinite(column[20:]).all() for column in heard.columns.values())
    assert np.sqrt(np.mean((heard.output - direct.output) ** 2)) < 0.016
    assert abs(np.mean(heard.output - direct.output)) < 0.002
    assert abs(np.mean(heard.input - direct.input)) < 0.3
    assert np.corrcoef(heard.input, direct.input)[0, 1] > 0.999


def test_the_recorded_current_is_the_one_that_was_written_down():
    """It is measured: by a regulator of 12 ms, 5 ms late, held 20 ms between readings: half a frame late in all."""
    current = NOISE.current()
    written_ma = np.array([current.current_ma(2.0 + k * FRAME_S) for k in range(240)])
    for recording in (on_bus("white noise").recording, drive(NOISE, plant_settings())):
        measured_ma = recording.input[5:235]
        shares = [np.corrcoef(measured_ma, written_ma[5 - lag : 235 - lag])[0, 1] ** 2 for lag in range(-3, 4)]
        assert shares[3] + shares[4] > 0.88
        assert sum(shares) - shares[3] - shares[4] < 0.05


def test_the_same_seed_is_the_same_recording_and_another_another():
    first, second = (drive_on_bus(altered(NOISE, seconds=3.0), cruise_settings(), plant_settings()) for _ in range(2))
    np.testing.assert_array_equal(first.recording.output, second.recording.output)
    other = drive_on_bus(altered(NOISE, seed=1, seconds=3.0), cruise_settings(), plant_settings())
    assert np.std(other.recording.input - first.recording.input) > 100.0


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 50.0])
def test_another_rate_is_the_same_drive(rate_hz):
    slow = drive(STEPS, plant_settings(), rate_hz=rate_hz)
    assert slow.dt_s == pytest.approx(1.0 / rate_hz)
    assert len(slow) == 12 * rate_hz
    fast = drive(STEPS, plant_settings(), context=())
    assert fast.columns.keys() == {INPUT, OUTPUT}
    np.testing.assert_allclose(slow.output[-1], fast.output[-1], atol=0.05)
    assert slow.output.mean() == pytest.approx(fast.output.mean(), abs=0.005)


def test_conditions_are_those_of_the_machine():
    conditions = Conditions(gear=1, machine_mass_kg=18800.0, grade_deg=4.0, engine_speed_rpm=1700.0)
    experiment = altered(STEPS, conditions)
    driven = drive_on_bus(experiment, cruise_settings(), plant_settings())
    for recording in (driven.recording, drive(STEPS, plant_settings(), conditions)):
        means = {name: float(column.mean()) for name, column in recording.columns.items()}
        assert means["gear"] == 1.0
        assert means["machine_mass_kg"] == pytest.approx(18800.0, abs=60.0)
        assert means["pitch_deg"] == pytest.approx(4.0, abs=0.2)
        assert means["engine_speed_rpm"] == pytest.approx(1700.0, abs=40.0)
        assert "18800 kg, +4.0 deg, 1700 rpm" in recording.source
    level = drive(STEPS, plant_settings())
    assert driven.recording.output.mean() < 0.6 * level.output.mean()


@pytest.fixture(scope="module")
def finished() -> Whole:
    return Whole(OperatorRow(at_s=18.0, requested_experiment=0)).run(FINISHED_S)


def test_an_experiment_runs_from_standby_to_its_end_and_back_to_neutral(finished):
    states = [state for _, state in finished.states]
    assert states == [State.OFF, State.STANDBY, State.COMMISSIONING, State.STANDBY]
    (begin_s, _), (end_s, _) = finished.states[-2:]
    assert end_s - begin_s == pytest.approx(NOISE.duration_s, abs=0.011)
    engagement = finished.node.engagement
    assert (engagement.exit_condition, engagement.exit_reason) == ("finished", ExitReason.RELEASED)
    assert finished.recorder.progress is Progress.FINISHED
    assert len(finished.recorder.rows) == 240
    assert not any(heard.active or heard.current_ma for heard in finished.listener.commands if heard.time_s > end_s)
    assert abs(finished.combine.truth.ground_speed_mps) < 0.05


def test_nothing_is_learned_or_judged_from_an_experiment_and_the_shaper_is_out_of_the_way(finished):
    during = [gate for gate, state in finished.gates if state is State.COMMISSIONING]
    assert set(during[20:]) == {Gate.OVERRIDDEN}  # from the first whole period of the model on
    after = [gate for gate, state in finished.gates[-200:] if state is State.STANDBY]
    assert set(after) == {Gate.WARMING_UP}
    assert finished.node.supervisor.rms_mps == {}
    assert finished.node.estimator.snapshot().theta == finished.node.estimator.factory.theta
    sent = [heard.current_ma for heard in finished.listener.commands if EXCITING_S < heard.time_s < EXCITING_S + 11.0]
    assert np.abs(np.diff(sent)).max() > 400.0  # mA a frame; the shaper and the controller's limits let 30 pass


def test_the_status_counts_down_and_an_idle_machine_says_nothing_of_it():
    heard: list[tuple[float, float]] = []

    def listen(name: str | None, frame: Frame):
        if name == "CommissioningStatus":
            values = {reading.name: reading.value for reading in codec().decode(frame).readings}
            heard.append((values["experiment_progress"], values["experiment_left_s"]))
        return (frame,)

    Whole(tamper=listen).run(8.0)
    assert [progress for progress, _ in heard[:30]] == [0.0] * 30
    assert heard[-1] == (2.0, pytest.approx(NOISE.duration_s - 6.0, abs=0.11))
    idle = CruiseNode(cruise_settings(), files.load(cruise_settings().model), codec())
    assert [codec().decode(frame).message for frame in idle.tick(0.05)] == ["PumpCurrentCommand"]


def tampered(message: str, from_s: float) -> Tamper:
    """A wire that swallows one message from `from_s` on."""

    def tamper(name: str | None, frame: Frame):
        return () if name == message and frame.timestamp >= from_s else (frame,)

    return tamper


END_S = 6.0
ENDS = {
    "brake": (OperatorRow(at_s=END_S, brake_pedal=1.0), "brake", ExitReason.OVERRIDE),
    "clutch": (OperatorRow(at_s=END_S, clutch_pedal=1.0), "clutch", ExitReason.OVERRIDE),
    "lever": (OperatorRow(at_s=END_S, lever_pct=20.0), "lever_moved", ExitReason.OVERRIDE),
    "lever backwards": (OperatorRow(at_s=END_S, lever_pct=-20.0), "lever_moved", ExitReason.OVERRIDE),
    "switched off": (OperatorRow(at_s=END_S, cruise_enable=0.0), "switched_off", ExitReason.RELEASED),
    "let go": (OperatorRow(at_s=END_S, requested_experiment=0), "request_withdrawn", ExitReason.RELEASED),
    "another one": (OperatorRow(at_s=END_S, requested_experiment=4), "request_withdrawn", ExitReason.RELEASED),
}


@pytest.mark.parametrize("end", ENDS)
def test_whatever_the_operator_does_ends_it_within_a_frame_and_it_does_not_start_again(end):
    row, condition, reason = ENDS[end]
    back = OperatorRow(
        at_s=END_S + 1.0, brake_pedal=0.0, clutch_pedal=0.0, lever_pct=0.0, cruise_enable=1.0, requested_experiment=3
    )
    whole = Whole(row, back).run(END_S - 0.01)
    assert whole.node.engagement.state is State.COMMISSIONING
    whole.run(END_S + 3.0)
    # The panel spoke at END_S, in the same instant, before the service's frame of then.
    assert whole.active()[-1] <= END_S + FRAME_S + 1e-6
    assert all(heard.current_ma == 0.0 for heard in whole.listener.commands if heard.time_s > whole.active()[-1] + 1e-6)
    assert State.COMMISSIONING not in [state for time_s, state in whole.states if time_s > END_S + 0.2]
    assert (whole.node.engagement.exit_condition, whole.node.engagement.exit_reason) == (condition, reason)
    assert next(code for time_s, code in whole.listener.reasons if time_s > END_S + 0.2) == reason
    assert whole.recorder.progress is Progress.ENDED_EARLY
    assert len(whole.recorder.rows) == pytest.approx((END_S - EXCITING_S) * 20.0, abs=2)
    assert whole.recorder.ended_by == reason.name.lower().replace("_", " ")


@pytest.mark.parametrize("at_s", [END_S, END_S + FRAME_S])
def test_who_hears_that_it_has_ended_has_heard_why(at_s):
    whole = Whole(OperatorRow(at_s=at_s, lever_pct=20.0))
    while not whole.recorder.ended:
        whole.run(whole.loop.now_s + 0.01)
    assert whole.recorder.ended_by == "override"


LOST = {
    "the panel": ("CCVS", "operator_lost", ExitReason.OPERATOR_LOST),
    "the request": ("CommissioningRequest", "request_withdrawn", ExitReason.RELEASED),
    "speed and current": ("DriveFeedback", "drive_signals_lost", ExitReason.FUNCTION_FAULT),
    "the lever": ("MachineState", "drive_signals_lost", ExitReason.FUNCTION_FAULT),
    "the gear": ("ETC2", "drive_signals_lost", ExitReason.FUNCTION_FAULT),
}


@pytest.mark.parametrize("lost", LOST)
def test_a_message_that_falls_silent_ends_it(lost):
    message, condition, reason = LOST[lost]
    whole = Whole(tamper=tampered(message, END_S)).run(END_S + 1.0)
    assert whole.active()[-1] <= END_S + 0.3 + FRAME_S  # 0.3 s: how long a value counts
    assert (whole.node.engagement.exit_condition, whole.node.engagement.exit_reason) == (condition, reason)


def test_what_only_the_controller_needs_may_fall_silent():
    whole = Whole(tamper=tampered("EEC1", END_S)).run(END_S + 1.0)
    assert whole.node.engagement.state is State.COMMISSIONING


def test_the_wrong_gear_is_refused_and_nothing_moves():
    whole = Whole(gear=3).run(5.0)
    assert whole.node.engagement.refused == "the experiment is for gear 2"
    assert whole.active() == []
    assert abs(whole.combine.truth.ground_speed_mps) < 0.05


def test_a_gear_change_ends_it():
    whole = Whole().run(END_S)
    whole.machine.field = (FieldRow(at_s=0.0, gear=3),)
    whole.run(END_S + 1.0)
    assert whole.node.engagement.exit_condition == "gear_changed"


def test_beyond_its_speed_it_ends():
    slow = msgspec.structs.replace(NOISE, speed_max_mps=0.5)
    with pytest.raises(RecordingError, match="ended with 0 samples"):
        drive_on_bus(slow, cruise_settings(), plant_settings())
    driven = drive_on_bus(msgspec.structs.replace(slow, speed_max_mps=1.25), cruise_settings(), plant_settings())
    assert driven.ended_by == "too fast"
    assert driven.recording.output.max() < 1.4
    assert driven.recording.notes == ("ended early: function fault",)


def forged(**values: float) -> Tamper:
    """A wire on which the drive says this from `END_S` on, and signs it."""

    def tamper(name: str | None, frame: Frame):
        if name != "DriveFeedback" or frame.timestamp < END_S:
            return (frame,)
        read = {reading.name: reading.value for reading in codec().decode(frame).readings}
        said = codec().encode("DriveFeedback", read | values, frame.timestamp)
        last_counter = (protection.counter_of(frame.data) - 1) % protection.COUNTS
        protection.protect(said.data, CAN.data_ids.drive_feedback, last_counter)
        return (said,)

    return tamper


@pytest.mark.parametrize(("shown_mps", "detail"), [(0.04, "has left that of wheel and ground"), (None, "frozen")])
def test_a_speed_of_the_drive_that_is_not_the_machines_ends_it_and_it_is_said_why(shown_mps, detail):
    without = ("WBSD", "GBSD") if shown_mps is None else ()
    lie = forged(ground_speed_mps=shown_mps or 0.04)
    whole = Whole(tamper=lambda name, frame: () if name in without else lie(name, frame)).run(END_S + 1.0)
    assert whole.states[-1] == (pytest.approx(END_S + 0.6, abs=0.4), State.FAULT)
    assert whole.node.engagement.exit_condition == "implausible"
    assert detail in whole.node.engagement.exit_detail


def test_steps_that_the_radar_shows_later_than_the_drive_do_not_end_it():
    steps = Steps(levels_ma=(1150.0, 450.0), hold_min_s=4.0, hold_max_s=4.0, seconds=12.0)
    downhill = Conditions(machine_mass_kg=9000.0, grade_deg=-8.0)
    experiment = msgspec.structs.replace(NOISE, excitation=steps, conditions=downhill)
    driven = drive_on_bus(experiment, cruise_settings(), plant_settings())
    assert driven.ended_by == ""
    assert np.ptp(driven.recording.output) > 1.5


def test_wheel_and_radar_end_it_beyond_its_speed_too():
    whole = Whole(tamper=forged(ground_speed_mps=0.2))
    whole.node.plausibility = None
    experiment = msgspec.structs.replace(NOISE, speed_max_mps=1.0)
    whole.node.engagement.experiments[NOISE.number] = experiment
    whole.run(12.0)
    assert whole.node.engagement.exit_condition == "too_fast"
    assert whole.combine.truth.ground_speed_mps < 1.1


def test_it_does_not_begin_while_another_node_sends_its_commands_and_then_it_is_switched_off_and_on():
    rows = (
        OperatorRow(at_s=3.0, cruise_enable=0.0),
        OperatorRow(at_s=3.5, cruise_enable=1.0),
        OperatorRow(at_s=4.0, press="set"),
    )
    whole = Whole(*rows).run(1.0)
    command = {"pump_current_command_ma": 700.0, "command_active": 1.0}
    whole.node.receive(codec().encode("PumpCurrentCommand", command, 1.0))
    whole.run(2.5)
    assert whole.node.engagement.state is State.STANDBY
    assert whole.node.engagement.refused == "signals contradict each other: another node sends our messages"
    assert whole.run(4.5).node.engagement.state is State.COMMISSIONING


def test_a_brake_in_the_middle_leaves_a_recording_that_says_so():
    driven = drive_on_bus(
        NOISE, cruise_settings(), plant_settings(), operator=(OperatorRow(at_s=8.0, brake_pedal=1.0),)
    )
    assert driven.ended_by == "brake"
    assert len(driven.recording) == pytest.approx(80, abs=2)
    assert driven.recording.notes == ("ended early: override",)


def test_what_never_began_is_an_error_with_the_reason():
    with pytest.raises(RecordingError, match="did not begin: brake or clutch is pressed"):
        drive_on_bus(NOISE, cruise_settings(), plant_settings(), operator=(OperatorRow(at_s=1.86, brake_pedal=1.0),))


def test_a_stopped_service_leaves_neutral_behind():
    whole = Whole().run(END_S)
    frames = whole.node.stop(END_S)
    said = [codec().decode(frame) for frame in frames]
    values = {reading.name: reading.value for decoded in said for reading in decoded.readings}
    assert [decoded.message for decoded in said] == [
        "PumpCurrentCommand",
        "MachineSelectedSpeed",
        "CommissioningStatus",
    ]
    assert (values["command_active"], values["pump_current_command_ma"]) == (0.0, 0.0)
    assert values["experiment_progress"] == Progress.ENDED_EARLY


def test_a_paused_process_is_a_fault_and_lets_go():
    whole = Whole().run(END_S)
    frames = whole.node.tick(END_S + 0.4)
    assert whole.node.engagement.state is State.FAULT
    values = {reading.name: reading.value for reading in codec().decode(frames[0]).readings}
    assert (values["command_active"], values["pump_current_command_ma"]) == (0.0, 0.0)


def test_a_recorder_ends_with_a_service_that_falls_silent():
    whole = Whole(tamper=tampered("CommissioningStatus", END_S)).run(END_S + 1.0)
    assert whole.recorder.ended
    assert len(whole.recorder.rows) == pytest.approx((END_S - EXCITING_S) * 20.0, abs=1)


def test_a_recorder_takes_no_other_experiment_and_none_that_is_over():
    other, late = Recorder(codec(), 4, 20.0), Recorder(codec(), 3, 20.0)
    whole = Whole(OperatorRow(at_s=4.5, brake_pedal=1.0))
    whole.loop = Lockstep([*whole.loop.ends, (other, whole.wire.end())])
    whole.run(5.0)
    whole.loop = Lockstep([*whole.loop.ends, (late, whole.wire.end())])
    whole.loop.steps = 500
    whole.run(6.0)
    assert not other.begun
    assert not late.begun
    assert late.rows == []
    with pytest.raises(RecordingError, match="with 0 samples: the recorder was stopped"):
        late.recording("late")


@pytest.mark.parametrize("progress", [math.nan, 6.0])
def test_a_recorder_does_not_mind_a_progress_that_it_does_not_know(progress):
    recorder, speaker = Recorder(codec(), 3, 20.0), codec()
    status = {"driven_experiment": 3.0, "experiment_progress": progress, "experiment_left_s": 1.0}
    recorder.receive(speaker.encode("CommissioningStatus", status, 1.0))
    assert not recorder.begun


def test_a_recorder_keeps_the_first_of_two_runs():
    again = (OperatorRow(at_s=5.0, brake_pedal=0.0), OperatorRow(at_s=6.5, press="set"))
    whole = Whole(OperatorRow(at_s=4.5, brake_pedal=1.0), *again).run(5.0)
    rows = len(whole.recorder.rows)
    whole.run(10.0)
    assert whole.node.engagement.state is State.COMMISSIONING
    assert whole.node.commissioning.progress is Progress.EXCITING
    assert whole.recorder.progress is Progress.ENDED_EARLY
    assert len(whole.recorder.rows) == rows > 8


def test_the_service_reads_its_experiments_from_the_file_of_its_settings(tmp_path):
    text = (CONFIG / "cruise.yaml").read_text()
    for name in ("factory_model.yaml", "cruise.dbc", "cruise.eds", "experiments.yaml"):
        (tmp_path / name).write_bytes((CONFIG / name).read_bytes())
    path = tmp_path / "cruise.yaml"
    path.write_text(text + "\ncommissioning:\n  experiments: experiments.yaml\n")
    node = CruiseNode.load(service_settings.load(path))
    assert set(node.engagement.experiments) >= {1, 2, 3, 10, 20, 30}
    assert experiments.load(tmp_path / "experiments.yaml").keys() >= {"white_noise", "steps", "ramp", "multisine"}
    bare = CruiseNode.load(cruise_settings())
    assert bare.engagement.experiments == {}
    path.write_text(text + "\ncommissioning:\n  experiments: experiments.yaml\n  limits: {current_max_ma: 1700}\n")
    with pytest.raises(SettingsError, match=r"commissioning\.limits\.current_max_ma is 1700"):
        service_settings.load(path)
