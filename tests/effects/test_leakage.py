"""Leakage, by hand."""

from cruise.effects.leakage import Leakage


def test_pressure_costs_speed_while_driving_and_gives_it_back_while_pushed():
    driven, pushed = (Leakage().step(0.0, 1.0, {"line_pressure_bar": bar}, None, 0.2)[0] for bar in (250.0, -50.0))
    assert (driven, pushed) == (-2.5, 0.5)
