"""The equations of the effects, by hand."""

import math

import numpy as np
import pytest

from cruise.effects import EFFECTS
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import GREATEST_MA, Saturation


@pytest.mark.parametrize(("current_ma", "left_ma"), [(0, 0), (300, 0), (350, 0), (400, 50), (-400, -50), (-10, 0)])
def test_dead_zone(current_ma, left_ma):
    assert DeadZone(350.0).step(float(current_ma), 0.0, {}, math.nan, 0.2)[0] == pytest.approx(left_ma)


def test_an_edge_as_wide_as_the_zone_leaves_a_zone():
    wide, narrow = DeadZone(100.0, 140.0), DeadZone(100.0, 25.0)
    for current_ma in (20.0, 60.0, 100.0, 300.0):
        assert wide.step(current_ma, 0.0, {}, math.nan, 0.2) == narrow.step(current_ma, 0.0, {}, math.nan, 0.2)
    assert wide.step(50.0, 0.0, {}, math.nan, 0.2)[0] < 0.03 * 100.0
    assert wide.inverse(40.0, {}, None) == narrow.inverse(40.0, {}, None)
    assert DeadZone(1.0, 140.0).step(5.0, 0.0, {}, math.nan, 0.2)[0] == 4.0  # no room for an edge at all


def test_quadratic_gain():
    assert QuadraticGain(0.5).step(400.0, 0.0, {}, None, 0.2)[0] == pytest.approx(400 * (1 + 0.5 * 0.4))


@pytest.mark.parametrize("exponent", [0.5, 0.8, 1.0, 1.2])
def test_a_power_of_the_current_is_undone_by_its_inverse(exponent):
    effect = QuadraticGain(0.5, 0.3, exponent)
    bare = QuadraticGain(exponent=exponent)
    assert bare.step(500.0, 0.0, {}, None, 0.2)[0] == pytest.approx(1000.0 * 0.5**exponent, rel=0.01)
    for current_ma in (-1200.0, -300.0, -1.0, 0.0, 0.01, 20.0, 900.0):
        drive_ma, _ = effect.step(current_ma, 0.0, {}, None, 0.2)
        assert effect.inverse(drive_ma, {}, None).nearest(current_ma) == pytest.approx(current_ma, abs=1e-6)


@pytest.mark.parametrize(("curvature", "bend"), [(1.8, 0.6), (10.0, 1.0), (-0.2, 0.1), (0.0, 0.5)])
def test_a_flattened_curve_is_odd_and_undone_by_its_inverse(curvature, bend):
    effect = QuadraticGain(curvature, bend)
    current_ma = np.linspace(-1200.0, 1200.0, 49)
    drive_ma = effect.step(current_ma, 0.0, {}, None, 0.2)[0]
    assert (np.diff(drive_ma) > 0.0).all()
    np.testing.assert_allclose(drive_ma, -drive_ma[::-1])
    found = [effect.inverse(float(value), {}, None).low for value in drive_ma]
    np.testing.assert_allclose(found, current_ma, atol=1e-6)


def test_a_large_curvature_is_a_half_bridge():
    opening = np.linspace(0.05, 1.2, 24)  # of the variable orifice, over that of the fixed one; 1.5 at 1000 mA
    curve = QuadraticGain(1e6, 1.5**2).step(1000.0 / 1.5 * opening, 0.0, {}, None, 0.2)[0]
    bridge = opening**2 / (1.0 + opening**2)
    np.testing.assert_allclose(curve / curve[-1], bridge / bridge[-1], rtol=1e-4)


def test_beyond_the_vertex_of_a_falling_curve_there_is_no_current():
    inverse = QuadraticGain(-0.4).inverse(2000.0, {}, None)
    assert "vertex" in inverse.refused
    assert math.isnan(inverse.nearest(0.0))


@pytest.mark.parametrize(
    ("current_ma", "left_ma"),
    [(0, 0), (900, 900), (1100, 1100), (1101, 1100), (3000, 1100), (-500, -500), (-1200, -1100)],
)
def test_saturation(current_ma, left_ma):
    assert Saturation(1100.0).step(float(current_ma), 0.0, {}, None, 0.2)[0] == left_ma
    result, _ = Saturation(1100.0).step(np.array([float(current_ma)]), 0.0, {}, None, 0.2)
    np.testing.assert_array_equal(result, left_ma)


