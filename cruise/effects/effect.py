"""What a physical effect is: one term of the model, at one stage of it, with its physics written down.

An effect is a frozen dataclass whose fields are its shape parameters. Its `step` is elementwise, so that the same
lines serve a float online and an array of start points when a recording is predicted from every sample at once.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, Final, Self

import numpy as np

from cruise.signals import Signals

Value = Any
"""A float online, an array of the same meaning offline."""

State = Any
"""What an effect remembers between samples: None, a float, an array, or a tuple of these."""


RATED_RPM: Final = 2100.0  # rpm, speed of the engine at which the paper identified its models (section V.A)
EMPTY_KG: Final = 15000.0  # kg, mass of an empty combine harvester (Coen et al. 2005, section I: 15 to 20 t)
GRAVITY_MPS2: Final = 9.81  # m/s2
HELD_S: Final = 0.9  # s for which dry friction remembers what it held: longer than it takes to balance the drive


class Stage(StrEnum):
    """Where in the model an effect acts (design: y = sum a y + g(s) sum b f(u) + sum c phi + c_0)."""

    COMMAND = "command"  # reshapes the current: f
    GAIN = "gain"  # scales the drive: g
    LOAD = "load"  # adds a force term: phi
    DYNAMICS = "dynamics"  # changes delay, order or time constant
    SENSOR = "sensor"  # changes what the sensor shows


@dataclass(frozen=True, slots=True)
class Parameter:
    """A shape parameter of an effect: its unit, the range that is physically plausible, the value that removes it."""

    unit: str
    low: float
    high: float
    neutral: float
    meaning: str


@dataclass(frozen=True, slots=True)
class About:
    """What an engineer wants to know of an effect before believing in it."""

    physics: str
    equation: str
    source: str
    signature: str
    look_alikes: tuple[str, ...]
    experiment: str


@dataclass(frozen=True, slots=True)
class Inverse:
    """The interval of inputs that give a wanted output; empty, with the reason, where there is none."""

    low: float
    high: float
    refused: str = ""

    def nearest(self, to: float) -> float:
        """The input of the interval that lies nearest to `to`; NaN where the inverse was refused."""
        return float("nan") if self.refused else min(max(to, self.low), self.high)


class Effect(ABC):
    """One physical effect. What is not overridden here is that of an effect without memory.

    `value` is the current on its way to the drive (command), the gain so far (gain), or ignored (load); `past_speed` is
    the speed one sample ago in m/s; `state` is never changed in place.
    """

    __slots__ = ()

    name: ClassVar[str]
    stage: ClassVar[Stage]
    needs: ClassVar[tuple[str, ...]]  # signals without which it says nothing
    helps: ClassVar[tuple[str, ...]] = ()  # signals that it uses where they are measured, and does without elsewhere
    stands_for: ClassVar[tuple[str, ...]] = ()  # signals that show what it does from the cause itself, where recorded
    reads_speed: ClassVar[bool] = False  # whether `past_speed` matters to it
    either_sign: ClassVar[bool] = False  # of a load: whether it may also push; most only take speed
    brakes_hold: ClassVar[bool] = False  # of a load: whether it is none while the brakes hold a machine that stands
    parameters: ClassVar[Mapping[str, Parameter]]
    instead: ClassVar[tuple[str, ...]] = ()  # parameters by which it goes by other signals; neutral: it does not,
    told_by: ClassVar[tuple[str, ...]] = ()  # and the signals that those go by
    spare: ClassVar[tuple[str, ...]] = ()  # parameters each looked for only where the effect errs far less with it
    kind: ClassVar[str] = ""  # parameter that says which of two kinds it is: at one end of its bounds or at the other
    kinds: ClassVar[tuple[Mapping[str, float], ...]] = ()  # shapes from which fits of every kind begin
    about: ClassVar[About]
    acts_as: ClassVar[Stage]  # the stage at whose place in the equation it stands: its own, unless it names another

    def __init_subclass__(cls) -> None:
        if "stage" in vars(cls) and "acts_as" not in vars(cls):
            cls.acts_as = cls.stage

    @property
    def uses(self) -> tuple[str, ...]:
        """The signals that it reads where they are measured."""
        return (*self.needs, *self.helps)

    @property
    def idle(self) -> frozenset[str]:
        """Shapes that no fit looks for: those without an effect at present, and spare ones that are still neutral."""
        return frozenset(name for name in self.spare if getattr(self, name) == self.parameters[name].neutral)

    def reshaped(self, **shape: Value) -> Self:
        """The same effect with other shape parameters."""
        mine = {name: getattr(self, name) for name in self.parameters}
        return type(self)(**(mine | shape))

    def start(self, like: Value) -> State:
        """The state before the first sample, shaped like `like`; None where there is none."""
        return None

    @abstractmethod
    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """One sample on: the effect's output and its next state, elementwise."""

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording: output (N,) and state after each sample, every entry (N,); equals stepping.

        An effect with a memory may do it faster than one step after the other, which is what stands here.
        """
        state = self.start(0.0)
        if state is None:
            return self.step(values, past_speeds, signals, None, dt_s)
        values = np.broadcast_to(values, len(past_speeds)).tolist()
        names, columns = list(signals), [np.asarray(column, float).tolist() for column in signals.values()]
        rows = zip(*columns, strict=True) if columns else ((),) * len(values)
        results, states = [], []
        for value, past_speed, row in zip(values, past_speeds.tolist(), rows, strict=True):
            result, state = self.step(value, past_speed, dict(zip(names, row, strict=True)), state, dt_s)
            results.append(result)
            states.append(state)
        if isinstance(state, tuple):
            return np.array(results), tuple(np.array(column) for column in zip(*states, strict=True))
        return np.array(results), np.array(states)

    def settled(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> Value:
        """The effect's output for a value that stays: what it gives at once, for most."""
        return self.step(value, past_speed, signals, state, dt_s)[0]

    def pace(self, signals: Signals, state: State) -> Value:
        """The factor alpha by which the effect slows the poles down (equation 12 of the paper), 1 for most.

        `state` is that after the step of the same sample.
        """
        return 1.0

    def yielding(self, signals: Signals) -> Value:
        """How many times the speed a force costs that it costs in second gear, 1 for most.

        A model that knows how its drive yields (`cruise.model.core`) slows down by this, not by `pace`.
        """
        return 1.0

    def restructured(self, na: int, nb: int, delay: int, period_s: float) -> tuple[int, int, int]:
        """Orders and delay in samples of a model with this effect, from those of one without: the same for most."""
        return na, nb, delay

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The inputs that give `value`: only the command stage is inverted, the others scale what the drive gives."""
        return Inverse(np.nan, np.nan, refused=f"{self.name} does not act on the current")


def clip(value: Value, low: Value, high: Value) -> Value:
    """`value` within low..high, elementwise; NaN stays NaN."""
    if isinstance(value, np.ndarray):
        return np.minimum(np.maximum(value, low), high)
    return min(max(value, low), high)


def where(condition: Value, yes: Value, no: Value) -> Value:
    """`yes` where the condition holds and `no` elsewhere, elementwise."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, yes, no)
    return yes if condition else no


