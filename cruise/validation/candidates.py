"""The effects that could be missing: what each needs, and whether the recording says anything about it.

An effect whose signal is not recorded can't be blamed; one whose signal hardly moves is not excited, not absent.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from cruise.effects import EFFECTS, Effect, Stage
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.validation.beginnings import BEGIN, SHARES, Shapes, Starts, walked
from cruise.validation.complete import why_left_out
from cruise.validation.explanation import CORE, Explanation
from cruise.validation.slope import PITCH, SLOPE, pitch_share, slope_deg
from cruise.validation.told import told_shapes
from cruise.validation.unnamed import (
    POWERS,
    PUSHES,
    SPEED,
    RestCurrent,
    UnnamedCurve,
    UnnamedDirection,
    UnnamedGain,
    UnnamedLoad,
    UnnamedPush,
    knots_of,
    range_of,
)

HELD: Final = 0.7  # share of the current that a hysteresis holds back where fits start: it is wide or it is whole
CHAIN: Final = tuple(EFFECTS)  # order in which the current meets the effects: that of the table
SAME: Final = 0.02  # relative spread of a signal below which it never moves; hardly, where 98 % of its values have less
CONSEQUENCES: Final[Mapping[str, float]] = {"engine_load_pct": 0.85}
"""Share of its evidence that an effect may keep whose signal answers to the drive itself: given it, anything looks
explained."""
MEDIATORS: Final = ("leakage",)
"""Effects through whose signal every force acts, so that it holds what all the others do."""
BLIND: Final[Mapping[str, float]] = {"engine_load_pct": 0.6, "line_pressure_bar": 0.35}
"""The same for a dependence without physics on what the drive itself moves: it would read the answer off it."""


UNNAMED: Final = "unnamed:"
"""Before the signal of a dependence without physics, in the names of candidates."""


class Candidate(Protocol):
    """Something that could be missing."""

    @property
    def name(self) -> str:
        """Of the effect, or of the unnamed dependence."""
        ...

    @property
    def credit(self) -> float:
        """Share of its gain that counts against others."""
        ...

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """The explanation with the candidate, once for every place where a fit may start."""
        ...


@dataclass(frozen=True, slots=True)
class Refused:
    """An effect that these recordings can't speak of, and why."""

    effect: str
    reason: str
    still: bool = False  # its signal is recorded, and hardly moves: it was not excited


@dataclass(frozen=True)
class EffectCandidate:
    """An effect of the table."""

    name: str
    credit: float = 1.0
    given: Effect | None = None  # where a fit of it has been before
    told: tuple[Shapes, ...] = ((),)  # by the signals themselves, in one way or another: whichever errs less
    begin: tuple[Starts, ...] = ()  # where fits start in each way, if recordings say where the effect would act at all

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """One start for each of a few strengths and every way in which shapes are told, or where it has been before."""
        if self.given is not None:
            yield with_effect(explanation, self.given)
            return
        kind = EFFECTS[self.name]
        shapes = kind.parameters
        core = explanation.core
        if self.name == "rate_limit":  # the servo's lag moves into the limit, or there would be one lag more
            known = {"lag_s": core.lag_s, "return_share": 1.0}
            explanation = replace(explanation, core=replace(core, lag_s=CORE["lag_s"].low))
        elif self.name == "hysteresis":
            known = {"share": HELD}
        elif self.name == "quadratic_gain":  # a parabola at first
            known = {"bend": 0.0}
        else:
            known = {}
        assumed = {}
        if self.name == "power_limit":  # the speed follows what is taken back as it follows the current
            assumed = {"follow_s": min(core.behind_s, shapes["follow_s"].high)}
        shares = SHARES if shapes and self.name != "gear_ratio" else SHARES[:1]
        ordinary = tuple(walked(self.name, share) for share in shares)
        alike = set()
        for told in self.told:
            for begun in (one for way in self.begin or (ordinary,) for one in way):
                shape = assumed | dict(begun) | known | dict(told)
                effect = kind() if self.name == "gear_ratio" else kind(**shape)
                acting = tuple(getattr(effect, one) for one in shapes if one not in effect.idle)
                if acting not in alike:  # what is told may not matter in every way
                    alike.add(acting)
                    yield with_effect(explanation, effect)


