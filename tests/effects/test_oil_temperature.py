"""Leakage grows as the oil thins, by the exponential that stands for Walther's line."""

import math

import numpy as np
import pytest

from cruise.effects.fluidity import THINNING_K
from cruise.effects.oil_temperature import OilTemperature


def gain(loss_share, temperature_c):
    return OilTemperature(loss_share).step(1.0, 0.0, {"oil_temperature_c": temperature_c}, None, 0.2)[0]


def viscosity_mm2ps(temperature_c: float) -> float:
    """Walther (ASTM D341) through ISO VG 46 of viscosity index 100: 46 and 6.8 mm2/s at 40 and 100 degC."""
    lines = [(math.log10(t + 273.15), math.log10(math.log10(nu + 0.7))) for t, nu in ((40.0, 46.0), (100.0, 6.8))]
    (x_1, y_1), (x_2, y_2) = lines
    y = y_1 + (y_2 - y_1) / (x_2 - x_1) * (math.log10(temperature_c + 273.15) - x_1)
    return 10.0 ** (10.0**y) - 0.7


def test_the_exponential_is_the_line_of_walther_where_machines_work():
    for temperature_c in range(40, 96, 5):
        thinner = viscosity_mm2ps(50.0) / viscosity_mm2ps(temperature_c)
        assert math.exp((temperature_c - 50.0) / THINNING_K) == pytest.approx(thinner, rel=0.15)
    assert math.log(viscosity_mm2ps(40.0) / viscosity_mm2ps(105.0)) / 65.0 == pytest.approx(1.0 / THINNING_K, rel=0.03)


def test_a_share_of_a_twentieth_loses_as_much_again_for_each_doubling_of_the_leakage():
    doubling_k = THINNING_K * math.log(2.0)
    got = gain(0.05, np.array([50.0 - doubling_k, 50.0, 50.0 + doubling_k, 50.0 + 2.0 * doubling_k]))
    np.testing.assert_allclose(got, [1.025, 1.0, 0.95, 0.85])


def test_no_more_than_all_of_the_flow_leaks():
    assert gain(0.4, 150.0) == 0.0


def test_cold_oil_is_slow_and_hot_oil_no_more_than_twice_as_quick():
    temperature_c = np.array([50.0 - THINNING_K, 50.0, 50.0 + 0.5 * THINNING_K, 150.0])
    pace = OilTemperature(pace_exponent=1.0).pace({"oil_temperature_c": temperature_c}, None)
    np.testing.assert_allclose(pace, [math.exp(-1.0), 1.0, math.exp(0.5), 2.0])
    assert OilTemperature(0.1).pace({"oil_temperature_c": 10.0}, None) == 1.0


def test_no_fit_looks_for_a_pace_that_does_not_change_or_a_drag_that_is_none():
    assert OilTemperature(0.1).idle == {"pace_exponent", "drag_share", "warm_c"}
    assert OilTemperature(0.0, 0.3).idle == {"drag_share", "warm_c"}
    assert OilTemperature(0.0, 0.3, 0.1).idle == {"warm_c"}
    assert not OilTemperature(0.0, 0.3, 0.1, 45.0).idle
    assert OilTemperature(0.1, warm_c=45.0).idle == {"pace_exponent", "drag_share", "warm_c"}


def test_what_is_felt_in_cold_oil_alone_is_gone_once_the_oil_is_warm():
    effect = OilTemperature(drag_share=0.08, warm_c=40.0)
    gains = [
        effect.step(1.0, 0.0, {"oil_temperature_c": oil_c}, None, 0.2)[0] for oil_c in (40.0 - THINNING_K, 40, 55, 90)
    ]
    thick = math.exp((50.0 - 40.0) / THINNING_K)
    assert gains[1:] == pytest.approx([1.0 - 0.08 * (thick - 1.0)] * 3)
    assert gains[0] == pytest.approx(1.0 - 0.08 * (math.e * thick - 1.0))
    columns = {"oil_temperature_c": np.array([40.0 - THINNING_K, 40.0, 55.0, 90.0])}
    np.testing.assert_allclose(effect.step(1.0, np.zeros(4), columns, None, 0.2)[0], gains)


def test_the_drag_of_thick_oil_takes_speed_as_the_viscosity_and_none_beyond_it_at_50_degrees():
    effect = OilTemperature(drag_share=0.08)
    gains = [
        effect.step(1.0, 0.0, {"oil_temperature_c": 50.0 - warmer_k}, None, 0.2)[0] for warmer_k in (0.0, THINNING_K)
    ]
    assert gains == pytest.approx([1.0, 1.0 - 0.08 * (math.e - 1.0)])
    assert effect.step(1.0, 0.0, {"oil_temperature_c": -40.0}, None, 0.2)[0] >= 0.0
