"""The model of the drive, one object for estimator, controller and workbench.

    y_k = alpha [ sum_i a_i y_(k-i) + g(s_k) sum_j b_j f(u)_(k-d-j) + sum_m c_m phi_m(s_k, y_(k-1)) + c_0 ]
          + (1 - alpha) y_(k-1)

y ground speed in m/s, u pump current in mA, s the other measured signals, all means over one period; f the command
effects, g the gain effects, phi the load effects, d the delay in samples, alpha the pace of gears and stroke. a (na,),
b (nb,), c (m,) and c_0 are linear parameters, in this order in `theta`. Source: equations 3, 11 and 12 of Coen et al.
2005, widened by effects.

A drive yields more at a greater stroke (`cruise.model.core`), by l = i (1 + s (K |w| / v_0 - 1)) with K w = sum_j b_j
f(u)_(k-d-j) / (1 - a): phi is multiplied by it, and the pace is (1 - a^(1/l)) / (1 - a).

Everything works elementwise: on floats while driving, on arrays of start points when a recording is predicted from
every sample at once.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cruise.effects import Effect, Inverse, Stage
from cruise.effects.effect import State, Value, clip
from cruise.effects.stroke import factor
from cruise.signals import Signals

Undo = Callable[[Effect, Inverse, Signals, State], Inverse]


def exactly(effect: Effect, wanted: Inverse, signals: Signals, state: State) -> Inverse:
    """The values that give an interval of wanted ones, by the effect's own inverse."""
    below, above = (effect.inverse(end, signals, state) for end in (wanted.low, wanted.high))
    refused = below.refused or above.refused
    return Inverse(math.nan, math.nan, refused=refused) if refused else Inverse(below.low, above.high)


def yields(effect: Effect) -> bool:
    """Whether an effect says how far the drive yields."""
    return type(effect).yielding is not Effect.yielding


def paces(effect: Effect, stroke_share: float) -> bool:
    """Whether an effect moves the poles by its pace: not where it does so by how far the drive yields."""
    return type(effect).pace is not Effect.pace and not (stroke_share and yields(effect))


def stroke_pace(pole: Value, yielding: Value) -> Value:
    """(1 - a^(1/l)) / (1 - a): the factor on a pole a > 0 of a drive that yields by l."""
    return (1.0 - clip(pole, 0.0, math.inf) ** (1.0 / yielding)) / (1.0 - pole)


class ModelState(NamedTuple):
    """All that the model remembers between two samples; newest first. Values are floats, or arrays of start points."""

    speeds: tuple[Value, ...]  # y_(k-1) ..., m/s
    drives: tuple[Value, ...]  # f(u)_k ..., mA, reaching back over delay and order
    gain: Value  # g(s_k)
    pace: Value  # alpha(s_k)
    loads: tuple[Value, ...]  # l_k phi_m(s_k, y_(k-1))
    effects: tuple[State, ...]  # one per effect


class Regression(NamedTuple):
    """One line of the least squares problem: y = offset + columns . theta."""

    columns: tuple[Value, ...]
    offset: Value


