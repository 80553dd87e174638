"""What stands in the error that a search leaves: a dead time that changes, much that is foretold, a swing, too much.

Each is asked only where those before it are silent. A dead time comes first: what it changes with foretells the error
as well, and the last two know nothing of what they are.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from cruise.effects import EFFECTS, Effect
from cruise.validation.candidates import MEDIATORS, UNNAMED
from cruise.validation.confidence import excess, untold
from cruise.validation.dead_time import DeadTime, dead_time
from cruise.validation.foretold import ANSWERS, MOVED, Foretold, foretold
from cruise.validation.selection import LEAST_DYNAMIC, LEAST_SHARE, Selected
from cruise.validation.slope import PITCH, SLOPE
from cruise.validation.study import Study
from cruise.validation.swing import Swing, swing

DELAY: Final = "transport_delay"
OF_ITS_OWN: Final = 0.9  # of what any signal tells of how the dead time changes, that an effect's own has to tell


@dataclass(frozen=True, eq=False)
class LeftOver:
    """What is left beside all that was found."""

    hidden: Foretold  # by the catch-all
    dead_time: DeadTime | None  # that changes, beside what was found
    swing: Swing  # at a pace of its own, where nothing was found
    foretold: float  # over what has to be foretold for something unlisted to be missing
    untold: float  # what nothing foretells, likewise

    @property
    def swing_s(self) -> float:
        """Period of what swings, or NaN."""
        return self.swing.period_s if self.swing.much > 1.0 else math.nan

    @property
    def silent(self) -> bool:
        """Whether no recorded signal shows what is missing."""
        return self.untold > self.foretold

    @property
    def missing(self) -> float:
        """Above 1 something is missing that no effect explains."""
        return max(self.foretold, self.untold)


def left_over(study: Study, found: Selected) -> LeftOver:
    """What the search leaves of the error."""
    hidden = _hidden(study, found)
    late = None if found.curved or found.unrecorded else _late(study, found)
    white_mps = 0.0 if found.chosen else study.white_mps  # what is left beside effects may be their form
    told = 0.0 if late is not None else excess(hidden, found.steps[0].before, found.final, white_mps)
    silent = not (found.curved or found.unrecorded or told > 1.0) and late is None
    error_mps, current_ma = found.final.fit.error_mps, study.search.scene.current_ma
    swings = swing(error_mps, current_ma, study.period_s) if silent and not found.chosen else Swing()
    alone = max(untold(found, hidden.drift, study.period_s), swings.much) if silent else 0.0
    return LeftOver(hidden, late, swings, told, alone)


def of_an_effect(late: DeadTime, chosen: Sequence[str]) -> bool:
    """Whether the dead time changes with a signal of what was found: that is the same cause, and has a name."""
    return late.signal in _read_by(chosen)


def _read_by(chosen: Sequence[str]) -> frozenset[str]:
    return frozenset(signal for name in chosen for signal in EFFECTS[name].needs)


def _late(study: Study, found: Selected) -> DeadTime | None:
    """How the dead time changes beside what was found, if it does and the model's own delay is a constant."""
    scene, error_mps = study.search.scene, found.final.fit.error_mps
    signals = {name: one for name, one in scene.signals.items() if name not in ANSWERS | MOVED | {PITCH, SLOPE}}
    blocks = study.search.blocks
    late = dead_time(error_mps, scene.speed_mps - error_mps, scene.parts, study.period_s, signals, blocks)
    if late.much <= 1.0 or DELAY in found.final.explanation.structural:
        return None
    if not found.chosen:
        return late
    own = {name: one for name, one in signals.items() if name in _read_by(found.chosen)}
    by_own = dead_time(error_mps, scene.speed_mps - error_mps, scene.parts, study.period_s, own, blocks)
    if by_own.signal and by_own.share >= OF_ITS_OWN * late.share:
        late = by_own
    paced = any(type(one).pace is not Effect.pace for one in found.final.explanation.effects)
    least = LEAST_DYNAMIC if paced else LEAST_SHARE  # as of any further effect: no form is exact
    before = found.steps[-2:][0].before  # without the effect that was found last
    return late if late.share * found.final.loss >= least * before.loss else None


def _hidden(study: Study, found: Selected) -> Foretold:
    """What the catch-all finds beside the final model; nothing where no step looked beside it."""
    last, final = found.steps[-1], found.final
    if last.before is not final:  # an unnamed curve, or as many effects as are looked for
        return Foretold(0.0, 0.0, ())
    known = [one for one in last.tried if not one.name.startswith(UNNAMED) and one.name not in MEDIATORS]
    return foretold(study.search.scene, final.fit, [one.judged.fit for one in known], study.search.blocks)
