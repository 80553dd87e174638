"""The cruise control on the bus: frames in, samples, learning, engagement, control, frames out.

It has no clock and no bus: the loop hands it frames and the time, and sends what it returns.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cruise import settings as strict
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.node import CanopenNode, NodeStatus
from cruise.control.commissioning import Commissioning, CommissioningLimits, Experiment, Experiments, check
from cruise.control.controller import NEUTRAL, Command, Controller
from cruise.control.engagement import Engagement, ExitReason, State
from cruise.control.plausibility import QUICKER, Plausibility, Seen
from cruise.control.situation import Situation
from cruise.estimation.estimator import Learned
from cruise.estimation.gate import Gate
from cruise.estimation.supervision import Decision
from cruise.model import files
from cruise.model.model import Model
from cruise.sampling import StreamSampler
from cruise.service.hearing import RADAR, Hearing
from cruise.service.learning import Learning
from cruise.service.pace import Pace
from cruise.service.settings import CruiseSettings
from cruise.service.telling import Telling
from cruise.settings import SettingsError
from cruise.signals import CONTEXT, INPUT, OUTPUT, Sample

SPEED_PERIOD_S = 0.1  # s, of the machine selected speed (ISO 11783-7)
_OPERATOR = ("cruise_enable", "cruise_set", "cruise_resume", "cruise_accelerate", "cruise_coast")
_SAFETY = ("brake_pedal", "clutch_pedal", "lever_pct")
_ASKED = ("setpoint_mps", "cruise_enable")  # what a CANopen panel may ask for instead
_DRIVE = (INPUT, OUTPUT, "gear", *_SAFETY)  # what an experiment needs, and the controller beside what its model does
_FRAMES = (INPUT, OUTPUT, *CONTEXT)
_SAMPLED = (*_FRAMES, "brake_pedal", "clutch_pedal")


@dataclass(frozen=True, slots=True)
class Status:
    """What the service knows about itself, for display, log and bus."""

    time_s: float
    state: State
    setpoint_mps: float
    experiment: str
    experiment_left_s: float
    speed_mps: float
    current_ma: float
    command: Command
    gate: Gate
    learned: Model
    rms_ahead_mps: dict[str, float]
    adoptions: int
    decision: Decision | None  # about a learned model, the last one
    exit_reason: ExitReason
    exit_condition: str
    exit_detail: str
    refused: str
    faults: dict[str, int]
    missing: tuple[str, ...]


class CruiseNode:
    """One cruise control: `tick` every `period_s`, `receive` in between."""

    def __init__(
        self,
        settings: CruiseSettings,
        model: Model,
        codec: Codec,
        canopen: CanopenNode | None = None,
        experiments: Sequence[Experiment] = (),
    ) -> None:
        self.settings = settings
        self.period_s = settings.control.frame_s
        self.codec = codec
        self.telling = Telling(codec)
        self.hearing = Hearing(codec, settings.sampling, self.period_s)
        self.plausibility: Plausibility | None = Plausibility(settings.plausibility, self.period_s)
        self.canopen = canopen
        self.sampler = StreamSampler(settings.sampling, _SAMPLED)  # over a period of the model, to learn from
        self.frame_sampler = StreamSampler(settings.sampling, _FRAMES)  # over a frame, to drive by
        self.controller = Controller(model, settings.control)
        self.learning = Learning(model, self.controller, settings.estimator, settings.supervision, settings.proof)
        self.estimator, self.supervisor = self.learning.estimator, self.learning.supervisor
        commissioning = settings.commissioning
        if commissioning is not None:
            check(experiments, commissioning, self.period_s)
        numbered = {experiment.number: experiment for experiment in experiments}
        self.engagement = Engagement(settings.engagement, commissioning, numbered)
        self.commissioning = Commissioning(
            commissioning.limits if commissioning else CommissioningLimits(), self.period_s
        )
        self.needed = tuple(dict.fromkeys((*_DRIVE, *model.needs)))
        self.ticks = 0
        self.pace = Pace(self.period_s)
        self.speed_every = max(round(SPEED_PERIOD_S / self.period_s), 1)
        self.sample: Sample | None = None
        self.learned = Learned(math.nan, math.nan, Gate.WARMING_UP)
        self.command = NEUTRAL
        self.ailment = ""  # of the bus, in words: what whoever runs this knows of it
        self.missing: tuple[str, ...] = self.needed

    @classmethod
    def load(cls, settings: CruiseSettings, rest_ma: float = 0.0) -> "CruiseNode":
        """The node with everything that its settings name. SettingsError where a file is wrong.

        `rest_ma` is the current of what was recorded that is 0 on its bus.
        """
        canopen = CanopenNode.load(settings.dictionary, settings.canopen) if settings.canopen else None
        commissioning = settings.commissioning
        experiments = strict.load(commissioning.experiments, Experiments).experiments if commissioning else ()
        codec, file = Codec.load(settings.database, settings.can), files.read(settings.model)
        model, from_ma = files.model_of(settings.model, file), file.provenance.input_rest_ma
        if from_ma != rest_ma:
            raise SettingsError(
                f"{settings.model}: its current is counted from {from_ma:g} mA, where the machine stands, that of the "
                f"bus from {rest_ma:g}: give the current's signals in {settings.database} that offset, and set "
                "input_rest_ma in the model's provenance to 0"
            )
        if not (np.abs(model.poles).max(initial=0.0) < 1.0 and model.dc_gain_mps_per_ma > 0.0):
            raise SettingsError(f"{settings.model}: not a stable drive with a positive gain; identify it anew")
        try:
            return cls(settings, model, codec, canopen, experiments)
        except (ValueError, ArithmeticError) as error:
            raise SettingsError(f"{settings.model}, or the settings: nothing drives with these: {error}") from error

    def receive(self, frame: Frame) -> list[Frame]:
        """Take one frame in, whatever it is; returns the answer to a CANopen client."""
        by_canopen, answers = self.settings.setpoint_from == "canopen", []
        if self.canopen is not None:
            for reading in self.canopen.receive(frame):
                if by_canopen:
                    self.hearing.take_word(reading)
            answers = self.canopen.answers()
        ignored = _ASKED if by_canopen else ()
        for reading in self.hearing.take(frame, ignored):
            if reading.name in self.sampler.streams:
                self.sampler.push(reading.name, reading.time_s, reading.value)
            if reading.name in self.frame_sampler.streams:
                self.frame_sampler.push(reading.name, reading.time_s, reading.value)
            if self.plausibility is not None:
                self.plausibility.read(reading.name, reading.time_s, reading.value)
        return answers

    def tick(self, now_s: float) -> list[Frame]:
        """One frame period on: learn and plan where a model period ends, decide who drives, command the pump."""
        sample = self._next_sample(now_s)
        if sample is not None:
            self._learn(sample)
        on_time = self.pace.tick(now_s)
        frame = self._frame(now_s)
        contradiction = self.plausibility.step(self._seen(frame)) if self.plausibility is not None else ""
        situation, unmeasured = self._situation(now_s), self._unmeasured(frame)
        before = self.engagement.state
        state = self.engagement.step(
            replace(
                situation,
                ailment=situation.ailment or ("" if on_time else self.pace.words),
                signals_valid=situation.signals_valid and not unmeasured,
                missing=tuple(dict.fromkeys((*situation.missing, *unmeasured))),
                contradiction=contradiction,
                contradiction_in_experiment=self.plausibility.in_experiment if self.plausibility is not None else "",
            )
        )
        self.hearing.compare(now_s, state.controls)
        if before is State.OFF and state is not State.OFF:
            self.hearing.imposters = 0
        setpoint_mps = self.engagement.setpoint_mps if state.controls else None
        self.command = self.controller.step(frame, setpoint_mps, gently=state is State.ENGAGING)
        if state is State.COMMISSIONING:
            self.command = Command(self._excite(now_s), math.nan, math.nan, "")
        else:
            self.commissioning.end(now_s)
        self.ticks += 1
        ends = before.drives and not state.drives  # whoever hears that it has ended shall know why
        frames = self._frames(now_s, speed=ends or self.ticks % self.speed_every == 0)
        if self.canopen is not None:
            frames += self.canopen.tick(now_s, self._node_status(now_s))
        return frames

    def stop(self, now_s: float) -> list[Frame]:
        """The last frames: released, neutral, whatever the law would say. It does not engage after this."""
        self.engagement.step(replace(self._situation(now_s), enable=False))
        self.ailment = "stopped"
        self.command = NEUTRAL
        self.commissioning.end(now_s)
        return self._frames(now_s, speed=True)

    def status(self, now_s: float) -> Status:
        """What to show."""
        supervisor = self.supervisor
        return Status(
            time_s=now_s,
            state=self.engagement.state,
            setpoint_mps=self.engagement.setpoint_mps,
            experiment=self.engagement.experiment.name if self.engagement.experiment else "",
            experiment_left_s=self.commissioning.left_s(now_s),
            speed_mps=self._value(OUTPUT, now_s),
            current_ma=self._value(INPUT, now_s),
            command=self.command,
            gate=self.learned.gate,
            learned=self.estimator.snapshot(),
            rms_ahead_mps=supervisor.rms_mps,
            adoptions=supervisor.adoptions,
            decision=supervisor.decision,
            exit_reason=self.engagement.exit_reason,
            exit_condition=self.engagement.exit_condition,
            exit_detail=self.engagement.exit_detail,
            refused=self.engagement.refused,
            faults=dict(self.hearing.faults),
            missing=self.missing,
        )

    def _next_sample(self, now_s: float) -> Sample | None:
        period_s = self.estimator.factory.period_s
        if self.ticks % self.controller.frames:
            return None
        means = self.sampler.sample(now_s, period_s)
        signals = {name: means.get(name, math.nan) for name in (*CONTEXT, OUTPUT)}
        return Sample(
            now_s,
            means.get(INPUT, math.nan),
            means.get(OUTPUT, math.nan),
            signals,
            engaged=self.engagement.state.controls,
            reference_mps=self.controller.asked_mps,
            overridden=means.get("brake_pedal", 0.0) > 0.5 or means.get("clutch_pedal", 0.0) > 0.5,
        )

    def _frame(self, now_s: float) -> Sample:
        """The machine over the frame that ends now."""
        means = self.frame_sampler.sample(now_s, self.period_s)
        signals = {name: means[name] for name in (*CONTEXT, OUTPUT)}
        return Sample(now_s, means[INPUT], means[OUTPUT], signals)

    def _unmeasured(self, sample: Sample) -> tuple[str, ...]:
        """Of what too little was measured over this very sample to steer by, however fresh the newest readings are."""
        means = {**sample.signals, INPUT: sample.current_ma, OUTPUT: sample.speed_mps}
        return tuple(name for name in self.needed if name in means and not math.isfinite(means[name]))

    def _excite(self, now_s: float) -> float:
        """The current of the experiment, begun here where it has not yet begun."""
        experiment = self.engagement.experiment
        assert experiment is not None
        if self.commissioning.excitation is None:
            self.commissioning.begin(experiment, now_s)
        return self.commissioning.step(now_s)

    def _learn(self, sample: Sample) -> None:
        self.sample = sample
        if self.engagement.state is State.COMMISSIONING:
            # An experiment teaches nobody here: it excites above 1 Hz, where the structure that is learned has no place
            # for what it finds, and a model is made from it offline, where a person sees the residuals. To the
            # estimator it is a hole in the samples, after which it warms up anew.
            self.learned = Learned(math.nan, math.nan, Gate.OVERRIDDEN)
            return
        self.learned = self.learning.learn(sample)

    def _value(self, name: str, now_s: float) -> float:
        return self.hearing.value(name, now_s)

    def _seen(self, frame: Sample) -> Seen:
        """What the checks of plausibility compare."""
        controller, controls = self.controller, self.engagement.state.controls
        return Seen(
            time_s=frame.time_s,
            speed_mps=frame.speed_mps,
            wheel_mps=frame.signals["wheel_speed_mps"],
            radar_mps=self._value(RADAR, frame.time_s),
            current_ma=frame.current_ma,
            commanded_ma=self.command.current_ma if controls else math.nan,
            followed_mps=min(controller.past_references[0], self.engagement.setpoint_mps) if controls else math.nan,
            disturbance_mps=controller.observer.disturbance_mps if controller.state is not None else math.nan,
            expected_mps=controller.observer.expected_mps,
            unexpected_mps=controller.observer.unexpected_mps,
            coming_mps=controller.coming_mps if controls else (),
            quicker=controller.observer.quicker(QUICKER),
            alpha=self._alpha,
            crowding=self.hearing.crowding(frame.time_s),
            faulty_share=self.hearing.faulty_share(frame.time_s),
            repeated=self.hearing.playback.repeated,
            imposters=self.hearing.imposters,
            wavering=self.hearing.wavering(frame.time_s),
            upset=controller.upset or controller.adopted is not self.supervisor.driving,
            slowness=self.pace.slowness,
            experimenting=self.engagement.state is State.COMMISSIONING,
        )

    @property
    def _alpha(self) -> float:
        """Pace of equation 12 in the gear of the last sample."""
        state = self.controller.state
        return state.pace if state is not None else 1.0

    @property
    def _neutral_requested(self) -> bool:
        """By CANopen. A fault it does not lead out of: what comes and goes without the operator is no switch of his."""
        faulty = self.engagement.state is State.FAULT
        return self.canopen is not None and self.canopen.neutral_requested and not faulty

    def _situation(self, now_s: float) -> Situation:
        def on(name: str) -> bool:
            return self._value(name, now_s) > 0.5

        self.missing = tuple(name for name in self.needed if not math.isfinite(self._value(name, now_s)))
        stale = self.learned.gate is Gate.STALE_SIGNAL
        unmeasured = self._unmeasured(self.sample) if stale and self.sample is not None else ()
        speeds_mps = [self._value(name, now_s) for name in (OUTPUT, "wheel_speed_mps", RADAR)]
        return Situation(
            time_s=now_s,
            enable=on("cruise_enable") and not self._neutral_requested,
            set=on("cruise_set"),
            resume=on("cruise_resume"),
            accelerate=on("cruise_accelerate"),
            coast=on("cruise_coast"),
            operator_present=all(math.isfinite(self._value(name, now_s)) for name in _OPERATOR),
            # Newest readings may be fresh where too little of the last period was measured to steer by.
            drive_signals_valid=all(math.isfinite(self._value(name, now_s)) for name in _DRIVE),
            signals_valid=not self.missing and not stale,
            missing=tuple(dict.fromkeys((*self.missing, *unmeasured))),
            model_ready=self.controller.state is not None and self.learned.gate is not Gate.WARMING_UP,
            ailment=self.ailment,
            contradiction="",
            contradiction_in_experiment="",
            brake=on("brake_pedal"),
            clutch=on("clutch_pedal"),
            gear=self._value("gear", now_s),
            alpha=self._alpha,
            lever_pct=self._value("lever_pct", now_s),
            speed_mps=self._value(OUTPUT, now_s),
            fastest_mps=max((abs(one) for one in speeds_mps if math.isfinite(one)), default=math.nan),
            coming_mps2=0.0 if self.engagement.state.controls else self.controller.coming_mps2,
            requested_mps=self._value("setpoint_mps", now_s),
            reference_mps=self.controller.past_references[0],
            requested_experiment=0 if math.isnan(asked := self._value("requested_experiment", now_s)) else int(asked),
            experiment_over=self.commissioning.over(now_s),
        )

    def _frames(self, now_s: float, speed: bool) -> list[Frame]:
        engagement, tell = self.engagement, self.telling
        frames = [tell.command(engagement, self.command, now_s)]
        if speed:
            frames.append(tell.speed(engagement, self.command, self._value(OUTPUT, now_s), now_s))
        if self.settings.commissioning is not None:
            frames.append(tell.experiment(engagement, self.commissioning, now_s))
        return frames

    def _node_status(self, now_s: float) -> NodeStatus:
        return NodeStatus(
            ground_speed_mps=self._value(OUTPUT, now_s),
            followed_setpoint_mps=self.engagement.setpoint_mps,
            pump_current_ma=self._value(INPUT, now_s),
            engagement_state=float(list(State).index(self.engagement.state)),
        )
