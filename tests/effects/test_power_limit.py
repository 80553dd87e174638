"""The limit acts where mass, slope and speed ask for more than it, and nowhere else."""

import math

import numpy as np
import pytest

from cruise.effects.power_limit import MOST_CUT, UNLIMITED_KW, PowerLimit

UP = {"pitch_deg": 10.0, "machine_mass_kg": 15000.0}
DEMAND_KW = 15.0 * 9.81 * (math.sin(math.radians(10.0)) + 0.06) * 2.0  # at 2 m/s: 68.8 kW


def gain(power_kw, speed_mps, signals):
    return stepped(PowerLimit(power_kw, 1.0), speed_mps, signals)


def stepped(effect, speed_mps, signals):
    return effect.step(1.0, speed_mps, signals, effect.start(0.0), 0.2)[0]


def driven(effect, free_mps, signals, lag=0.4):
    """The speed in m/s at which a machine settles whose speed follows the drive through a low-pass."""
    speed_mps, state = 0.0, effect.start(0.0)
    for _ in range(400):
        passed, state = effect.step(1.0, speed_mps, signals, state, 0.2)
        speed_mps += lag * (passed * free_mps - speed_mps)
    return speed_mps


def test_beyond_the_limit_the_gain_is_the_share_that_can_be_given():
    assert gain(30.0, 2.0, UP) == pytest.approx(30.0 / DEMAND_KW)
    assert gain(30.0, 2.0, UP | {"machine_mass_kg": 30000.0}) == pytest.approx(15.0 / DEMAND_KW)


def test_a_soft_limit_takes_back_a_power_of_the_excess():
    assert stepped(PowerLimit(30.0, 0.3), 2.0, UP) == pytest.approx((30.0 / DEMAND_KW) ** 0.3)


@pytest.mark.parametrize(("pitch_deg", "speed_mps"), [(-10.0, 2.0), (10.0, -2.0), (10.0, 0.5), (0.0, 2.0)])
def test_downhill_slow_and_level_nothing_is_felt(pitch_deg, speed_mps):
    assert gain(30.0, speed_mps, UP | {"pitch_deg": pitch_deg}) == 1.0


def test_soft_ground_asks_for_power_on_the_level_too():
    level = UP | {"pitch_deg": 0.0}
    asked_kw = 15.0 * 9.81 * 0.12 * 2.0
    assert stepped(PowerLimit(20.0, 1.0, rolling_resistance=0.12), 2.0, level) == pytest.approx(20.0 / asked_kw)


def test_backwards_uphill_is_uphill():
    assert gain(30.0, -2.0, UP | {"pitch_deg": -10.0}) == gain(30.0, 2.0, UP)


@pytest.mark.parametrize("mass", [{}, {"machine_mass_kg": math.nan}])
def test_an_unmeasured_mass_is_that_of_an_empty_machine(mass):
    assert gain(30.0, 2.0, {"pitch_deg": 10.0} | mass) == gain(30.0, 2.0, UP)
    columns = {name: np.array([value]) for name, value in ({"pitch_deg": 10.0} | mass).items()}
    np.testing.assert_allclose(gain(30.0, np.array([2.0]), columns), gain(30.0, 2.0, UP))


def test_an_unmeasured_slope_is_no_number():
    assert math.isnan(gain(30.0, 2.0, {"pitch_deg": math.nan}))


def test_without_a_limit_of_the_power_nobody_asks_for_the_slope():
    for cuts in (PowerLimit(), PowerLimit(onset_pct=90.0)):
        value, _ = cuts.step(0.7, 2.0, {"pitch_deg": math.nan, "engine_load_pct": 50.0}, cuts.start(0.0), 0.2)
        assert value == 0.7


def test_300_kw_is_no_limit_and_just_below_it_is_one():
    steep = {"pitch_deg": 30.0, "machine_mass_kg": 40000.0}
    assert gain(UNLIMITED_KW, 10.0, steep) == 1.0
    assert gain(UNLIMITED_KW - 1.0, 10.0, steep) < 0.2


def test_the_corner_has_no_kink_for_a_fit_by_differences():
    powers_kw = np.linspace(0.6, 1.6, 2001)[:, None] * DEMAND_KW
    slope = np.diff(gain(powers_kw, np.array([2.0]), {"pitch_deg": np.array([10.0])})[:, 0]) / np.diff(powers_kw[:, 0])
    assert np.max(np.abs(np.diff(slope))) < 0.01 * np.max(slope)  # a kink is a jump of all of it
    assert np.all(slope >= 0.0)
    assert slope[-1] == 0.0


@pytest.mark.parametrize("follow_s", [0.1, 0.4, 1.5])
def test_a_hard_limit_keeps_the_power_and_a_soft_one_half_of_the_way(follow_s):
    free_mps, limited_mps = 2.5, 30.0 / (DEMAND_KW / 2.0)
    assert driven(PowerLimit(30.0, 1.0, follow_s), free_mps, UP) == pytest.approx(limited_mps, rel=1e-6)
    half_mps = math.sqrt(free_mps * limited_mps)
    assert driven(PowerLimit(30.0, 0.5, follow_s), free_mps, UP) == pytest.approx(half_mps, rel=1e-6)


def test_a_hole_in_the_slope_is_forgotten_once_it_is_known_again():
    effect = PowerLimit(30.0, 1.0)
    _, state = effect.step(1.0, 2.0, UP | {"pitch_deg": math.nan}, effect.start(0.0), 0.2)
    assert effect.step(1.0, 2.0, UP, state, 0.2)[0] == gain(30.0, 2.0, UP)


