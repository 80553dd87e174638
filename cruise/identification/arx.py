"""ARX: the equation error, restarted from measured speeds at every sample.

    e_k = y_k - x_k . theta

x_k (n,) the model's regression of sample k, y ground speed in m/s, e equation error in m/s. Equation 3 of Coen et al.
2005; L. Ljung, System Identification, 2nd ed. 1999, section 4.2. This is the family that drives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from cruise.identification.families import Linear
from cruise.identification.least_squares import fit_and_solution
from cruise.identification.regressors import Smooth
from cruise.model.model import Model
from cruise.recording import Recording

ILL_CONDITIONED: Final = 1e4  # of scaled columns: noise of 1e-4 of a column then moves single parameters by their size


@dataclass(frozen=True)
class Arx(Linear):
    """A fitted ARX model."""


def fit_arx(model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None) -> Arx:
    """The ARX model of this structure that fits all recordings best. Raises FitError."""
    found, solution = fit_and_solution(model, recordings, smooth)
    return Arx(found, "least squares" + condition_in_words(solution.condition))


def condition_in_words(condition: float) -> str:
    """A warning where single parameters mean little; empty where they can be read."""
    if condition < ILL_CONDITIONED:
        return ""
    return f"; condition {condition:.1g}: judge the predictions, not single parameters"