def test_at_the_stop_any_higher_current_serves_and_beyond_it_none():
    stop = Saturation(1100.0)
    below, up, down = (stop.inverse(value, {}, None) for value in (700.0, 1100.0, -1100.0))
    assert (below.low, below.high) == (700.0, 700.0)
    assert (up.low, up.high) == (1100.0, GREATEST_MA)
    assert (down.low, down.high) == (-GREATEST_MA, -1100.0)
    assert up.nearest(900.0) == 1100.0
    for value in (1100.1, -1100.1):
        refused = stop.inverse(value, {}, None)
        assert "beyond the stop at 1100 mA" in refused.refused
        assert math.isnan(refused.nearest(0.0))


def test_engine_speed_scales_with_flow():
    assert EngineSpeed(1.0).step(1.0, 0.0, {"engine_speed_rpm": 1050.0}, None, 0.2)[0] == pytest.approx(0.5)


@pytest.mark.parametrize("exponent", [0.0, 0.9, 1.0])
def test_a_reading_below_none_is_an_engine_that_stands(exponent):
    effect, below, none = EngineSpeed(exponent), {"engine_speed_rpm": -0.5}, {"engine_speed_rpm": 0.0}
    found, _ = effect.step(1.0, 0.0, below, None, 0.2)
    assert found == effect.step(1.0, 0.0, none, None, 0.2)[0] == (1.0 if exponent == 0.0 else 0.0)
    several, _ = effect.step(1.0, 0.0, {"engine_speed_rpm": np.array([-0.5, 0.0])}, None, 0.2)
    np.testing.assert_array_equal(several, found)


def test_an_engine_gives_no_more_beyond_the_speed_up_to_which_the_drive_follows_it():
    effect = EngineSpeed(1.0, full_rpm=1575.0)
    gains = [effect.step(1.0, 0.0, {"engine_speed_rpm": rpm}, None, 0.2)[0] for rpm in (1050.0, 1575.0, 2100.0)]
    assert gains == pytest.approx([0.5, 0.75, 0.75])


def test_gears_scale_gain_and_pace_as_in_equations_10_to_12():
    gears = GearRatio(1.4, 2.5, 4.4, 7.8)
    assert [gears.ratio(float(i)) for i in (1, 2, 3, 4)] == pytest.approx([1.4 / 2.5, 1, 4.4 / 2.5, 7.8 / 2.5])
    paces = [gears.pace({"gear": float(i)}, None) for i in (1, 2, 3, 4)]
    assert paces == pytest.approx([1, 1, (2.5 / 4.4) ** 2, (2.5 / 7.8) ** 2])
    np.testing.assert_allclose(gears.pace({"gear": np.array([1.0, 2, 3, 4])}, None), paces)
    as_quick = GearRatio(1.4, 2.5, 4.4, 7.8, pace_exponent=0.0)
    assert [as_quick.pace({"gear": float(i)}, None) for i in (1, 2, 3, 4)] == [1.0] * 4


def test_a_shift_interrupts_the_traction_and_the_next_ratio_comes_within_its_time():
    gears = GearRatio(1.0, 2.0, 4.0, 8.0, shift_s=0.5, shift_loss=0.4)
    state, gains = gears.start(0.0), []
    engaged = [2.0] * 3 + [math.nan] + [3.0] * 40 + [0.0] * 2 + [1.0] * 3 + [math.nan, 0.0, 4.0]
    for gear in engaged:
        found, state = gears.step(1.0, 0.0, {"gear": gear}, state, 0.2)
        gains.append(found)
    assert gains[:3] == [1.0, 1.0, 1.0]
    assert math.isnan(gains[3])
    rest = math.exp(-0.2 / 0.5)
    assert gains[4:7] == pytest.approx([2.0 - (2.0 - 0.6) * rest**k for k in (1, 2, 3)])
    assert gains[43:46] == pytest.approx([2.0, 0.0, 0.0])
    nothing = np.zeros(len(engaged))
    np.testing.assert_allclose(gears.over(nothing + 1.0, nothing, {"gear": np.array(engaged)}, 0.2)[0], gains)
    at_once = GearRatio(1.0, 2.0, 4.0, 8.0)
    assert at_once.step(1.0, 0.0, {"gear": 3.0}, (1.0, 1.0), 0.2)[0] == 2.0


@pytest.mark.parametrize("gear", [0.0, 5.0, -1.0])
def test_no_drive_in_neutral_or_in_a_gear_that_is_not_there(gear):
    assert GearRatio(1.4, 2.5, 4.4, 7.8).step(1.0, 0.0, {"gear": gear}, (1.0, 1.0), 0.2)[0] == 0.0


def test_the_table_is_named_as_its_entries():
    assert all(name == kind.name for name, kind in EFFECTS.items())