@dataclass(frozen=True, slots=True)
class DriveResponse:
    """The model about the present state, linear in the drive signal f(u) in mA.

    y_k = sum_i speed_coefficients_i y_(k-i) + sum_j drive_coefficients_j v_(k-delay-j) + offset_mps
    """

    speed_coefficients: tuple[float, ...]
    drive_coefficients: tuple[float, ...]
    delay: int
    offset_mps: float

    def free(
        self, speeds: Sequence[float], drives: Sequence[float], disturbance_mps: float, horizon: int
    ) -> np.ndarray:
        """Speeds (horizon,) in m/s after y_k if the drive signal were zero from now on.

        `speeds` and `drives` are y_k, y_(k-1)... and v_k, v_(k-1)..., newest first.
        """
        past_speeds = list(speeds[: len(self.speed_coefficients)])
        past_drives = list(drives)
        result = np.empty(horizon)
        for i in range(horizon):
            past_drives.insert(0, 0.0)
            speed = self.offset_mps + disturbance_mps
            speed += sum(a * y for a, y in zip(self.speed_coefficients, past_speeds, strict=False))
            speed += sum(b * v for b, v in zip(self.drive_coefficients, past_drives[self.delay :], strict=False))
            past_speeds.insert(0, speed)
            result[i] = speed
        return result

    def forced(self, horizon: int) -> np.ndarray:
        """Matrix (horizon, horizon): response of y_(k+1).. to a unit of drive in v_(k+1).., in m/s per mA."""
        impulse = np.zeros(horizon)
        for i in range(horizon):
            j = i - self.delay
            direct = self.drive_coefficients[j] if 0 <= j < len(self.drive_coefficients) else 0.0
            impulse[i] = direct + sum(
                a * impulse[i - 1 - n] for n, a in enumerate(self.speed_coefficients) if i - 1 - n >= 0
            )
        lag = np.subtract.outer(np.arange(horizon), np.arange(horizon))
        return np.where(lag >= 0, impulse[np.maximum(lag, 0)], 0.0)

    @property
    def dc_gain(self) -> float:
        """Steady speed per mA of drive."""
        return sum(self.drive_coefficients) / (1.0 - sum(self.speed_coefficients))


