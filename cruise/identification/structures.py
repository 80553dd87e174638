"""What is to be identified: the models of the paper by name, or a structure written out.

    arx:na=1,nb=3,delay_s=0.5+dead_zone+quadratic_gain

Before the colon stands the family, then its orders, then the effects in the order in which the current meets them; a
term of the user's own as custom(header, gain, 1 + p1*(header_height_mm - 300)).
Families: arx, armax (nc), oe (nf in place of na), narx (degree). Source: Tables I to IV of Coen et al. 2005.
"""

import difflib
import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from cruise.effects import EFFECTS, Custom, Effect
from cruise.effects.expression import ExpressionError
from cruise.identification.regressors import FitError
from cruise.model.model import Model

LONGEST_DELAY_S: Final = 60.0  # s, as in model files: beyond it a typing error is likelier
HIGHEST_ORDER: Final = 100
HIGHEST_DEGREE: Final = 6  # of Hermite polynomials: beyond it nothing but noise is fitted


class Family(StrEnum):
    """Which error a model minimises, and how it predicts."""

    ARX = "arx"  # A y = B u + e
    ARMAX = "armax"  # A y = B u + C e
    OUTPUT_ERROR = "oe"  # y = B / F u + e
    NARX = "narx"  # A y = sum_n B_n H_n(u) + e


@dataclass(frozen=True, slots=True)
class Structure:
    """The structure of a model without its parameters; `na` is the order of F for an output error model."""

    family: Family
    na: int
    nb: int
    delay_s: float
    nc: int = 0
    degree: int = 0
    effects: tuple[str, ...] = ()
    name: str = ""
    custom: tuple[Custom, ...] = ()  # what those of `effects` are that don't stand in EFFECTS

    def __str__(self) -> str:
        orders = {"nf" if self.family is Family.OUTPUT_ERROR else "na": self.na, "nb": self.nb}
        if self.family is Family.ARMAX:
            orders["nc"] = self.nc
        if self.family is Family.NARX:
            orders["degree"] = self.degree
        listed = ",".join(f"{key}={value}" for key, value in orders.items())
        own = {term.name: str(term) for term in self.custom}
        effects = (own.get(name, name) for name in self.effects)
        return "+".join((f"{self.family}:{listed},delay_s={self.delay_s:g}", *effects))

    def delay(self, period_s: float) -> int:
        """The delay in whole samples, half of one down: 0.5 s is 2 samples of 5 Hz (Table I, arx8)."""
        return math.ceil(self.delay_s / period_s - 0.5 - 1e-9)

    def model(self, period_s: float) -> Model:
        """The core with neutral effects and all parameters zero. FitError where one of them is the core's own."""
        for name, instead in OF_THE_CORE.items():
            if name in self.effects:
                raise FitError(f"{name} is no term of this model but its structure: {instead}, and leave {name} out")
        own = {term.name: term for term in self.custom}
        kinds = (own[name] if name in own else EFFECTS[name]() for name in self.effects)
        effects: tuple[Effect, ...] = tuple(
            kind.reshaped(**{key: bound.neutral for key, bound in kind.parameters.items()}) for kind in kinds
        )
        loads = sum(effect.acts_as == "load" for effect in effects)
        theta = (0.0,) * (self.na + self.nb + loads + 1)
        return Model(period_s, self.na, self.nb, self.delay(period_s), effects, theta)


OF_THE_CORE: Final = {
    "transport_delay": "give a longer delay_s, or more nb",
    "resonance": "give two more na",
}  # effects that a search of what is missing fits in the core itself
_PREPROCESSED: Final = ("saturation", "dead_zone", "quadratic_gain")  # section IV.C: what the ramp of Fig. 4 shows


def _presets() -> dict[str, Structure]:
    arx = {
        "arx1": (10, 10, 0.0),
        "arx2": (0, 10, 0.0),
        "arx3": (10, 0, 0.0),
        "arx4": (0, 10, 0.5),
        "arx5": (0, 5, 0.5),
        "arx6": (0, 4, 0.5),
        "arx7": (0, 3, 0.5),
        "arx8": (0, 2, 0.5),
        "arx9": (0, 3, 0.0),
        "arx10": (1, 3, 0.5),
    }
    oe = {  # nf, nb
        "oe1": (5, 5, 0.0),
        "oe2": (5, 1, 0.0),
        "oe3": (0, 5, 0.0),
        "oe4": (0, 5, 0.5),
        "oe5": (0, 4, 0.5),
        "oe6": (0, 3, 0.5),
        "oe7": (0, 2, 0.5),
        "oe8": (0, 3, 0.0),
    }
    return {
        **{name: Structure(Family.ARX, *orders, name=name) for name, orders in arx.items()},
        "arx7B": Structure(Family.ARX, 0, 3, 0.5, effects=_PREPROCESSED, name="arx7B"),
        "arx10B": Structure(Family.ARX, 1, 3, 0.5, effects=_PREPROCESSED, name="arx10B"),
        **{name: Structure(Family.OUTPUT_ERROR, *orders, name=name) for name, orders in oe.items()},
        "armax": Structure(Family.ARMAX, 0, 3, 0.5, nc=1, name="armax"),
        "narx1": Structure(Family.NARX, 2, 3, 0.0, degree=2, name="narx1"),
        "narx2": Structure(Family.NARX, 2, 3, 0.0, degree=3, name="narx2"),
    }


