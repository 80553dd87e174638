"""Leakage, by hand."""

import math

import numpy as np
import pytest

from cruise.effects.leakage import Leakage


def test_pressure_costs_speed_while_driving_and_gives_it_back_while_pushed():
    driven, pushed = (Leakage().step(0.0, 1.0, {"line_pressure_bar": bar}, math.nan, 0.2)[0] for bar in (250.0, -50.0))
    assert (driven, pushed) == (-2.5, 0.5)


@pytest.mark.parametrize(
    ("share", "speed_mps", "factor"), [(0.0, 3.0, 1.0), (0.5, 3.0, 1.5), (1.0, -3.0, 2.0), (1.0, 0.75, 0.5)]
)
def test_a_pump_that_gives_up_stroke_loses_more_at_a_great_one(share, speed_mps, factor):
    effect, signals = Leakage(share), {"line_pressure_bar": 100.0, "ground_speed_mps": speed_mps}
    unknown, state = effect.step(0.0, 9.0, signals, effect.start(0.0), 0.2)
    assert unknown == -1.0  # no speed has been measured yet
    assert effect.step(0.0, 9.0, signals, state, 0.2)[0] == pytest.approx(-factor)


def test_a_hole_in_the_speed_keeps_the_last_one():
    speed_mps = np.array([3.0, math.nan, math.nan, 1.5])
    effect, signals = Leakage(1.0), {"line_pressure_bar": np.full(4, 100.0), "ground_speed_mps": speed_mps}
    np.testing.assert_allclose(effect.over(0.0, np.zeros(4), signals, 0.2)[0], [-1.0, -2.0, -2.0, -2.0])
