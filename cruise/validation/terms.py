"""Terms of the user's own as candidates: what they can read, where they are a number, where a fit of them starts.

Nobody knows the units of their parameters, so that a fit starts from none, a little and a lot of the term, both ways.
"""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.effects import Custom, Stage
from cruise.effects.custom import PARAMETERS, SPEED
from cruise.identification.regressors import FitError
from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.candidates import with_effect
from cruise.validation.explanation import Explanation

STARTS: Final = (0.0, 0.005, -0.005, 0.2, -0.2)  # of the way from none to the bounds


@dataclass(frozen=True)
class TermCandidate:
    """A term of the user's own, fitted from where it is a number throughout."""

    term: Custom
    recordings: tuple[Recording, ...]
    name: str
    credit: float = 1.0

    def starts(self) -> list[Custom]:
        """The term with the parameters that a fit may start from."""
        found, shapes = [], self.term.parameters
        for share in STARTS if shapes else STARTS[:1]:
            shape = {name: abs(share) * (one.high if share > 0.0 else one.low) for name, one in shapes.items()}
            if defined(self.term.reshaped(**shape), self.recordings):
                found.append(self.term.reshaped(**shape))
        return found

    def grown(self, explanation: Explanation) -> Iterator[Explanation]:
        """The explanation with the term, once for every start."""
        for term in self.starts():
            yield with_effect(explanation, term)


def term_candidate(term: Custom, recordings: Sequence[Recording]) -> TermCandidate:
    """The term as a candidate. FitError where it can't be fitted to these recordings, with the reason."""
    check_term(term, recordings)
    found = TermCandidate(term, tuple(recordings), term.name)
    if not found.starts():
        raise FitError(f"{term.name} is not a number in every sample, whatever its parameters: {term.expression}")
    return found


def check_term(term: Custom, recordings: Sequence[Recording]) -> None:
    """FitError where the term can't be computed, or says nothing, on these recordings."""
    if term.stage is Stage.COMMAND and (term.needs or term.reads_speed):
        raise FitError(f"{term.name}: a command term can be fitted only where it reads nothing but the current, value")
    for need in term.needs:
        if any(need not in one.columns or not np.isfinite(one.columns[need]).any() for one in recordings):
            raise FitError(f"{term.name} can't be added: {need} is not recorded; {_known_names(need, recordings)}")
        values = np.concatenate([one.columns[need] for one in recordings])
        if np.ptp(values[np.isfinite(values)]) == 0.0:
            raise FitError(f"{term.name} can't be added: {need} never moves; record a drive in which it does")


def _known_names(unknown: str, recordings: Sequence[Recording]) -> str:
    """Which name was meant, or where none is near, which there are."""
    common = set.intersection(*(set(one.columns) for one in recordings)) - {OUTPUT}
    recorded = [name for name in recordings[0].columns if name in common]
    near = difflib.get_close_matches(unknown, [*recorded, SPEED], n=1)
    if near:
        return f"did you mean {near[0]}?"
    return f"a term can read {', '.join(recorded)} and {SPEED}; its parameters are {PARAMETERS[0]} to {PARAMETERS[-1]}"


def defined(term: Custom, recordings: Sequence[Recording]) -> bool:
    """Whether the term is a number wherever all that it reads is one: a fit takes what is none for no error."""
    for one in recordings:
        read = {name: one.columns[name] for name in term.needs}
        past = lagged(one.output, 1)
        known = np.isfinite(one.input) & np.isfinite(past)
        for column in read.values():
            known &= np.isfinite(column)
        with np.errstate(all="ignore"):
            value, _ = term.step(one.input if term.stage is Stage.COMMAND else 1.0, past, read, None, one.dt_s)
        if not np.isfinite(np.broadcast_to(value, len(one))[known]).all():
            return False
    return True
