"""The parts of the virtual combine against their equations, solved or derived another way."""

from itertools import pairwise
from math import exp, inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from scipy.integrate import solve_ivp

from cruise.plant import engine, hysteresis, oil, pump, solenoid, tyre
from cruise.plant.engine import RADPS_PER_RPM, EngineSettings
from cruise.plant.hysteresis import HysteresisSettings
from cruise.plant.oil import Oil, OilSettings
from cruise.plant.pump import PumpSettings
from cruise.plant.solenoid import SolenoidSettings


def test_coil_current_follows_its_differential_equation() -> None:
    settings = SolenoidSettings()
    reference = solve_ivp(lambda _, i: (700.0 - i) / settings.regulated_lag_s, (0.0, 0.01), [600.0], rtol=1e-9)
    coil = solenoid.advance(settings, 600.0, 700.0, 0.01)
    assert coil.current_ma == pytest.approx(reference.y[0, -1], rel=1e-6)
    fine_ma = [600.0]
    for _ in range(1000):
        fine_ma.append(solenoid.advance(settings, fine_ma[-1], 700.0, 1e-5).current_ma)
    assert coil.mean_ma == pytest.approx(np.trapezoid(fine_ma) / 1000.0, abs=0.01)


def test_battery_limits_how_fast_the_current_rises() -> None:
    quick = SolenoidSettings(regulated_lag_s=0.001)
    current_ma = solenoid.advance(quick, 0.0, 1200.0, 0.002).current_ma
    unlimited_ma = solenoid.advance(structs.replace(quick, battery_v=1e6), 0.0, 1200.0, 0.002).current_ma
    assert current_ma == pytest.approx(1e3 * 13.5 / 3.7 * (1.0 - exp(-0.002 * 3.7 / 0.033)), rel=1e-9)
    assert current_ma < unlimited_ma


def test_output_stage_limits_the_current() -> None:
    assert solenoid.advance(SolenoidSettings(), 1300.0, 5000.0, 1.0).current_ma == 1300.0


@pytest.mark.parametrize("shape", [0.5, 0.7, 1.0])
def test_friction_follows_the_bouc_wen_equation(shape: float) -> None:
    settings = HysteresisSettings(half_width_ma=20.0, shape=shape)
    z = 0.0
    for start_ma, end_ma in pairwise([0.0, 90.0, 70.0, 71.0, 10.0, 40.0]):
        sign = np.sign(end_ma - start_ma)

        def slope(_: float, value: np.ndarray, sign: float = sign) -> np.ndarray:
            return sign * (1.0 - abs(value) * (shape * np.sign(value * sign) + 1.0 - shape)) / (2.0 * shape * 20.0)

        reference = solve_ivp(slope, (0.0, abs(end_ma - start_ma)), [z], rtol=1e-9, atol=1e-12, max_step=0.1)
        z = hysteresis.advance(settings, z, end_ma - start_ma)
        assert z == pytest.approx(reference.y[0, -1], abs=1e-5)


@given(st.floats(-1, 1), st.floats(-300, 300), st.floats(0.5, 1))
def test_friction_holds_the_spool_and_never_moves_it_against_the_current(z: float, change_ma: float, shape: float):
    settings = HysteresisSettings(half_width_ma=20.0, shape=shape)
    moved_ma = change_ma - 20.0 * (hysteresis.advance(settings, z, change_ma) - z)
    assert moved_ma * np.sign(change_ma) >= -1e-9


@pytest.mark.parametrize("shape", [0.5, 0.7, 1.0])
def test_a_spool_stands_where_the_current_turns_around(shape: float) -> None:
    settings = HysteresisSettings(half_width_ma=20.0, shape=shape)
    assert 1.0 - 20.0 * (hysteresis.advance(settings, -1.0, 1.0) + 1.0) == pytest.approx(0.0, abs=0.03)


@given(st.floats(-1, 1), st.floats(-300, 300), st.floats(0, 1))
def test_friction_depends_on_the_travel_and_not_on_its_cuts(z: float, change_ma: float, cut: float) -> None:
    settings = HysteresisSettings()
    whole = hysteresis.advance(settings, z, change_ma)
    in_two = hysteresis.advance(settings, hysteresis.advance(settings, z, cut * change_ma), (1.0 - cut) * change_ma)
    assert in_two == pytest.approx(whole, abs=1e-9)
    assert abs(whole) <= 1.0