def ways_of(candidate: Candidate) -> tuple[Candidate, ...]:
    """The ways in which it may act, each with its own starts: what promises most to first order may be of the wrong."""
    if isinstance(candidate, EffectCandidate) and len(candidate.begin) > 1:
        return tuple(replace(candidate, begin=(way,)) for way in candidate.begin)
    return (candidate,)


@dataclass(frozen=True)
class DelayCandidate:
    """More dead time than the model's structure can represent."""

    name: str = "transport_delay"
    credit: float = 1.0

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """From the delay as it is, and from half a second more."""
        structural = explanation.structural | {self.name}
        for extra_s in (0.0, 0.5):
            delay_s = min(explanation.core.delay_s + extra_s, CORE["delay_s"].high)
            yield replace(explanation, core=replace(explanation.core, delay_s=delay_s), structural=structural)


@dataclass(frozen=True)
class ResonanceCandidate:
    """A pair of complex poles between actuator and vehicle."""

    name: str = "resonance"
    credit: float = 1.0

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """From four frequencies, in the drive train and beside it, weak: what is too strong is led away from it."""
        structural = explanation.structural | {self.name}
        for share in (0.1, -0.3):
            for frequency_hz in (0.4, 0.7, 1.2, 1.9):
                core = replace(explanation.core, resonance_share=share, resonance_hz=frequency_hz, damping=0.15)
                yield replace(explanation, core=core, structural=structural)


@dataclass(frozen=True)
class UnnamedCandidate:
    """A smooth dependence on a signal that no effect describes."""

    signal: str
    centre: float
    half_width: float
    credit: float = 1.0
    knots: tuple[float, ...] = ()  # of the current alone, in mA

    @property
    def name(self) -> str:
        return _unnamed(self.signal)

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """One start: no dependence."""
        if self.signal == INPUT:
            yield with_effect(with_effect(explanation, UnnamedCurve(self.knots)), UnnamedDirection())
            return
        gain = UnnamedGain(self.signal, self.centre, self.half_width)
        grown = with_effect(explanation, gain)
        for power in POWERS:
            grown = with_effect(grown, UnnamedLoad(self.signal, self.centre, self.half_width, power))
        for power in PUSHES if self.signal != SPEED else ():
            grown = with_effect(grown, UnnamedPush(self.signal, self.centre, self.half_width, power))
        yield grown


def candidates(recordings: Sequence[Recording], explanation: Explanation) -> tuple[list[Candidate], list[Refused]]:
    """What could be missing beside `explanation`, and what these recordings can't speak of."""
    found: list[Candidate] = []
    refused = []
    for name, kind in EFFECTS.items():
        if name in explanation.names:
            continue
        lacks = absent(kind, recordings)
        stays = "" if lacks else still(kind, recordings)
        reason = lacks or stays or _shown_by_its_cause(kind, recordings, explanation)
        if reason:
            refused.append(Refused(name, reason, bool(stays)))
        else:
            found.append(candidate_of(name, recordings))
    return found, refused


def candidate_of(name: str, recordings: Sequence[Recording]) -> Candidate:
    """The candidate of an effect of the table of which these recordings speak."""
    if name == "transport_delay":
        return DelayCandidate()
    if name == "resonance":
        return ResonanceCandidate()
    credit = min((CONSEQUENCES.get(need, 1.0) for need in EFFECTS[name].needs if need != OUTPUT), default=1.0)
    begin = BEGIN[name](recordings) if name in BEGIN else ()
    return EffectCandidate(name, credit, told=told_shapes(name, recordings), begin=begin)


def unnamed(recordings: Sequence[Recording], explanation: Explanation) -> list[UnnamedCandidate]:
    """Every recorded signal as something on which the speed could depend in a way that is not in the table."""
    found = []
    for signal in (*recordings[0].columns, SPEED):
        if signal in (OUTPUT, "wheel_speed_mps") or not all(
            signal == SPEED or signal in one.columns for one in recordings
        ):
            continue
        if signal == PITCH:
            share = pitch_share(recordings)
            values = [slope_deg(one, share) for one in recordings]
        else:
            values = [one.columns[OUTPUT if signal == SPEED else signal] for one in recordings]
        centre, half_width = range_of(np.concatenate(values))
        if half_width > 0.0:
            read = SLOPE if signal == PITCH else signal
            knots = knots_of(np.concatenate(values)) if signal == INPUT else ()
            found.append(UnnamedCandidate(read, centre, half_width, BLIND.get(signal, 1.0), knots=knots))
    return found


