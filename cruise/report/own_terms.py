"""What an engineer may add where no effect of the table is missing: a term of the signal on which the error depends.

    gain: g = 1 + p1 z      load: phi = z or -z      z = (signal - centre) / half width of what was driven

It is a straight line of that signal, to begin with; what bends it is for the engineer's physics to say.
"""

import re
from typing import Final

import numpy as np

from cruise.effects.custom import CURRENT, PARAMETERS, SPEED, Custom
from cruise.effects.effect import Stage
from cruise.effects.expression import FUNCTIONS
from cruise.signals import INPUT, OUTPUT
from cruise.validation import unnamed
from cruise.validation.diagnose import Diagnosis, Verdict
from cruise.validation.unnamed import range_of

NAME: Final = re.compile(r"[A-Za-z_]\w*", re.ASCII)
TAKEN: Final = frozenset({*PARAMETERS, CURRENT, SPEED, *FUNCTIONS, INPUT, OUTPUT})


def own_terms(found: Diagnosis) -> tuple[Custom, ...]:
    """A gain and a load of the first signal that is named; none where it is the current, or no name in an expression.

    A dependence on the model's own speed is a gain alone: its load would be a part of the drive's own dynamics.
    """
    if found.verdict is not Verdict.UNLISTED or not found.signals:
        return ()
    signal, columns = found.signals[0], found.study.search.scene.signals
    if signal == unnamed.SPEED:
        centre, half_width = range_of(found.study.search.scene.speed_mps)
        return (_gain("of_the_speed", _scaled(SPEED, centre, half_width)),)
    if signal not in columns or signal in TAKEN or not NAME.fullmatch(signal):
        return ()
    scaled, name = _scaled(signal, *range_of(columns[signal])), f"of_{signal.lower()}"
    against = "-" if _falls(found.base.fit.error_mps, columns[signal]) else ""
    return _gain(name, scaled), Custom(name, Stage.LOAD, f"{against}{scaled}")


def _falls(error_mps: np.ndarray, values: np.ndarray) -> bool:
    """Whether the machine is the slower the more there is of the signal: a load has the sign of what it does."""
    known = np.isfinite(error_mps) & np.isfinite(values)
    return float(np.cov(error_mps[known], values[known])[0, 1]) < 0.0


def _gain(name: str, scaled: str) -> Custom:
    return Custom(name, Stage.GAIN, f"1 + p1 * {scaled}")


def _scaled(signal: str, centre: float, half_width: float) -> str:
    away = f" - {centre:.3g}" if centre > 0.0 else f" + {-centre:.3g}" if centre < 0.0 else ""
    return f"({signal}{away}) / {half_width or 1.0:.3g}"