@given(st.floats(0, 1300), st.floats(0, 200))
def test_stroke_is_odd_and_rises(current_ma: float, more_ma: float) -> None:
    settings = PumpSettings()
    stroke = pump.stroke(settings, current_ma)
    assert pump.stroke(settings, -current_ma) == -stroke
    assert pump.stroke(settings, current_ma + more_ma) >= stroke


def test_stroke_has_a_dead_zone_and_reaches_one_at_the_full_stroke_current() -> None:
    settings = PumpSettings()
    assert pump.stroke(settings, 300.0) < 1e-4
    assert pump.stroke(settings, settings.full_stroke_ma) == pytest.approx(1.0, rel=1e-3)
    halfway_ma = 0.5 * (settings.threshold_ma + settings.full_stroke_ma)
    assert 0.2 < pump.stroke(settings, halfway_ma) < 0.45, "between quadratic (0.25) and linear (0.5)"
    assert pump.target(settings, 1300.0, 0.0, 4e-3) == settings.stop


def test_pressure_takes_stroke_while_pumping_and_gives_some_while_motoring() -> None:
    settings = PumpSettings()
    unloaded = pump.target(settings, 800.0, 0.0, 4e-3)
    assert pump.target(settings, 800.0, 100e5, 4e-3) == pytest.approx(unloaded * (1.0 - 0.08))
    assert pump.target(settings, 800.0, -100e5, 4e-3) == pytest.approx(unloaded * (1.0 + 0.08))
    assert pump.target(settings, -800.0, -100e5, 4e-3) == pytest.approx(-unloaded * (1.0 - 0.08))


@pytest.mark.parametrize(("start", "end"), [(0.1, 0.13), (0.0, 1.0), (0.9, 0.2), (-0.4, 0.5)])
def test_servo_follows_its_differential_equation(start: float, end: float) -> None:
    settings = PumpSettings()

    def slope(_: float, swash: np.ndarray) -> np.ndarray:
        error = end - swash
        rate_per_s = np.where(swash * error < 0.0, settings.return_rate_per_s, settings.stroke_rate_per_s)
        return error / np.sqrt(settings.servo_lag_s**2 + (error / rate_per_s) ** 2)

    reference = solve_ivp(slope, (0.0, 0.3), [start], rtol=1e-8, atol=1e-10, max_step=1e-3)
    swash = start
    for _ in range(30):
        swash = pump.advance(settings, swash, end, 0.01)
    assert swash == pytest.approx(reference.y[0, -1], abs=3e-3), "the rate changes within the step that crosses zero"


def test_servo_without_lag_and_rate_limit_is_at_once_there() -> None:
    settings = PumpSettings(servo_lag_s=0.0, stroke_rate_per_s=inf)
    assert pump.advance(settings, 0.1, 0.7, 0.01) == 0.7


def test_oil_has_the_viscosities_of_its_grade() -> None:
    vg_46 = Oil.of(OilSettings())
    assert vg_46.viscosity_mm2ps(40.0) == pytest.approx(46.0)
    assert vg_46.viscosity_mm2ps(100.0) == pytest.approx(6.8)
    assert 28.5 < vg_46.viscosity_mm2ps(50.0) < 31.0, "charts of VG 46, viscosity index 100"


def test_air_softens_the_oil_at_low_pressure_only() -> None:
    with_air, without = Oil.of(OilSettings()), Oil.of(OilSettings(free_air_share=0.0))
    assert without.compliance_per_pa(3e6) == pytest.approx(1.0 / 1.3e9)
    assert with_air.compliance_per_pa(3e6) > 1.2 * without.compliance_per_pa(3e6)
    assert with_air.compliance_per_pa(4e7) < 1.05 * without.compliance_per_pa(4e7)


def test_oil_warms_to_where_cooling_equals_the_losses() -> None:
    settings = OilSettings()
    temperature_c = 10.0
    for _ in range(10_000):
        temperature_c = oil.advance(settings, temperature_c, 2000.0, 1.0)
    assert temperature_c == pytest.approx(25.0 + 7000.0 / 190.0, abs=0.01)


def run_engine(
    settings: EngineSettings, setpoint_rpm: float, load_nm: float, seconds: float = 20.0
) -> engine.EngineStep:
    state = engine.EngineStep(setpoint_rpm * RADPS_PER_RPM, 0.0, 0.0, 0.0)
    for _ in range(round(seconds / 0.01)):
        state = engine.advance(settings, *state[:3], setpoint_rpm, load_nm, 0.01)
    return state


