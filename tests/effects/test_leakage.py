"""Leakage, by hand."""

import math

import numpy as np
import pytest

from cruise.effects.leakage import Leakage


def test_pressure_costs_speed_while_driving_and_gives_it_back_while_pushed():
    driven, pushed = (Leakage().step(0.0, 1.0, {"line_pressure_bar": bar}, math.nan, 0.2)[0] for bar in (250.0, -50.0))
    assert (driven, pushed) == (-2.5, 0.5)


@pytest.mark.parametrize(("exponent", "at_400"), [(0.5, 2.0), (1.0, 4.0), (1.5, 8.0)])
def test_orifices_leak_with_the_root_of_the_pressure_and_gaps_that_widen_with_more(exponent, at_400):
    effect = Leakage(exponent)
    for bar, most in ((100.0, 1.0), (400.0, at_400), (-400.0, -at_400)):
        phi, _ = effect.step(0.0, 1.0, {"line_pressure_bar": bar}, math.nan, 0.2)
        assert phi == pytest.approx(-most, rel=0.02)  # but for the rounding at no pressure
    slow, _ = effect.step(0.0, 1.0, {"line_pressure_bar": 1e-3}, math.nan, 0.2)
    assert abs(slow) < 1e-4


@pytest.mark.parametrize(
    ("share", "speed_mps", "factor"), [(0.0, 3.0, 1.0), (0.5, 3.0, 1.5), (1.0, -3.0, 2.0), (1.0, 0.75, 0.5)]
)
def test_a_pump_that_gives_up_stroke_loses_more_at_a_great_one(share, speed_mps, factor):
    effect, signals = Leakage(stroke_share=share), {"line_pressure_bar": 100.0, "ground_speed_mps": speed_mps}
    unknown, state = effect.step(0.0, 9.0, signals, effect.start(0.0), 0.2)
    assert unknown == -1.0  # no speed has been measured yet
    assert effect.step(0.0, 9.0, signals, state, 0.2)[0] == pytest.approx(-factor)


def test_a_hole_in_the_speed_keeps_the_last_one():
    speed_mps = np.array([3.0, math.nan, math.nan, 1.5])
    effect, signals = Leakage(stroke_share=1.0), {"line_pressure_bar": np.full(4, 100.0), "ground_speed_mps": speed_mps}
    np.testing.assert_allclose(effect.over(0.0, np.zeros(4), signals, 0.2)[0], [-1.0, -2.0, -2.0, -2.0])


def test_a_relief_valve_weeps_beyond_a_pressure_on_either_side():
    effect = Leakage(onset_bar=110.0)
    for bar, expected in ((100.0, 0.0), (210.0, -1.0), (-210.0, 1.0), (-50.0, 0.0)):
        assert effect.step(0.0, 1.0, {"line_pressure_bar": bar}, math.nan, 0.2)[0] == pytest.approx(expected)


def test_warm_oil_leaks_more_by_its_fluidity_and_oil_that_nobody_measured_leaves_it():
    effect, cold = Leakage(thinning=1.0), {"line_pressure_bar": 100.0}
    warm, unknown = cold | {"oil_temperature_c": 83.0}, cold | {"oil_temperature_c": math.nan}
    phi = [effect.step(0.0, 1.0, signals, math.nan, 0.2)[0] for signals in (cold, warm, unknown)]
    assert phi == pytest.approx([-1.0, -math.e, -1.0], rel=1e-3)
    assert Leakage().step(0.0, 1.0, warm, math.nan, 0.2)[0] == pytest.approx(-1.0, rel=1e-3)
