"""The model with as much of its hysteresis' width as is believed, and what a little more of it would change.

    w_h = h w,   df/dh = (f_(h + delta) - f_h) / delta,   h <- h + dh:   x <- x + (x_delta - x) dh / delta,
                                                                       f <- f + df/dh dh

w width of the band in mA that the model has, h share of it that is believed, f drive signal in mA, x where the play
operator stands and x_delta where that of a band wider by delta w does, on the same current. A band that is wider in the
model than in the machine makes every inverse jump too far; the observer learns h from what the turns of the current
leave (`observer.py`). Prediction and inverse have the same width: where it changes, what the model remembers moves
along, as if the width had always been that one.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from cruise.effects.hysteresis import Hysteresis
from cruise.model.model import Model, ModelState
from cruise.signals import Signals

GRAIN: Final = 0.005  # of h, below 1 mm/s: a model is made anew for more only
WIDER: Final = 0.05  # delta: less than any width is known to, more than rounding


class BelievedWidth:
    """`share`, `wider_ma`, x_delta, and `drives_ma` (depth,), df/dh, newest first, are its state beside two models.

    `model` has the believed width.
    """

    def __init__(self, model: Model) -> None:
        self.share, self.wider_ma, self.drives_ma = 1.0, math.nan, np.zeros(1)
        self.adopt(model)

    def restart(self) -> None:
        """Nothing of the path of the current is known; the share stays."""
        self.wider_ma, self.drives_ma = math.nan, np.zeros_like(self.drives_ma)

    def adopt(self, model: Model) -> None:
        """Other parameters of the same structure from now on."""
        places = (i for i, effect in enumerate(model.effects) if isinstance(effect, Hysteresis))
        self.given, self.place = model, next(places, None)
        depth = max(model.delay + model.nb, 1)
        self.drives_ma = np.pad(self.drives_ma, (0, depth), mode="edge")[:depth]
        self._believe(self.share)

    def step(self, before: ModelState, after: ModelState, current_ma: float, signals: Signals) -> None:
        """One frame on, from and to these states of `model`."""
        if self.place is None:
            return
        memory, drive_ma = before.effects, current_ma
        if not math.isnan(self.wider_ma):
            memory = (*memory[: self.place], self.wider_ma, *memory[self.place + 1 :])
        for i, effect in self._wider.command_effects:
            drive_ma, state = effect.step(drive_ma, before.speeds[0], signals, memory[i], self.given.period_s)
            if i == self.place:
                self.wider_ma = state
        self.drives_ma[1:] = self.drives_ma[:-1]
        self.drives_ma[0] = (drive_ma - after.drives[0]) / WIDER

    def believe(self, share: float, state: ModelState) -> ModelState:
        """Another share from now on; the state that `model` would have if it had always been this one."""
        if self.place is None or abs(share - self.share) < GRAIN:
            return state
        more = share - self.share
        memory, stands_ma = list(state.effects), state.effects[self.place]
        memory[self.place] += more * (self.wider_ma - stands_ma) / WIDER
        self.wider_ma += memory[self.place] - stands_ma
        drives = tuple(drive + more * slope for drive, slope in zip(state.drives, self.drives_ma.tolist(), strict=True))
        self._believe(share)
        return state._replace(drives=drives, effects=tuple(memory))

    def _believe(self, share: float) -> None:
        self.share, self.model = share, self._with(share)
        self._wider = self._with(share + WIDER)

    def _with(self, share: float) -> Model:
        if self.place is None:
            return self.given
        effects, effect = list(self.given.effects), self.given.effects[self.place]
        assert isinstance(effect, Hysteresis)
        effects[self.place] = replace(effect, width_ma=share * effect.width_ma)
        return replace(self.given, effects=tuple(effects))