@pytest.mark.parametrize("setpoint_rpm", [1300.0, 1700.0, 2100.0])
def test_governor_holds_the_set_speed_less_its_droop(setpoint_rpm: float) -> None:
    settings = EngineSettings()
    state = run_engine(settings, setpoint_rpm, load_nm=570.0)
    assert state.torque_nm == pytest.approx(570.0, rel=1e-3)
    assert state.speed_radps / RADPS_PER_RPM == pytest.approx(setpoint_rpm * (1.0 - 0.015), rel=1e-3)
    isochronous = run_engine(structs.replace(settings, droop_share=0.0), setpoint_rpm, load_nm=570.0)
    assert isochronous.speed_radps / RADPS_PER_RPM == pytest.approx(setpoint_rpm, rel=1e-3)


def test_overload_sags_to_where_the_full_load_curve_carries_it() -> None:
    settings = EngineSettings()
    state = run_engine(settings, 2100.0, load_nm=1325.0)
    assert state.load_pct == pytest.approx(100.0, abs=0.1)
    assert state.speed_radps / RADPS_PER_RPM == pytest.approx(1800.0, abs=5.0), "1325 N m on the curve"
    assert engine.full_load_torque_nm(settings, state.speed_radps) == pytest.approx(1325.0, abs=2.0)


def test_governor_comes_off_its_limit_without_delay() -> None:
    settings = EngineSettings()
    state, speeds_rpm = run_engine(settings, 2100.0, load_nm=1325.0), []
    for _ in range(1000):
        state = engine.advance(settings, *state[:3], 2100.0, 300.0, 0.01)
        speeds_rpm.append(state.speed_radps / RADPS_PER_RPM)
    assert max(speeds_rpm) < 2300.0
    assert speeds_rpm[-1] == pytest.approx(2100.0 * (1.0 - 0.03 * 300.0 / 1140.0), rel=1e-3)


def test_engine_brakes_what_drives_it() -> None:
    settings = EngineSettings()
    assert run_engine(settings, 2100.0, load_nm=-150.0).speed_radps < 2150.0 * RADPS_PER_RPM
    assert run_engine(settings, 2100.0, load_nm=-250.0, seconds=3.0).speed_radps > 2250.0 * RADPS_PER_RPM


def test_full_load_curve_is_a_harvester_engine() -> None:
    settings = EngineSettings()
    power_kw = {
        rpm: 1e-3 * engine.full_load_torque_nm(settings, rpm * pi / 30.0) * rpm * pi / 30.0 for rpm in (1300, 2100)
    }
    assert power_kw[2100] == pytest.approx(250.0, abs=2.0)
    assert 0.65 < power_kw[1300] / power_kw[2100] < 0.85


@given(st.floats(-0.9, 0.9), st.floats(0.3, 8.0))
def test_slip_solves_brixius_equation(use: float, speed_mps: float) -> None:
    slip_mps, _, _ = tyre.slip_speed_mps(use, speed_mps)
    scale_mps = (speed_mps**2 + tyre.STANDSTILL_MPS**2) ** 0.5
    travel = abs(slip_mps) / scale_mps
    slip = travel / (1.0 + travel)
    assert slip_mps * use >= 0.0
    assert 1.0 - exp(-7.5 * slip) == pytest.approx(abs(use), abs=1e-9)


@given(st.floats(-1.5, 1.5).filter(lambda use: min(abs(use), abs(abs(use) - 0.95)) > 1e-3), st.floats(0.1, 8.0))
def test_slip_derivatives_are_those_of_the_slip(use: float, speed_mps: float) -> None:
    _, by_use, by_speed = tyre.slip_speed_mps(use, speed_mps)
    step = 1e-6
    numeric = [
        (tyre.slip_speed_mps(use + du, speed_mps + dv)[0] - tyre.slip_speed_mps(use - du, speed_mps - dv)[0])
        / 2.0
        / step
        for du, dv in ((step, 0.0), (0.0, step))
    ]
    assert [by_use, by_speed] == pytest.approx(numeric, rel=1e-4, abs=1e-6)


def test_soft_soil_carries_less_traction() -> None:
    assert tyre.greatest_traction(0.02) == pytest.approx(0.88, abs=0.01)
    assert tyre.greatest_traction(0.12) < 0.75 * tyre.greatest_traction(0.02)
