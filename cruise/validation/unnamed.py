"""Dependences that no effect of the table describes: smooth functions of one recorded signal, as the catch-all.

    gain     g = 1 + p_1 z + p_2 z^2 + p_3 z^3
    load     phi_i = z^i tanh(y / 0.1 m/s)
    push     phi_i = z^i
    command  f(u) = u + sign(u) sum_i p_i [clip(|u|, u_i, u_i+1) - u_i] - p_r min(u, 0)
    rest     f(u) = u - u_r
    z = clip((s - centre) / half width of the middle 96 %, -1.5, 1.5)

They compete with the effects on the same data, as flexible as any curve that could be drawn, and without physics: where
one of them explains much more than every effect, what is missing depends on that signal and is not in the table.
The last one is none of them: the current at which a line through what was driven meets standstill. No recording shows
it while the gain stays the same, for it is an offset of the speed then; a gain that changes turns the line about it.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np

from cruise.effects import Effect, Parameter, Stage
from cruise.effects.effect import About, State, Value, clip, sign, tanh, where
from cruise.signals import Signals

POWERS: Final = (1, 2, 3)
PUSHES: Final = (1, 2)  # powers of what pushes along the ground, whichever way the machine moves
MOVING_MPS: Final = 0.1  # m/s, below which a load is taken to be held rather than felt
FARTHEST: Final = 1.5  # half widths; beyond, a cubic says anything
KNOTS_PCT: Final = (1, 4, 10, 22, 38, 55, 72, 86, 95, 99)  # percentiles of the current's size, closer at both ends
MIDDLE: Final = 5  # the piece whose slope the core's gain is; ten others have their own
STEERS: Final = 0.02  # of the largest current: with less the machine is meant to stand
DIRECTION_S: Final = 1.0  # s over which the current's direction is felt
DIRECTION_MA: Final = 10.0  # mA by which it must have moved
_CURVE: Final = {f"p{i}": Parameter("-", -0.9, 0.9, 0.0, f"coefficient of power {i}") for i in POWERS}
_ABOUT: Final = About(
    physics="Not an effect of the table: a smooth dependence on one recorded signal.",
    equation="g = 1 + p_1 z + p_2 z^2 + p_3 z^3;  phi = z^i",
    source="none",
    signature="the residual depends on this signal",
    look_alikes=("every effect that this signal moves with",),
    experiment="move this signal alone, everything else held",
)


@dataclass(frozen=True)
class Unnamed(Effect):
    """What the dependences have in common: the signal, and how it is brought to -1..1."""

    about: ClassVar = _ABOUT
    parameters: ClassVar = {}

    signal: str
    centre: float
    half_width: float

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        return () if self.signal == SPEED else (self.signal,)

    @property
    def reads_speed(self) -> bool:  # type: ignore[override]
        return self.signal == SPEED

    def reshaped(self, **shape: Any) -> "Unnamed":
        return replace(self, **shape)

    def scaled(self, past_speed: Value, signals: Signals) -> Value:
        """z, without unit."""
        value = past_speed if self.signal == SPEED else signals[self.signal]
        return clip((value - self.centre) / self.half_width, -FARTHEST, FARTHEST)


SPEED: Final = "modelled_speed_mps"  # the model's own, one sample ago: a column may be called speed_mps


@dataclass(frozen=True)
class UnnamedGain(Unnamed):
    """The gain as a cubic of a signal."""

    stage = Stage.GAIN
    parameters: ClassVar = _CURVE

    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0

    @property
    def name(self) -> str:  # type: ignore[override]
        return f"{self.signal}:gain"

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far times the cubic."""
        z = self.scaled(past_speed, signals)
        return value * (1.0 + z * (self.p1 + z * (self.p2 + z * self.p3))), state


@dataclass(frozen=True)
class UnnamedLoad(Unnamed):
    """One power of a signal as a load of either sign, felt while the machine moves."""

    stage = Stage.LOAD
    either_sign: ClassVar = True
    reads_speed = True  # type: ignore[assignment]

    power: int = 1

    @property
    def name(self) -> str:  # type: ignore[override]
        return f"{self.signal}:load{self.power}"

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """z to its power, with the sign of the motion."""
        return self.scaled(past_speed, signals) ** self.power * tanh(past_speed / MOVING_MPS), state


