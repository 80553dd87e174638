"""Whether a learned model may drive: a stable drive, a gain that is positive in every gear, a delay within its own
taps, and enough margins of the loop that its law would close.

The margins are asked for twice: around the model itself, and, with less, around the models that may be right instead of
it, the one that drives and the factory's. A gain that was learned too small makes a law that is too strong: it shows
there. Each with both gains of the observer, the usual one and that for what lasts, which is the quicker one in a fast
gear: what lies between them has margins between theirs. Each at a small and at a great stroke of the pump, where the
drive yields by little and by much.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Annotated

import msgspec
import numpy as np

from cruise.control.controller import ControlSettings
from cruise.control.margins import Law, Margins
from cruise.effects.stroke import factor
from cruise.estimation.supervision import Finding
from cruise.model.model import Model, ModelState
from cruise.signals import Sample

GEARS = (1.0, 2.0, 3.0, 4.0)
STROKES_MPS = (0.3, 2.2)  # of the drive in second gear: creeping, and nearly all that there is
GAINS = (0.0, 1.0)  # of the observer: its usual one and that of a hill
Factor = Annotated[float, msgspec.Meta(ge=1.1, le=4)]
Degrees = Annotated[float, msgspec.Meta(ge=10, le=75)]


class ProofSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The least margins of a loop; 2 and 45 degrees are a textbook's, 1 and 0 are its end."""

    gain_margin: Factor = 1.8  # factor on the loop gain, where the model is right
    phase_margin_deg: Degrees = 40.0
    wrong_gain_margin: Factor = 1.3  # where another one is right instead
    wrong_phase_margin_deg: Degrees = 20.0


class Proof:
    """Asks one thing after the other of a model that is to drive with the law of `control`."""

    def __init__(self, control: ControlSettings, settings: ProofSettings) -> None:
        self.control, self.settings = control, settings

    def __call__(self, model: Model, others: Sequence[Model], before: ModelState, sample: Sample) -> Iterator[Finding]:
        """One finding after the other, at most some 2 ms each, until one speaks against the model."""
        for finding in self._findings(model, others, before, sample):
            yield finding
            if finding.against:
                return

    def _findings(self, model: Model, others: Sequence[Model], before: ModelState, sample: Sample) -> Iterator[Finding]:
        """Of the model alone, in every gear at the present signals, then for each pace of the gears and each gain."""
        poles = float(np.abs(model.poles).max(initial=0.0)) if np.isfinite(model.theta).all() else math.inf
        yield Finding("" if poles < 1.0 else "it is not stable", {"room_of_poles": 1.0 - poles})
        seen = [{**sample.signals, "gear": gear} for gear in GEARS]
        gears = [model.apply(before, sample.current_ma, signals) for signals in seen]
        gain = min(model.dc_gain_mps_per_ma * state.gain for state in gears)
        yield Finding("" if gain > 0.0 else "its steady gain is not positive", {"gain_mps_per_ma": gain})
        _, taps, *_ = model.split(model.theta)
        delay_s = model.period_s * (model.delay + float(np.arange(model.nb) @ taps) / sum(taps))
        within = model.delay <= round(delay_s / model.period_s, 6) <= model.delay + model.nb - 1
        yield Finding("" if within else "its delay is not within its taps", {"delay_s": delay_s})
        paces = {model.usual_pace(state, signals) for state, signals in zip(gears, seen, strict=True)}
        yieldings = {factor(model.stroke_share, speed_mps) for speed_mps in STROKES_MPS}
        for pace, hill, yielding in product(sorted(paces), GAINS, sorted(yieldings)):
            if hill and pace >= 1.0:  # both gains are one
                continue
            law = Law(model, self.control, pace, hill, yielding)
            yield self._judged(law.around(model), [law.around(other) for other in others])

    def _judged(self, own: Margins, others: Sequence[Margins]) -> Finding:
        settings = self.settings
        gain, phase_deg = (min(getattr(one, name) for one in others) for name in ("gain", "phase_deg"))
        figures = {
            "gain_margin": own.gain,
            "phase_margin_deg": own.phase_deg,
            "wrong_gain_margin": gain,
            "wrong_phase_margin_deg": phase_deg,
        }
        small = [name for name, value in figures.items() if not value >= getattr(settings, name)]
        return Finding("its margins are too small" if small else "", figures)
