"""Can all of this be true? What the signals say about each other, as one table of checks.

A check compares what is seen with what another source makes of it and gives how much of the allowed difference is used:
above 1 for `for_s` without a break, the signals contradict each other. NaN (nothing to compare with) is no
contradiction: a missing signal is the engagement's matter. Rows with `driving` need the controller's own commands.
Rows with `experiment` hold while an experiment drives, too, whose steps and noise are rougher than a sensor's fault:
two speeds of which one comes later differ there, unless the rate is allowed for.

What no row can see: a speed of which all sensors err alike, and a panel that lies alone in its place. There the limits
on current, rate and acceleration are all that bounds the harm.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from typing import Final

import msgspec

from cruise.control.engine_jump import RATE_S, EngineJump
from cruise.control.lateness import Lateness
from cruise.control.suddenness import Suddenness
from cruise.control.usual import UsualShares
from cruise.settings import Positive, refuse_wide

WINDOW_S: Final = 0.25  # s of commands with which the measured current is compared: time-out of the drive and a frame
STILL_MA: Final = 8.0  # mA within that time: a command that moves by less shows the output stage's error as it is
USUAL_S: Final = 5.0  # s, time constant of that error: temperature and voltage move it, and not at once
SMOOTH_S: Final = 0.2  # s, time constant through which two speeds are compared
QUICKER: Final = 2.0  # standard deviations, by which a drive may answer more quickly than it is believed to
JUMP_S: Final = 0.2  # s over which the model's errors are summed
TEXTURE_S: Final = 0.5  # s, time constant of the roughness
WIDEST: Final = 3.0  # times its default that a threshold may be
LEAST_READINGS: Final = 8  # equal ones that make a sensor frozen: at 5 Hz it may repeat itself by chance


class PlausibilitySettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far signals may differ before somebody lies."""

    current_ma: Positive = 40.0  # mA, regulator's error and noise: 3 % of the range
    # mA by which that error may change at once: 3 % of a change of the current by 300 mA are 9
    current_change_ma: Positive = 15.0
    late_ma: Positive = 2.0  # mA RMS by which a delay beyond the time-out explains the current better; noise makes 0.3
    speed_mps: Positive = 0.12  # m/s, noise and the radar's delay in a quick change
    speed_share: Positive = 0.04  # of the speed, scale of a radar: data sheets give 3..5 %
    speed_change_mps: Positive = 0.08  # m/s beyond what is usual between them; noise and slopes make 0.03
    slip_share: Positive = 0.15  # of the speed, more by which wheels may run ahead where no radar is there to tell
    accel_mps2: Positive = 4.0  # m/s2, the tyres give about 0.4 g
    engine_rpm_per_s: Positive = 1500.0  # 1/min per s, free run-up of a diesel of this class
    speed_roughness_mps: Positive = 0.15  # m/s, RMS of second differences; 0.04 at a noise of 0.015
    current_roughness_ma: Positive = 30.0  # mA; 2.5 at a noise of 1
    engine_roughness_rpm: Positive = 60.0  # 1/min; 5 at a noise of 2
    frozen_s: Positive = 0.5  # s without any change: noise moves a sensor that lives
    # m/s that 5 degrees and soft soil take in the slow gears (0.2); a fast one loses more by equation 12, over alpha
    disturbance_mps: Positive = 0.25
    disturbance_share: Positive = 0.3  # of the speed, the model's error
    # m/s within 0.2 s that no command explains, half of it within 0.1 s: 1.5 m/s2; rolling freely on 5 degrees is 0.17,
    # noise makes 0.15 and 0.08
    jump_mps: Positive = 0.3
    # m/s within 0.4 s more than in the 0.4 s before: a force of 0.45 m/s2 that comes at once; a hill of 8 degrees that
    # comes within 2.5 s makes 0.09, and noise 0.07
    force_mps: Positive = 0.18
    force_share: Positive = 0.5  # of how much the drive itself does so; more in a fast gear, whose pace is not known
    behind_mps: Positive = 0.3  # m/s that the machine may be behind the reference
    crowd: Positive = 1.6  # of the usual frames of a message in a second: more is a second sender
    faulty_share: Positive = 0.5  # of the last frames of a protected message
    repeated: Positive = 24.0  # frames of the drive in the order of an earlier stretch; two of noise alone are rare
    wavering: Positive = 2.5  # times in a second: an operator may change his mind twice
    slowness: Positive = 1.5  # of the program's own period

    def __post_init__(self) -> None:
        refuse_wide(self, WIDEST)


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame period as the checks see it. NaN where nothing is known."""

    time_s: float
    speed_mps: float  # of the drive, mean over the frame
    wheel_mps: float
    radar_mps: float
    current_ma: float  # measured
    commanded_ma: float  # sent last, NaN while somebody else drives
    followed_mps: float  # reference or setpoint, whichever is less: ahead of a falling reference is not behind
    disturbance_mps: float  # in m/s of steady speed, what the model does not explain
    expected_mps: float  # of the change of the speed in this frame, what drive and loads make by the model
    unexpected_mps: float  # the rest, what no command explains
    coming_mps: tuple[float, ...]  # by frame, what currents on their way will still change of it by the model
    quicker: float  # times that the drive may be quicker than it is believed, by so many standard deviations
    alpha: float  # equation 12: 1 in the slow gears, less in those that a hill slows down more
    crowding: float  # the busiest message's frames in the last second over those that were usual when engaging
    faulty_share: float  # of the last frames of the worst protected message
    repeated: int  # frames of the drive in a row that came before, in the same order
    imposters: int  # frames of our own messages that we did not send, since the operator switched on
    wavering: int  # times in the last second that the setpoint went back to the one before
    upset: bool  # what is kept twice (state of the observer, model, current sent last) is no longer the same
    slowness: float  # mean time between two ticks over the period
    experimenting: bool = False  # an experiment drives


@dataclass(slots=True)
class Texture:
    """How a sensor's readings look: since when they have not changed, and how rough they are."""

    value: float = math.nan
    slope: float = math.nan
    changed_s: float = math.nan
    equal: int = 0
    mean_square: float = 0.0
    last_s: float = math.nan

    def take(self, time_s: float, value: float) -> None:
        """One reading."""
        passed_s, self.last_s = time_s - self.last_s, time_s
        change = value - self.value
        self.value = value
        if change == 0.0:
            self.equal += 1
        else:
            self.equal, self.changed_s = 0, time_s
        bend, self.slope = change - self.slope, change
        if math.isfinite(bend) and passed_s > 0.0:
            share = min(passed_s / TEXTURE_S, 1.0)
            self.mean_square += share * (bend * bend - self.mean_square)

    @property
    def roughness(self) -> float:
        """RMS of the second differences."""
        return math.sqrt(self.mean_square)

    @property
    def frozen_s(self) -> float:
        """How long nothing has changed; 0 for too few readings."""
        return self.last_s - self.changed_s if self.equal >= LEAST_READINGS else 0.0


