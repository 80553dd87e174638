"""Custom: the user's own term, an expression of recorded signals that stands in the model file.

    command: f(u) = expression(value)        gain: g = expression        load: phi = expression

`value` current on its way to the drive in mA, `speed_mps` speed one sample ago, p1 to p9 shape parameters, every other
name a column of the recording but the output, which is what is predicted. In words of the command line, and of
structures: custom(NAME, STAGE, EXPRESSION).
"""

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value
from cruise.effects.expression import Expression, ExpressionError, read
from cruise.signals import OUTPUT, Signals

STAGES: Final = (Stage.COMMAND, Stage.GAIN, Stage.LOAD)
GREATEST_MA: Final = 2000.0  # mA, more than any coil of this class takes: how far an inverse is looked for
GRID: Final = 1001  # currents at which a characteristic has to rise: 4 mA apart
REFINEMENTS: Final = 4  # of an inverse, each a thousandfold: from 4 mA to 4e-9 mA
PARAMETERS: Final = tuple(f"p{i}" for i in range(1, 10))
CURRENT, SPEED = "value", "speed_mps"
USUAL_BOUNDS: Final = (-1.0, 1.0)  # where the user gives none


@dataclass(frozen=True)
class Custom(Effect):
    """A term under a name of its own. ExpressionError where the expression, or what it is used for, can't be."""

    name: str  # pyright: ignore[reportIncompatibleVariableOverride]  # the user's, an effect's own elsewhere
    stage: Stage  # pyright: ignore[reportIncompatibleVariableOverride]
    expression: str
    bounds: tuple[tuple[str, float, float], ...] = ()  # of parameters: name, low, high; all include 0
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    p5: float = 0.0
    p6: float = 0.0
    p7: float = 0.0
    p8: float = 0.0
    p9: float = 0.0

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.name):
            raise ExpressionError(f"name {self.name!r}: use small letters, digits and _, such as header_lift")
        stage_named(self.stage)
        names = self._read.names
        if (CURRENT in names) is not (self.stage is Stage.COMMAND):
            raise ExpressionError(
                f"a command term reshapes {CURRENT}, the current in mA, which is not in it"
                if self.stage is Stage.COMMAND
                else f"{CURRENT}, the current, is known to command terms only; this one is a {self.stage} term"
            )
        if OUTPUT in names:
            raise ExpressionError(output_in_words(OUTPUT))
        beyond = [name for name in names if re.fullmatch(r"p\d+", name) and name not in PARAMETERS]
        if beyond:
            raise ExpressionError(f"{beyond[0]} is no parameter: they are {PARAMETERS[0]} to {PARAMETERS[-1]}")
        for name, low, high in self.bounds:
            if name not in self.parameters:
                raise ExpressionError(f"bounds of {name}, which is no parameter in {self.expression!r}")
            if not low <= 0.0 <= high or low == high:
                raise ExpressionError(f"bounds of {name}: {low:g} to {high:g} must hold 0, which removes the term")

    def __str__(self) -> str:
        return f"custom({self.name}, {self.stage}, {self.expression})"

    @classmethod
    def written(cls, text: str) -> Self:
        """The term that custom(NAME, STAGE, EXPRESSION) writes out, its parameters 0. ExpressionError as the class."""
        parts = text.removeprefix("custom(").removesuffix(")").split(",", 2)
        if len(parts) < 3 or not (text.startswith("custom(") and text.endswith(")")):
            raise ExpressionError(f"{text!r}: write custom(NAME, STAGE, EXPRESSION), STAGE {', '.join(STAGES)}")
        name, stage, expression = (part.strip() for part in parts)
        return cls(name, stage_named(stage), expression)

    @cached_property
    def _read(self) -> Expression:
        return read(self.expression)

    @property
    def acts_as(self) -> Stage:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Its own stage."""
        return self.stage

    @cached_property
    def needs(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Every name that is neither a parameter, nor the current, nor the past speed."""
        return tuple(name for name in self._read.names if name not in (*PARAMETERS, CURRENT, SPEED))

    @cached_property
    def reads_speed(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the past speed is in it."""
        return SPEED in self._read.names

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Those of p1 to p9 that are in it."""
        bounds = {name: (low, high) for name, low, high in self.bounds}
        return {
            name: Parameter("-", *bounds.get(name, USUAL_BOUNDS), 0.0, f"{name} of {self.expression}")
            for name in PARAMETERS
            if name in self._read.names
        }

    @property
    def about(self) -> About:  # pyright: ignore[reportIncompatibleVariableOverride]
        """What can be said of any term: its physics is the user's."""
        moved = ", ".join(self.needs) or ("the current" if self.stage is Stage.COMMAND else "the speed")
        return About(
            physics=f"A term of the user's own at the stage {self.stage}. Its physics is what its author meant by it.",
            equation=self.expression,
            source="the model file",
            signature=f"the residual follows {moved} as the expression says",
            look_alikes=(),
            experiment=f"{moved} changed while nothing else changes, then the reverse",
        )

    def reshaped(self, **shape: float) -> Self:
        """The same term with other shape parameters."""
        return replace(self, **shape)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The expression's value for the present signals; times the gain so far for a gain."""
        result = self._at(value, past_speed, signals)
        return (value * result if self.stage is Stage.GAIN else result), state

    def _at(self, value: Value, past_speed: Value, signals: Signals) -> Value:
        known = {name: getattr(self, name) for name in self.parameters} | {name: signals[name] for name in self.needs}
        return self._read(known | {CURRENT: value, SPEED: past_speed})

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """All currents that give `value`, where the expression rises with the current; refused where it doesn't."""
        if self.stage is not Stage.COMMAND:
            return super().inverse(value, signals, state)
        if self.reads_speed:
            return _refused(f"{self.name} reads the speed: no current belongs to a drive signal alone")
        currents_ma = np.linspace(-GREATEST_MA, GREATEST_MA, GRID)
        drives_ma = np.broadcast_to(self._at(currents_ma, 0.0, signals), currents_ma.shape)
        if not np.all(np.diff(drives_ma) >= 0.0):  # NaN too
            return _refused(f"{self.name} does not rise with the current throughout: several currents may serve")
        if not drives_ma[0] <= value <= drives_ma[-1]:
            return _refused(f"{self.name}: no current up to {GREATEST_MA:.0f} mA gives {value:.0f} mA of drive")

        def edge_ma(below: Callable[[Value, float], Value]) -> float:
            """The current at which the drive stops being below the value; the last one where it never does."""
            inside_ma = currents_ma
            for _ in range(REFINEMENTS):
                count = int(np.count_nonzero(below(self._at(inside_ma, 0.0, signals), value)))
                if count in (0, len(inside_ma)):
                    return float(inside_ma[count and -1])
                inside_ma = np.linspace(inside_ma[count - 1], inside_ma[count], len(currents_ma))
            return float(inside_ma[0])

        return Inverse(edge_ma(operator.lt), edge_ma(operator.le))


def stage_named(word: str) -> Stage:
    """The stage that a word means; ExpressionError where a custom term can't act there."""
    if word not in list(STAGES):
        raise ExpressionError(f"stage {word}: a term of one's own acts as {', '.join(STAGES)}")
    return Stage(word)


def output_in_words(name: str) -> str:
    """Why a term can't read the output, by the name that it was given."""
    return f"{name} is what is predicted: write {SPEED}, the speed one sample ago"


def _refused(reason: str) -> Inverse:
    return Inverse(math.nan, math.nan, refused=reason)