def test_what_the_pitch_shows_of_acceleration_can_be_left_out():
    effect, dt_s, accel_mps2 = PowerLimit(30.0, 1.0, acceleration_share=1.0, filter_s=0.5), 0.2, 1.0
    pitch_deg = math.degrees(math.asin(accel_mps2 / 9.81))
    state, shaken = effect.start(0.0), 0.0
    for k in range(60):
        signals = UP | {"pitch_deg": pitch_deg, "ground_speed_mps": accel_mps2 * dt_s * k}
        shaken, state = effect.step(1.0, 3.0, signals, state, dt_s)
    assert shaken == pytest.approx(gain(30.0, 3.0, UP | {"pitch_deg": 0.0}), abs=1e-3)
    assert gain(30.0, 3.0, UP | {"pitch_deg": pitch_deg}) < 0.8 * shaken


def test_where_the_pressure_is_known_it_says_what_the_ground_asks_for():
    effect = PowerLimit(30.0, 1.0, kn_per_bar=0.1, rest_bar=50.0)
    pressed = UP | {"line_pressure_bar": 350.0}
    assert stepped(effect, 2.0, pressed) == pytest.approx(30.0 / (0.1 * 300.0 * 2.0))
    assert stepped(effect, 2.0, pressed | {"pitch_deg": 0.0}) == stepped(effect, 2.0, pressed)  # whatever holds it
    assert stepped(effect, 0.5, pressed) == 1.0
    assert stepped(effect, 2.0, UP | {"line_pressure_bar": -100.0}) == 1.0  # it is pushed
    assert stepped(effect, -2.0, UP | {"line_pressure_bar": -350.0}) == stepped(effect, 2.0, pressed)  # and in reverse
    for unknown in ({}, {"line_pressure_bar": math.nan}):
        assert stepped(effect, 2.0, UP | unknown) == gain(30.0, 2.0, UP)


def test_a_peak_of_the_pressure_is_felt_through_the_lag():
    effect = PowerLimit(30.0, 1.0, follow_s=math.inf, kn_per_bar=0.1, filter_s=0.5)
    calm, peak = UP | {"line_pressure_bar": 100.0}, UP | {"line_pressure_bar": 400.0}
    _, state = effect.step(1.0, 2.0, calm, effect.start(0.0), 0.2)
    felt, _ = effect.step(1.0, 2.0, peak, state, 0.2)
    assert felt == pytest.approx(30.0 / (20.0 + 60.0 * (1.0 - math.exp(-0.4))))


def test_what_else_the_engine_drives_leaves_less_for_the_wheels():
    one = PowerLimit(60.0, 1.0, load_share=0.5)
    for load_pct, left_kw in ((0.0, 60.0), (40.0, 48.0), (80.0, 36.0), (-10.0, 60.0)):
        assert stepped(one, 2.0, UP | {"engine_load_pct": load_pct}) == pytest.approx(min(left_kw / DEMAND_KW, 1.0))
    for not_measured in ({}, {"engine_load_pct": math.nan}):
        assert stepped(one, 2.0, UP | not_measured) == pytest.approx(60.0 / DEMAND_KW)
    assert stepped(PowerLimit(60.0, 1.0, load_share=1.0), 2.0, UP | {"engine_load_pct": 120.0}) > 0.0
    assert stepped(PowerLimit(load_share=0.5), 2.0, UP | {"engine_load_pct": 90.0}) == 1.0, "300 kW is no limit"


def test_a_controller_cuts_the_stroke_while_the_engine_is_overloaded_and_gives_it_back_slowly():
    effect, dt_s = PowerLimit(onset_pct=90.0, cut_per_pct_s=0.01, release_s=2.0), 0.2
    state, gains = effect.start(0.0), []
    for load_pct in [60.0] * 10 + [100.0] * 50 + [60.0] * 10:
        found, state = effect.step(1.0, 1.0, {"pitch_deg": 0.0, "engine_load_pct": load_pct}, state, dt_s)
        gains.append(found)
    assert gains[9] == 1.0
    assert gains[59] == pytest.approx(1.0 - 2.0 * 0.01 * 10.0, abs=0.002)  # k tau (L - L_0)
    assert 1.0 - gains[69] == pytest.approx((1.0 - gains[59]) * math.exp(-1.0), rel=1e-6)  # 2 s later


@pytest.mark.parametrize("load", [{}, {"engine_load_pct": math.nan}, {"engine_load_pct": 89.0}])
def test_an_engine_load_that_is_not_measured_or_not_near_its_end_cuts_nothing(load):
    assert stepped(PowerLimit(onset_pct=90.0), 2.0, {"pitch_deg": 0.0} | load) == 1.0


def test_without_an_onset_no_engine_load_cuts_anything():
    overloaded = {"pitch_deg": 0.0, "engine_load_pct": 150.0}
    assert stepped(PowerLimit(), 2.0, overloaded) == 1.0
    assert stepped(PowerLimit(onset_pct=90.0), 2.0, overloaded) < 1.0


def test_a_cut_off_destrokes_the_pump_from_a_pressure_on_at_any_speed():
    effect = PowerLimit(cutoff_bar=300.0, cut_per_bar=0.005)
    for speed_mps in (0.1, 3.0):
        pressed = [stepped(effect, speed_mps, {"pitch_deg": 0.0, "line_pressure_bar": bar}) for bar in (290, 340, 900)]
        np.testing.assert_allclose(pressed, [1.0, 0.8, 1.0 - MOST_CUT])
    assert stepped(effect, -1.0, {"pitch_deg": 0.0, "line_pressure_bar": -340.0}) == pytest.approx(0.8)
    for unknown in ({}, {"line_pressure_bar": math.nan}):
        assert stepped(effect, 2.0, {"pitch_deg": 0.0} | unknown) == 1.0
    assert stepped(PowerLimit(), 2.0, {"pitch_deg": 0.0, "line_pressure_bar": 900.0}) == 1.0