TEXTURED: Final = ("ground_speed_mps", "pump_current_ma", "engine_speed_rpm")


@dataclass(slots=True)
class Memory:
    """What the checks need of the past."""

    frame_s: float
    settings: PlausibilitySettings
    textures: dict[str, Texture] = field(default_factory=lambda: {name: Texture() for name in TEXTURED})
    commands: deque[tuple[float, float]] = field(default_factory=deque)  # time and current, while the controller drives
    error_ma: float = math.nan  # of the output stage, NaN while its command moves
    usual_ma: float = math.nan  # the same over USUAL_S, also from earlier drives
    smooth: list[float] = field(default_factory=lambda: [math.nan] * 3)  # speed, wheel, radar
    past: deque[tuple[float, float]] = field(default_factory=deque)  # time and speed
    unexpected: deque[float] = field(default_factory=deque)  # m/s, by frame
    usual: UsualShares = field(init=False)
    lateness: Lateness = field(init=False)
    suddenness: Suddenness = field(init=False)
    engine: EngineJump = field(init=False)

    def __post_init__(self) -> None:
        self.usual = UsualShares(self.frame_s)
        self.lateness = Lateness(self.frame_s, WINDOW_S)
        self.suddenness = Suddenness(self.frame_s)
        self.engine = EngineJump(self.settings.engine_rpm_per_s, self.frame_s)

    def take(self, seen: Seen) -> None:
        """One frame period on."""
        share = 1.0 - math.exp(-self.frame_s / SMOOTH_S)
        for i, value in enumerate((seen.speed_mps, seen.wheel_mps, seen.radar_mps)):
            known = math.isfinite(self.smooth[i]) and math.isfinite(value)
            self.smooth[i] = self.smooth[i] + share * (value - self.smooth[i]) if known else value
        self.past.append((seen.time_s, seen.speed_mps))
        while seen.time_s - self.past[0][0] > RATE_S + 1e-6:
            self.past.popleft()
        self.unexpected.append(seen.unexpected_mps)
        while len(self.unexpected) * self.frame_s > JUMP_S + 1e-6:
            self.unexpected.popleft()
        self.suddenness.take(seen.expected_mps, seen.unexpected_mps, seen.coming_mps)
        if math.isfinite(seen.commanded_ma):
            self.commands.append((seen.time_s, seen.commanded_ma))
        else:
            self.commands.clear()
        while self.commands and seen.time_s - self.commands[0][0] > WINDOW_S + 1e-6:
            self.commands.popleft()
        self._regulated(seen)
        self.lateness.take(seen.commanded_ma, seen.current_ma)
        speed, wheel, radar = self.smooth
        slips = not math.isfinite(radar)  # and nothing is there to tell
        self.usual.take(
            speed, (math.nan if slips else wheel, radar), self.settings.speed_change_mps, self.settings.speed_share
        )

    def unexpected_mps(self, for_s: float) -> float:
        """What no command explains of the change of the speed in the last so many seconds."""
        first = len(self.unexpected) - round(for_s / self.frame_s)
        return sum(islice(self.unexpected, max(first, 0), None))

    def _regulated(self, seen: Seen) -> None:
        sent = [current_ma for _, current_ma in self.commands]
        full = bool(sent) and seen.time_s - self.commands[0][0] > WINDOW_S - self.frame_s
        still = full and max(sent) - min(sent) < STILL_MA
        self.error_ma = seen.current_ma - sum(sent) / len(sent) if still else math.nan
        if math.isfinite(self.error_ma):
            known = math.isfinite(self.usual_ma)
            share = 1.0 - math.exp(-self.frame_s / USUAL_S)
            self.usual_ma = self.usual_ma + share * (self.error_ma - self.usual_ma) if known else self.error_ma