@dataclass(frozen=True)
class Model:
    """The ARX structure, its effects and its parameters. Frozen: learning and fitting make a new one."""

    period_s: float
    na: int
    nb: int
    delay: int  # samples
    effects: tuple[Effect, ...]
    theta: tuple[float, ...]  # a, b, c, c_0
    theta_std: tuple[float, ...] = ()  # standard errors of the fit, the trust that learning puts into it
    residual_std_mps: float = 0.02  # one step ahead
    stroke_share: float = 0.0  # s, of how far it yields, that is in proportion to the stroke

    def __post_init__(self) -> None:
        if self.period_s <= 0 or min(self.na, self.nb, self.delay) < 0 or self.na + self.nb < 1:
            raise ValueError(f"no such structure: na={self.na}, nb={self.nb}, delay={self.delay}, {self.period_s} s")
        if len(self.theta) != len(self.parameter_names):
            raise ValueError(f"{len(self.theta)} parameters given, {len(self.parameter_names)} needed")
        if self.stroke_share and self.na != 1:
            raise ValueError(f"the stroke slows down a drive of one pole, not of na={self.na}")

    # -- structure

    @cached_property
    def command_effects(self) -> tuple[tuple[int, Effect], ...]:
        """The effects that reshape the current, in order, each with its place in the state; then those that watch it.

        An effect of the dynamics sees the drive signal that the others leave and passes it on unchanged.
        """
        return self._at(Stage.COMMAND) + self.dynamics_effects

    @cached_property
    def dynamics_effects(self) -> tuple[tuple[int, Effect], ...]:
        """The effects that watch the drive signal and pass it on."""
        return self._at(Stage.DYNAMICS)

    @cached_property
    def gain_effects(self) -> tuple[tuple[int, Effect], ...]:
        """The effects that scale the drive."""
        return self._at(Stage.GAIN)

    @cached_property
    def load_effects(self) -> tuple[tuple[int, Effect], ...]:
        """The effects that add a force term."""
        return self._at(Stage.LOAD)

    @cached_property
    def pacing_effects(self) -> tuple[tuple[int, Effect], ...]:
        """The effects that move the poles, but for those by which the drive yields, where the model knows how."""
        return tuple((i, effect) for i, effect in enumerate(self.effects) if paces(effect, self.stroke_share))

    @cached_property
    def reads_speed(self) -> bool:
        """Whether an effect reads the speed: then nothing can be computed ahead of the recursion."""
        return any(effect.reads_speed for effect in self.effects)

    def _at(self, stage: Stage) -> tuple[tuple[int, Effect], ...]:
        return tuple((i, effect) for i, effect in enumerate(self.effects) if effect.acts_as is stage)

    @cached_property
    def needs(self) -> tuple[str, ...]:
        """The signals beside current and speed without which the model can't say anything."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.needs))

    @cached_property
    def uses(self) -> tuple[str, ...]:
        """The signals beside current and speed that it reads where they are measured."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.uses))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `theta`: a_1.., b_0.., the load effects, c_0."""
        a = [f"a_{i + 1}" for i in range(self.na)]
        b = [f"b_{j}_mps_per_ma" for j in range(self.nb)]
        c = [f"c_{effect.name}" for _, effect in self.load_effects]
        return (*a, *b, *c, "c_0_mps")

    def with_theta(self, theta: Iterable[float]) -> "Model":
        """The same structure with other linear parameters."""
        return replace(self, theta=tuple(float(value) for value in theta))

    # -- recursion

    def start(self, speed_mps: Value, current_ma: Value, signals: Signals) -> ModelState:
        """The state of a machine that has been driving steadily."""
        states = tuple(effect.start(current_ma) for effect in self.effects)
        drive = current_ma
        for i, effect in self.command_effects:
            drive, _ = effect.step(drive, speed_mps, signals, states[i], self.period_s)
        depth = max(self.delay + self.nb, 1)
        return ModelState((speed_mps,) * max(self.na, 1), (drive,) * depth, 1.0, 1.0, (), states)

    def apply(self, state: ModelState, current_ma: Value, signals: Signals) -> ModelState:
        """The state once the current and the signals of sample k are known, and its speed is not."""
        return self._stepped(state, current_ma, signals, self.command_effects)

    def _stepped(
        self, state: ModelState, drive: Value, signals: Signals, chain: tuple[tuple[int, Effect], ...]
    ) -> ModelState:
        """One sample on, with `drive` going through `chain`, which is all or the end of the command effects."""
        last, dt_s = state.speeds[0], self.period_s
        memory = list(state.effects)
        gain, loads = 1.0, []
        for i, effect in chain:
            drive, memory[i] = effect.step(drive, last, signals, memory[i], dt_s)
        drives = (drive, *state.drives[:-1])
        yielding = self.yielding(drives, signals)
        pace = self.stroke_pace(yielding)
        for i, effect in self.gain_effects:
            gain, memory[i] = effect.step(gain, last, signals, memory[i], dt_s)
        for i, effect in self.pacing_effects:
            pace = pace * effect.pace(signals, memory[i])
        for i, effect in self.load_effects:
            load, memory[i] = effect.step(0.0, last, signals, memory[i], dt_s)
            loads.append(yielding * load)
        return ModelState(state.speeds, drives, gain, pace, tuple(loads), tuple(memory))

    def yielding(self, drives: Sequence[Value], signals: Signals) -> Value:
        """l, how far the drive yields at the stroke that the vehicle feels; `drives` f(u)_k ... in mA, newest first."""
        if not self.stroke_share:
            return 1.0
        a, b, *_ = self.split(self.theta)
        felt_mps = sum(value * v for value, v in zip(b, drives[self.delay :], strict=False)) / (1.0 - sum(a))
        return factor(self.stroke_share, felt_mps) * self.gear_yielding(signals)

    def gear_yielding(self, signals: Signals) -> Value:
        """i, what of it the gear does."""
        if not self.stroke_share:
            return 1.0
        return math.prod(effect.yielding(signals) for effect in self.effects if yields(effect))

    def usual_pace(self, state: ModelState, signals: Signals) -> Value:
        """The factor on the poles now, but for a usual stroke."""
        whole, gear = self.yielding(state.drives, signals), self.gear_yielding(signals)
        return state.pace / self.stroke_pace(whole) * self.stroke_pace(gear)

    def stroke_pace(self, yielding: Value) -> Value:
        """The factor on the pole of a drive that yields so far."""
        return stroke_pace(self.theta[0], yielding) if self.stroke_share else 1.0

    def observe(self, state: ModelState, speed_mps: Value) -> ModelState:
        """The state once the speed of sample k is known too."""
        return ModelState((speed_mps, *state.speeds[:-1]), *state[1:])

    def advance(self, state: ModelState, current_ma: Value, speed_mps: Value, signals: Signals) -> ModelState:
        """One whole measured sample on."""
        return self.observe(self.apply(state, current_ma, signals), speed_mps)

    def regression(self, state: ModelState) -> Regression:
        """Columns and offset for the speed of the sample that was applied last (equation 12 lives here)."""
        pace, drive = state.pace, state.pace * state.gain
        columns = [pace * speed for speed in state.speeds[: self.na]]
        columns += [drive * v for v in state.drives[self.delay : self.delay + self.nb]]
        columns += [pace * load for load in state.loads]
        columns.append(pace)
        return Regression(tuple(columns), (1.0 - pace) * state.speeds[0])

    def next_speed(self, state: ModelState) -> Value:
        """The speed in m/s that the model expects for the sample that was applied last."""
        columns, speed = self.regression(state)
        for parameter, column in zip(self.theta, columns, strict=True):
            speed = speed + parameter * column
        return speed

    def predict(self, state: ModelState, currents_ma: Sequence[Value], signals: Sequence[Signals]) -> list[Value]:
        """Speeds in m/s over the coming samples, given their currents and signals; nothing is measured on the way."""
        speeds = []
        for current_ma, now in zip(currents_ma, signals, strict=True):
            state = self.apply(state, current_ma, now)
            speed = self.next_speed(state)
            state = self.observe(state, speed)
            speeds.append(speed)
        return speeds

    # -- the controller's view

    def linearise(self, state: ModelState, signals: Signals) -> DriveResponse:
        """The model at the present signals, linear in the drive signal, with everything that the gears do to it."""
        held = state.drives[0]  # what watches the drive signal must not see a change that nobody has asked for
        now = self._stepped(state, held, signals, self.dynamics_effects)
        a, b, loads, c_0 = self.split(self.theta)
        speed = [now.pace * value for value in a] or [0.0]
        speed[0] += 1.0 - now.pace
        drive = tuple(now.pace * now.gain * value for value in b)
        offset = now.pace * (c_0 + sum(c * phi for c, phi in zip(loads, now.loads, strict=True)))
        return DriveResponse(tuple(speed), drive, self.delay, offset)

    def split(self, theta: Sequence[float]) -> tuple[Sequence[float], Sequence[float], Sequence[float], float]:
        """theta as a, b, c and c_0."""
        na, nb = self.na, self.nb
        return theta[:na], theta[na : na + nb], theta[na + nb : -1], theta[-1]

    def drive_for(self, current_ma: float, state: ModelState, signals: Signals) -> float:
        """f(u): the drive signal in mA that a current gives now, once a servo has followed it."""
        drive: float = current_ma
        for i, effect in self.command_effects:
            drive = effect.settled(drive, state.speeds[0], signals, state.effects[i], self.period_s)
        return drive

    def current_for(self, drive_ma: float, state: ModelState, signals: Signals, undo: Undo = exactly) -> Inverse:
        """The currents that give a wanted drive signal, or why there are none; `undo` takes back one effect."""
        wanted = Inverse(drive_ma, drive_ma)
        for i, effect in reversed(self._at(Stage.COMMAND)):
            wanted = undo(effect, wanted, signals, state.effects[i])
            if wanted.refused:
                break
        return wanted

    # -- what the linear parameters mean

    @property
    def poles(self) -> np.ndarray:
        """Poles of the predictor in the z plane, in second gear."""
        a, *_ = self.split(self.theta)
        return np.roots([1.0, *(-value for value in a)]) if self.na else np.zeros(0)

    @property
    def dc_gain_mps_per_ma(self) -> float:
        """Steady speed per mA of drive at rated engine speed in second gear."""
        a, b, *_ = self.split(self.theta)
        return float(sum(b) / (1.0 - sum(a)))

    def missing(self, names: Iterable[str]) -> tuple[str, ...]:
        """The needed signals that are not among `names`."""
        known = set(names)
        return tuple(name for name in self.needs if name not in known)

    def usable(self, signals: Mapping[str, float]) -> bool:
        """Whether every needed signal was measured."""
        return not any(math.isnan(signals.get(name, math.nan)) for name in self.needs)