def why_not(kind: type[Effect], recordings: Sequence[Recording]) -> str:
    """Why these recordings can't speak of an effect; empty where they can."""
    return absent(kind, recordings) or still(kind, recordings)


def absent(kind: type[Effect], recordings: Sequence[Recording]) -> str:
    """Which signal an effect lacks, so that it can't be computed; empty where none."""
    for need in _read(kind):
        if any(need not in one.columns or not np.isfinite(one.columns[need]).any() for one in recordings):
            partly = why_left_out(need, recordings)
            return f"{need} is not recorded throughout: {partly}" if partly else f"{need} is not recorded"
    return ""


def still(kind: type[Effect], recordings: Sequence[Recording]) -> str:
    """Which signal of an effect hardly moves, of those that are recorded; empty where none."""
    for need in _read(kind):
        values = np.concatenate([one.columns[need] for one in recordings])
        values = values[np.isfinite(values)]
        size = max(abs(float(np.median(values))), 1e-3 * (SIGNALS[need].high - SIGNALS[need].low))
        if np.ptp(np.percentile(values, [1, 99])) < SAME * size:
            ever = "never" if np.ptp(values) < SAME * size else "hardly"
            unit = SIGNALS[need].unit.removeprefix("-")
            return f"{need} {ever} moves: it stays at {np.median(values):g} {unit}".rstrip()
    return ""


def _read(kind: type[Effect]) -> list[str]:
    """The signals that an effect reads beside the speed."""
    return [need for need in kind.needs if need != OUTPUT]


def _shown_by_its_cause(kind: type[Effect], recordings: Sequence[Recording], explanation: Explanation) -> str:
    """Why an effect can't be what is missing where its cause is recorded, which another effect reads; or empty.

    Beside that other effect it may: what it takes then the cause does not show, as a belt that slips.
    """
    read = {need for effect in explanation.effects for need in effect.needs}
    for cause in kind.stands_for:
        if cause in read:
            continue
        if all(cause in one.columns and np.isfinite(one.columns[cause]).any() for one in recordings):
            return f"{cause} is recorded, and shows all that it does"
    return ""


def with_effect(explanation: Explanation, effect: Effect) -> Explanation:
    """The explanation with one effect more, at its place in the chain, its load at zero."""
    return _with_effects(explanation, (*explanation.effects, effect))


def without(explanation: Explanation, name: str) -> Explanation:
    """The explanation without one effect, or without all the parts of an unnamed dependence.

    No current at rest stays without a gain that turns the drive about it: it would be an offset of the speed.
    """
    core = replace(explanation.core, resonance_share=0.0) if name == "resonance" else explanation.core
    kept = [effect for effect in explanation.effects if name not in (effect.name, owner(effect))]
    if not any(effect.stage is Stage.GAIN for effect in kept):
        kept = [effect for effect in kept if effect.name != RestCurrent.name]
    return replace(_with_effects(explanation, kept), core=core, structural=explanation.structural - {name})


def owner(effect: Effect) -> str:
    """The candidate to which an effect belongs."""
    if isinstance(effect, UnnamedCurve | UnnamedDirection):
        return _unnamed(INPUT)
    return _unnamed(effect.signal) if isinstance(effect, UnnamedGain | UnnamedLoad | UnnamedPush) else effect.name


def _unnamed(signal: str) -> str:
    return f"{UNNAMED}{PITCH if signal == SLOPE else signal}"


def _with_effects(explanation: Explanation, effects: Sequence[Effect]) -> Explanation:
    loads = dict(zip((explanation.effects[i].name for i in explanation.at(Stage.LOAD)), explanation.loads, strict=True))
    new = replace(explanation, effects=tuple(sorted(effects, key=lambda one: _place(one.name))), loads=())
    return replace(new, loads=tuple(loads.get(new.effects[i].name, 0.0) for i in new.at(Stage.LOAD)))


def _place(name: str) -> int:
    return CHAIN.index(name) if name in CHAIN else len(CHAIN)