def _current(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    sent = [current_ma for _, current_ma in memory.commands]
    if len(sent) < 2:
        return math.nan
    return max(seen.current_ma - max(sent), min(sent) - seen.current_ma) / settings.current_ma


def _regulation(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    return abs(memory.error_ma - memory.usual_ma) / settings.current_change_ma


def _speeds(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    """Two of three: the drive's speed has to agree with one of the others, as long as there is one.

    Wheels may slip only where there is no radar: a drive that shows too little would else pass for one that slips.
    """
    speed, wheel, radar = memory.smooth
    allowed = settings.speed_mps + settings.speed_share * abs(speed)
    wheel_ahead = (wheel - speed) * math.copysign(1.0, speed)
    slip = 0.0 if math.isfinite(radar) else settings.slip_share * abs(speed)
    from_wheel = max(wheel_ahead / (allowed + slip), -wheel_ahead / allowed)
    found = [one for one in (from_wheel, abs(radar - speed) / allowed) if math.isfinite(one)]
    return min(found, default=math.nan)


def _acceleration(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    (first_s, first_mps), (last_s, last_mps) = memory.past[0], memory.past[-1]
    passed_s = last_s - first_s
    return abs(last_mps - first_mps) / passed_s / settings.accel_mps2 if passed_s > 0.0 else math.nan


def _rough(memory: Memory, settings: PlausibilitySettings) -> float:
    allowed = (settings.speed_roughness_mps, settings.current_roughness_ma, settings.engine_roughness_rpm)
    return max(memory.textures[name].roughness / most for name, most in zip(TEXTURED, allowed, strict=True))


def _frozen(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    """In an experiment, which begins at standstill, a sensor may count nothing."""
    textures = [one for one in memory.textures.values() if not (seen.experimenting and one.value == 0.0)]
    return max((texture.frozen_s for texture in textures), default=0.0) / settings.frozen_s


def _force(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    """A brake that nobody sees, or a sensor that jumps: a hill, however steep, comes in seconds.

    A drive that answers more quickly than it is believed, as a fast gear may, does more of what it does, and sooner,
    but nothing in the other direction.
    """
    sudden = memory.suddenness
    own_mps = max(settings.force_share * sudden.own_mps, (seen.quicker - 1.0) * sudden.same_mps)
    return sudden.more_mps / (settings.force_mps + own_mps)


def _jump(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    """The same rate over the whole time and over half of it: what comes within a frame or two is no mass that moves."""
    whole_mps, half_mps = (abs(memory.unexpected_mps(for_s)) for for_s in (JUMP_S, 0.5 * JUMP_S))
    return max(whole_mps, 2.0 * half_mps) / settings.jump_mps


def _response(seen: Seen, memory: Memory, settings: PlausibilitySettings) -> float:
    allowed = settings.disturbance_mps / seen.alpha + settings.disturbance_share * abs(seen.speed_mps)
    return abs(seen.disturbance_mps) / allowed


@dataclass(frozen=True, slots=True)
class Check:
    """One row: what contradicts what, which share of the allowed difference is used, and how long it may be above 1."""

    name: str
    used: Callable[[Seen, Memory, PlausibilitySettings], float]
    for_s: float
    driving: bool = False
    experiment: bool = False

    def asked(self, seen: Seen) -> bool:
        """Whether it says something about who drives now."""
        return not self.driving or math.isfinite(seen.commanded_ma) or (self.experiment and seen.experimenting)


CHECKS: Final = (
    Check("another node sends our messages", lambda seen, memory, settings:
          math.inf if seen.imposters else 0.0, 0.0, experiment=True),
    Check("frames of a message come damaged or out of order", lambda seen, memory, settings:
          seen.faulty_share / settings.faulty_share, 0.0, experiment=True),
    Check("the drive's frames were heard before", lambda seen, memory, settings:
          seen.repeated / settings.repeated, 0.0, experiment=True),
    Check("a message has a second sender", lambda seen, memory, settings: seen.crowding / settings.crowd, 0.0, True),
    Check("two setpoints take turns", lambda seen, memory, settings: seen.wavering / settings.wavering, 0.0),
    Check("the program's memory changed by itself", lambda seen, memory, settings:
          math.inf if seen.upset else 0.0, 0.0, experiment=True),
    Check("the program gets too little time", lambda seen, memory, settings:
          seen.slowness / settings.slowness, 0.0, experiment=True),
    Check("the current does not follow its command", _current, 0.1, True),
    Check("the current has left its command", _regulation, 0.05, True),
    Check("the current is late behind its command", lambda seen, memory, settings:
          memory.lateness.late_ma / settings.late_ma, 0.1, True),
    Check("the drive's speed is not that of wheel and ground", _speeds, 0.3),
    Check("the drive's speed has left that of wheel and ground", lambda seen, memory, settings:
          memory.usual.used, 0.3, experiment=True),
    Check("the speed changes faster than tyres allow", _acceleration, 0.1),
    Check("the engine speed changes faster than it can", lambda seen, memory, settings:
          memory.engine.rate_rpm_per_s / settings.engine_rpm_per_s, 0.05),
    Check("the engine speed has jumped and not come back", lambda seen, memory, settings:
          math.inf if memory.engine.jumped else 0.0, 0.05),
    Check("a sensor is too noisy", lambda seen, memory, settings: _rough(memory, settings), 0.2),
    Check("a sensor is frozen", _frozen, 0.0, True, experiment=True),
    Check("current and speed do not fit the model", _response, 0.3),
    Check("the speed changes as no command did", _jump, 0.0, True),
    Check("a force came at once, as no hill does", _force, 0.0, True),
    Check("the machine does not follow", lambda seen, memory, settings:  # 1.3 s in fourth gear out of a valley
          (seen.followed_mps - seen.speed_mps) / (settings.behind_mps + 0.1 * abs(seen.speed_mps)), 1.5, True),
)  # fmt: skip


class Plausibility:
    """`contradiction` is the answer, `in_experiment` that of the checks that hold there; the rest is its state."""

    def __init__(self, settings: PlausibilitySettings, frame_s: float) -> None:
        self.settings = settings
        self.memory = Memory(frame_s, settings)
        self.since_s: dict[str, float] = {}
        self.contradiction = self.in_experiment = ""

    def read(self, name: str, time_s: float, value: float) -> None:
        """One reading as it came off the bus."""
        texture = self.memory.textures.get(name)
        if texture is not None:
            texture.take(time_s, value)
        if name == "engine_speed_rpm":
            self.memory.engine.take(time_s, value)

    def step(self, seen: Seen) -> str:
        """One frame period on; which signals can't all be true, or nothing."""
        self.memory.take(seen)
        found = []
        for check in CHECKS:
            fails = check.asked(seen) and check.used(seen, self.memory, self.settings) > 1.0
            if not fails:
                self.since_s.pop(check.name, None)
                continue
            since_s = self.since_s.setdefault(check.name, seen.time_s)
            if seen.time_s - since_s >= check.for_s - 1e-6:
                found.append(check)
        self.contradiction = next((check.name for check in found), "")
        self.in_experiment = next((check.name for check in found if check.experiment), "")
        return self.contradiction