@dataclass(frozen=True)
class UnnamedPush(Unnamed):
    """One power of a signal as a load of either sign, felt whichever way the machine moves, as a slope is."""

    stage = Stage.LOAD
    either_sign: ClassVar = True

    power: int = 1

    @property
    def name(self) -> str:  # type: ignore[override]
        return f"{self.signal}:push{self.power}"

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """z to its power."""
        return self.scaled(past_speed, signals) ** self.power, state


@dataclass(frozen=True)
class UnnamedCurve(Effect):
    """A broken line of the current's size, steeper or flatter below zero."""

    about: ClassVar = _ABOUT
    stage = Stage.COMMAND
    name = "current:curve"
    needs = ()
    parameters: ClassVar = {
        **{
            f"p{i}": Parameter("-", -1.5, 3.0, 0.0, f"slope of piece {i}, over that of the middle one, less one")
            for i in range(len(KNOTS_PCT))
        },
        "reverse": Parameter("-", -0.9, 0.9, 0.0, "slope that is lost below zero"),
    }

    knots_ma: tuple[float, ...]
    p0: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    p5: float = 0.0
    p6: float = 0.0
    p7: float = 0.0
    p8: float = 0.0
    p9: float = 0.0
    reverse: float = 0.0

    def reshaped(self, **shape: Any) -> "UnnamedCurve":
        return replace(self, **shape)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The current with a slope of its own between every two knots."""
        slopes = (self.p0, self.p1, self.p2, self.p3, self.p4, self.p5, self.p6, self.p7, self.p8, self.p9)
        edges = (0.0, *self.knots_ma, math.inf)
        pieces = [*pairwise(edges[: MIDDLE + 1]), *pairwise(edges[MIDDLE + 1 :])]
        more = sum(p * (clip(abs(value), low, high) - low) for p, (low, high) in zip(slopes, pieces, strict=True))
        return value + sign(value) * more - self.reverse * clip(value, -math.inf, 0.0), state


@dataclass(frozen=True)
class UnnamedDirection(Effect):
    """A load of either sign that depends on whether the current has been rising or falling."""

    about: ClassVar = _ABOUT
    stage = Stage.DYNAMICS
    acts_as = Stage.LOAD
    either_sign: ClassVar = True
    name = "current:direction"
    needs = ("pump_current_ma",)
    parameters: ClassVar = {}

    def start(self, like: Value) -> State:
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """tanh of how far the current is from its own recent past."""
        current = signals["pump_current_ma"]
        slow = where(state == state, state + (1.0 - math.exp(-dt_s / DIRECTION_S)) * (current - state), current)
        return tanh((current - slow) / DIRECTION_MA), slow


@dataclass(frozen=True)
class RestCurrent(Effect):
    """The current in mA about which a gain turns the line of the drive."""

    about: ClassVar = _ABOUT
    stage = Stage.COMMAND
    name = "current:rest"
    needs = ()
    parameters: ClassVar = {"rest_ma": Parameter("mA", -1000.0, 1000.0, 0.0, "current of the line at standstill")}

    rest_ma: float = 0.0

    def reshaped(self, **shape: Any) -> "RestCurrent":
        return replace(self, **shape)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The current beyond that at rest."""
        return value - self.rest_ma, state


def rest_of(effects: Iterable[Effect]) -> RestCurrent | None:
    """The current about which the gains among them turn the line of the drive, if it is none of them."""
    return next((one for one in effects if isinstance(one, RestCurrent)), None)


def knots_of(current_ma: np.ndarray) -> tuple[float, ...]:
    """Where the curve of the current is broken, in mA: at percentiles of its size while it steers."""
    size = np.abs(current_ma[np.isfinite(current_ma)])
    return tuple(np.percentile(size[size >= STEERS * size.max()], KNOTS_PCT).tolist())


def range_of(values: np.ndarray) -> tuple[float, float]:
    """Centre and half width of the middle 96 % of what was measured; half width 0 where nothing moves."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0
    low, high = np.percentile(known, [2, 98])
    if high <= low:
        low, high = float(known.min()), float(known.max())
    return 0.5 * float(low + high), 0.5 * float(high - low)
