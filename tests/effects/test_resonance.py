"""Resonance: two more coefficients hold a pair of complex poles."""

import numpy as np
import pytest

from cruise.effects.resonance import Resonance
from cruise.model.model import Model


def test_the_order_grows_by_two():
    assert Resonance().restructured(1, 3, 2, 0.2) == (3, 3, 2)


def test_the_orders_that_it_gives_can_ring_where_those_without_it_cannot():
    period_s, hertz, damping = 0.05, 1.5, 0.1
    na, nb, delay = Resonance().restructured(1, 1, 0, period_s)
    pole = np.exp(2 * np.pi * hertz * period_s * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = -np.poly([0.9, pole, pole.conj()])[1:]
    model = Model(period_s, na, nb, delay, (Resonance(),), (*a, 1e-3, 0.0))
    run = np.array(model.predict(model.start(0.0, 0.0, {}), [500.0] * 400, [{}] * 400))
    swings = np.diff(np.sign(np.diff(run))) != 0
    assert np.count_nonzero(swings) > 6
    half_periods_s = period_s * np.diff(np.flatnonzero(swings)[:6])
    assert np.mean(half_periods_s) == pytest.approx(0.5 / hertz, rel=0.1)
