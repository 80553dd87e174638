"""Experiments on the machine: the virtual combine driven directly or over the bus; what was heard is a recording.

Direct and bus give the same within the noise of the sensors: the same current changes at the same instants. Directly
it is 200 times faster than the machine, over the bus the very service drives that drives a real one.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from cruise import settings as strict
from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.messages import FAST_MESSAGE
from cruise.control.commissioning import CommissioningSettings, Conditions, Experiment, Experiments, Progress
from cruise.control.engagement import ExitReason
from cruise.control.excitation import GRID_S, ROUNDING
from cruise.model import files
from cruise.plant import Combine, Inputs, PlantSettings, SensorReading
from cruise.recording import MIN_SAMPLES, Recording, RecordingError
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.service.combine_node import CombineNode
from cruise.service.course import FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lockstep
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings
from cruise.signals import CONTEXT, INPUT, OUTPUT

RATE_HZ: Final = 20.0  # of the paper's recordings, and of our frames
STANDSTILL_S: Final = 2.0  # s, running engine before the experiment begins: its speed has settled
SILENT_S: Final = 0.5  # s, ten frames of status
FAST_SENSOR: Final = "drive_feedback"  # whose speed it is; the radar shows one too
OPERATOR: Final = (
    OperatorRow(at_s=0.2, cruise_enable=1.0),
    OperatorRow(at_s=STANDSTILL_S - 0.15, press="set"),  # is on the bus with the panel's next frame
)


def load(path: str | Path) -> dict[str, Experiment]:
    """The experiments of a file by name. SettingsError where something in it is wrong."""
    return {experiment.name: experiment for experiment in strict.load(path, Experiments).experiments}


def drive(
    experiment: Experiment,
    plant: PlantSettings,
    conditions: Conditions | None = None,
    seed: int | None = None,
    rate_hz: float = RATE_HZ,
    context: Sequence[str] = CONTEXT,
) -> Recording:
    """Drive the virtual combine directly, without a bus, and return the excited part at `rate_hz`, from time zero.

    `conditions` and `seed` default to the experiment's own; the seed draws the excitation and the sensors' noise.
    `context`: which signals to sample beside current and speed; fewer are faster. Samples are means over 1 / rate_hz,
    as everywhere. The limits that hold on a bus (top speed, range) are not applied here.
    """
    experiment = altered(experiment, conditions, seed)
    conditions, current = experiment.conditions, experiment.current()
    combine = Combine(loaded(plant, conditions), _sensor_seed(experiment))
    sampler = StreamSampler(SamplingSettings(), (INPUT, OUTPUT, *context))
    streams = sampler.streams

    def inputs(current_ma: float) -> Inputs:
        return Inputs(
            pump_current_ma=current_ma,
            engine_speed_setpoint_rpm=conditions.engine_speed_rpm,
            gear=conditions.gear,
            grade_deg=conditions.grade_deg,
            rolling_resistance=conditions.rolling_resistance,
        )

    combine.advance(inputs(0.0), STANDSTILL_S)
    taken, rows = 0, []
    for frame in range(math.ceil(current.end_s / GRID_S - ROUNDING)):
        end_s = (frame + 1) * GRID_S
        for reading in combine.advance(inputs(current.current_ma(frame * GRID_S)), STANDSTILL_S + end_s):
            assert isinstance(reading, SensorReading)
            if reading.name in streams and (reading.name != OUTPUT or reading.sensor == FAST_SENSOR):
                streams[reading.name].push(reading.time_s, reading.value)
        while (sample_s := current.begin_s + (taken + 1) / rate_hz) <= end_s + ROUNDING:
            taken += 1
            rows.append(sampler.sample(STANDSTILL_S + sample_s, 1.0 / rate_hz))
    return _recording(rows, rate_hz, described(experiment))


@dataclass(frozen=True, slots=True)
class Driven:
    """An experiment over the bus: what was recorded, and how it ended."""

    recording: Recording
    ended_by: str  # the condition that ended it early, see control/engagement.py; empty where it came to its end


def drive_on_bus(
    experiment: Experiment,
    settings: CruiseSettings,
    plant: PlantSettings,
    rate_hz: float = RATE_HZ,
    operator: tuple[OperatorRow, ...] = (),
    show: Callable[[float], None] | None = None,
) -> Driven:
    """Drive the virtual combine over a virtual bus: combine, scripted operator and service in lockstep.

    `operator`: what the operator does besides asking for the experiment, times from the start of the engine, rows after
    `STANDSTILL_S`. `show` is told the time. RecordingError where it never began or ended at once, with the reason.
    """
    can = msgspec.structs.replace(settings.can, bus="virtual", channel="experiment")
    settings = msgspec.structs.replace(
        settings,
        can=can,
        canopen=None,
        setpoint_from="j1939",  # there is no CANopen panel on this bus
        commissioning=settings.commissioning or CommissioningSettings(experiments="experiments"),
    )
    asking = OperatorRow(at_s=0.5, requested_experiment=experiment.number)
    rows = (OPERATOR[0], asking, *OPERATOR[1:], *operator)
    codecs = [Codec.load(settings.database, can) for _ in range(4)]
    combine = Combine(loaded(plant, experiment.conditions), _sensor_seed(experiment))
    node = CruiseNode(settings, files.load(settings.model), codecs[0], experiments=(experiment,))
    recorder = Recorder(codecs[3], experiment.number, rate_hz)
    machine = CombineNode(combine, codecs[1], (_field(experiment.conditions),), rows)
    nodes = (machine, OperatorNode(codecs[2], rows), node, recorder)
    buses = [open_bus(can) for _ in nodes]
    try:
        loop = Lockstep(list(zip(nodes, buses, strict=True)))
        until_s = STANDSTILL_S + experiment.duration_s + 1.0
        while loop.now_s < until_s and not recorder.ended and (recorder.begun or loop.now_s < STANDSTILL_S + 1.0):
            loop.run(min(loop.now_s + 1.0, until_s))
            if show is not None:
                show(loop.now_s)
    finally:
        for bus in buses:
            bus.close()
    if not recorder.begun:
        raise RecordingError(
            f"{experiment.name}: did not begin: {node.engagement.refused or 'the panel was not heard'}"
        )
    early = recorder.ended_by and node.engagement.exit_condition.replace("_", " ")
    return Driven(recorder.recording(described(experiment)), early)


class Recorder:
    """A node that only listens: it samples every signal of the bus while one experiment excites.

    Samples lie on a grid that begins with the first frame of the excitation, so that every one of them holds whole
    frames of current.
    """

    def __init__(self, codec: Codec, number: int, rate_hz: float) -> None:
        self.codec = codec
        self.number = number
        self.rate_hz = rate_hz
        self.period_s = 1.0 / rate_hz
        self.sampler = StreamSampler(SamplingSettings(), (INPUT, OUTPUT, *CONTEXT))
        self.progress = Progress.NONE
        self.from_s = math.inf  # when the excitation began
        self.until_s = math.inf  # when it ended
        self.heard_s = math.inf  # when the service last said how it stands
        self.exit_reason = ExitReason.NONE
        self.rows: list[dict[str, float]] = []

    @property
    def begun(self) -> bool:
        """Whether the experiment was begun."""
        return self.progress is not Progress.NONE

    @property
    def ended(self) -> bool:
        """Whether the experiment was begun and has come to an end."""
        return self.progress in (Progress.FINISHED, Progress.ENDED_EARLY)

    def receive(self, frame: Frame) -> None:
        """Take one frame in, whatever it is."""
        decoded = self.codec.decode(frame)
        if decoded.message == "CommissioningStatus" and decoded.fault is None:
            self._follow({reading.name: reading.value for reading in decoded.readings}, frame.timestamp)
        if decoded.message == "MachineSelectedSpeed" and decoded.fault is None:
            codes = (reading.value for reading in decoded.readings if reading.name == "exit_reason")
            self.exit_reason = next(
                (reason for code in codes for reason in ExitReason if reason == code), self.exit_reason
            )
        for reading in decoded.readings:
            if reading.name in (INPUT, OUTPUT) and decoded.message != FAST_MESSAGE:
                continue
            if reading.name in self.sampler.streams:
                self.sampler.push(reading.name, reading.time_s, reading.value)

    def tick(self, now_s: float) -> list[Frame]:
        """Take the samples that are due; it says nothing. A service that falls silent has ended the experiment."""
        if now_s - self.heard_s > SILENT_S and not self.ended:
            self.progress, self.until_s = Progress.ENDED_EARLY, min(self.until_s, self.heard_s)
            if self.rows:
                del self.rows[math.floor((self.until_s - self.from_s) * self.rate_hz + ROUNDING) :]
        while (end_s := self.from_s + (len(self.rows) + 1) * self.period_s) <= min(now_s, self.until_s) + ROUNDING:
            self.rows.append(self.sampler.sample(end_s, self.period_s))
        return []

    @property
    def ended_by(self) -> str:
        """Why it ended early, empty where it did not: the exit reason on the bus, or that this recorder was stopped."""
        if self.progress in (Progress.LEADING_OUT, Progress.FINISHED):
            return ""
        return self.exit_reason.name.lower().replace("_", " ") if self.ended else "the recorder was stopped"

    def recording(self, source: str) -> Recording:
        """What was sampled. RecordingError where that is too little."""
        if len(self.rows) < MIN_SAMPLES:
            raise RecordingError(f"{source}: ended with {len(self.rows)} samples: {self.ended_by}")
        notes = (f"ended early: {self.ended_by}",) if self.ended_by else ()
        return _recording(self.rows, self.rate_hz, source, notes)

    def _follow(self, status: Mapping[str, float], time_s: float) -> None:
        progress = next((one for one in Progress if one == status["experiment_progress"]), None)
        if progress is None:
            return
        earlier = self.progress is Progress.NONE and progress in (Progress.FINISHED, Progress.ENDED_EARLY)
        if status["driven_experiment"] != self.number or earlier or self.ended:
            return
        self.heard_s = time_s
        if progress is Progress.EXCITING and self.from_s == math.inf:
            self.from_s = time_s
        if progress is not Progress.EXCITING and self.from_s < self.until_s == math.inf:
            self.until_s = time_s
        self.progress = progress


def altered(
    experiment: Experiment,
    conditions: Conditions | None = None,
    seed: int | None = None,
    seconds: float | None = None,
) -> Experiment:
    """The same experiment with what is given instead of its own."""
    return msgspec.structs.replace(
        experiment,
        conditions=conditions or experiment.conditions,
        seed=experiment.seed if seed is None else seed,
        excitation=experiment.excitation if seconds is None else experiment.excitation.lasting(seconds),
    )


def loaded(plant: PlantSettings, conditions: Conditions) -> PlantSettings:
    """The same combine with the mass of the conditions."""
    vehicle = msgspec.structs.replace(plant.vehicle, mass_kg=conditions.machine_mass_kg)
    return msgspec.structs.replace(plant, vehicle=vehicle)


def described(experiment: Experiment) -> str:
    """What was driven, in one line."""
    conditions = experiment.conditions
    return (
        f"{experiment.name}, gear {conditions.gear}, {conditions.machine_mass_kg:.0f} kg, "
        f"{conditions.grade_deg:+.1f} deg, {conditions.engine_speed_rpm:.0f} rpm, seed {experiment.seed}"
    )


def _sensor_seed(experiment: Experiment) -> int:
    """Seed of the virtual combine: two experiments of one seed don't share the noise of their sensors."""
    return int(np.random.SeedSequence((experiment.number, experiment.seed)).generate_state(1)[0])


def _field(conditions: Conditions) -> FieldRow:
    return FieldRow(
        at_s=0.0,
        engine_speed_setpoint_rpm=conditions.engine_speed_rpm,
        gear=conditions.gear,
        grade_deg=conditions.grade_deg,
        rolling_resistance=conditions.rolling_resistance,
    )


def _recording(
    rows: Sequence[Mapping[str, float]], rate_hz: float, source: str, notes: tuple[str, ...] = ()
) -> Recording:
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Recording(np.arange(1, len(rows) + 1) / rate_hz, columns, 1.0 / rate_hz, source, notes, averaged=True)