def anywhere(condition: Value) -> bool:
    """Whether the condition holds for any element."""
    return bool(condition.any()) if isinstance(condition, np.ndarray) else bool(condition)


def sign(value: Value) -> Value:
    """-1, 0 or 1, elementwise."""
    return np.sign(value) if isinstance(value, np.ndarray) else float(value > 0) - float(value < 0)


def softplus(value: Value, width: float) -> Value:
    """width ln(1 + exp(value / width)): the positive part of `value` with a rounded corner, elementwise."""
    if isinstance(value, np.ndarray):
        return np.maximum(value, 0.0) + width * np.log1p(np.exp(-np.abs(value) / width))
    return max(value, 0.0) + width * math.log1p(math.exp(-abs(value) / width))


def tanh(value: Value) -> Value:
    """The hyperbolic tangent, elementwise."""
    return np.tanh(value) if isinstance(value, np.ndarray) else math.tanh(value)


def dry(past_speed: Value, crossover_mps: Value, held: Value, dt_s: float) -> Value:
    """Share of a dry resistance that acts, elementwise: x_k = clip(h x_(k-1) + v / v_c, -1, 1).

    `held` is x one sample ago, h = exp(-dt / HELD_S). What builds up holds: a machine at rest hardly creeps, and the
    explicit recursion does not chatter about rest. P. Dahl, AIAA Journal 14 (1976) 1675-1682.
    """
    return clip(math.exp(-dt_s / HELD_S) * held + past_speed / crossover_mps, -1.0, 1.0)


def dry_over(past_speeds: np.ndarray, crossover_mps: float, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    """The same over a whole recording: the shares (N,) and what is held after each sample (N,), nothing after a hole.

    One narrow loop: the crossover is looked for in recordings of 10^5 samples.
    """
    memory, held = math.exp(-dt_s / HELD_S), 0.0
    shares = []
    for pushed in (past_speeds / crossover_mps).tolist():
        share = memory * held + pushed
        share = 1.0 if share > 1.0 else -1.0 if share < -1.0 else share
        shares.append(share)
        held = share if share == share else 0.0
    found = np.array(shares)
    return found, np.where(np.isnan(found), 0.0, found)