PRESETS: Final = _presets()
"""The models of Tables I to IV by the paper's names."""


def parse(text: str) -> Structure:
    """The structure that `text` names or writes out. Raises FitError with what is wrong and what is known."""
    if text in PRESETS:
        return PRESETS[text]
    core, *effects = _summands(text.strip())
    family, colon, listed = core.partition(":")
    if not colon and family in PRESETS:  # a preset with further effects: arx10B+grade
        preset = PRESETS[family]
        return _with_effects(text, preset, (*preset.effects, *effects))
    if family not in list(Family):
        other_case = [name for name in PRESETS if name.lower() == family.lower()]
        near = other_case or difflib.get_close_matches(family, [*PRESETS, *Family], n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise FitError(
            f"model {text!r}: no such name; {hint}known: {', '.join(PRESETS)}, a model file, or a structure such as "
            "arx:na=1,nb=3,delay_s=0.5+dead_zone"
        )
    numbers = _numbers(text, Family(family), listed)
    structure = Structure(Family(family), **numbers)
    return _with_effects(text, structure, tuple(effects))


def _summands(text: str) -> list[str]:
    """`text` split at every + that stands outside parentheses."""
    summands, depth = [""], 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if character == "+" and not depth:
            summands.append("")
        else:
            summands[-1] += character
    return summands


def _numbers(text: str, family: Family, listed: str) -> dict:
    order = {"nf": "na"} if family is Family.OUTPUT_ERROR else {"na": "na"}
    fields = {**order, "nb": "nb", "delay_s": "delay_s"}
    fields |= {"nc": "nc"} if family is Family.ARMAX else {}
    fields |= {"degree": "degree"} if family is Family.NARX else {}
    highest = {"delay_s": LONGEST_DELAY_S, "degree": HIGHEST_DEGREE}
    numbers: dict[str, float | int] = {}
    for item in filter(None, listed.split(",")):
        key, equals, written = (part.strip() for part in item.partition("="))
        if not equals or key not in fields:
            raise FitError(f"model {text!r}: {item!r} is no order of {family}; it takes {', '.join(fields)}")
        try:
            value = float(written) if key == "delay_s" else int(written)
        except ValueError:
            raise FitError(
                f"model {text!r}: {key}={written} is no {'time in s' if key == 'delay_s' else 'whole number'}"
            ) from None
        if fields[key] in numbers:
            raise FitError(f"model {text!r}: {key} is there twice")
        if not 0 <= value <= highest.get(key, HIGHEST_ORDER):
            raise FitError(f"model {text!r}: {key}={written} is outside 0 to {highest.get(key, HIGHEST_ORDER):g}")
        numbers[fields[key]] = value
    missing = [key for key, field in fields.items() if field not in numbers]
    if missing:
        raise FitError(f"model {text!r}: {', '.join(missing)} missing; {family} takes {', '.join(fields)}")
    if not numbers["na"] + numbers["nb"]:
        raise FitError(f"model {text!r}: a model without any order predicts nothing; give nb=1 at least")
    return numbers


def _with_effects(text: str, structure: Structure, written: tuple[str, ...]) -> Structure:
    try:
        custom = tuple(Custom.written(effect) for effect in written if effect.startswith("custom"))
    except ExpressionError as error:
        raise FitError(f"model {text!r}: {error}") from error
    own = iter(term.name for term in custom)
    effects = tuple(next(own) if effect.startswith("custom") else effect for effect in written)
    known = {*EFFECTS, *(term.name for term in custom)}
    for name in effects:
        if name not in known:
            near = difflib.get_close_matches(name, EFFECTS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(EFFECTS)}, custom(...)"
            raise FitError(f"model {text!r}: no effect {name!r}; {hint}")
    taken = [term.name for term in custom if term.name in EFFECTS]
    if taken:
        raise FitError(f"model {text!r}: {taken[0]} is an effect already; give the custom term another name")
    if len(set(effects)) < len(effects):
        raise FitError(f"model {text!r}: every effect can be there once")
    name = structure.name if effects == structure.effects else ""
    return replace(structure, effects=effects, name=name, custom=custom)
