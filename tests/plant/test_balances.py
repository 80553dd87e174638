"""Power, oil and forces balance between the parts: what one part gives, the next has."""

from math import copysign, cos, radians

import pytest

from cruise.plant import Combine, Inputs, PlantSettings, engine, vehicle
from cruise.plant.engine import RADPS_PER_RPM, EngineSettings
from cruise.plant.line import M3PS_PER_LPM, PA_PER_BAR, Line, LineSettings
from cruise.plant.oil import Oil, OilSettings
from cruise.plant.vehicle import GRAVITY_MPS2, TransmissionSettings, VehicleSettings, Wheels

PLAIN = PlantSettings()


def wheels(gear: int = 2, grade_deg: float = 0.0, rolling_resistance: float = 0.02, lost: float = 0.0) -> Wheels:
    transmission = TransmissionSettings(speed_loss_share=lost)
    ratio = vehicle.shaft_per_travel_radpm(transmission, gear, clutch=False)
    return vehicle.wheels(VehicleSettings(), transmission, ratio, 15700.0, grade_deg, rolling_resistance, 0.0)


@pytest.mark.parametrize(("gear", "grade_deg", "crop_kw"), [(1, 8.0, 0.0), (2, 5.0, 60.0), (3, -3.0, 40.0)])
def test_the_engine_gives_what_pump_and_machine_take(gear: int, grade_deg: float, crop_kw: float):
    combine = Combine(PLAIN, seed=1)
    combine.advance(Inputs(800.0, gear=gear, grade_deg=grade_deg, crop_power_kw=crop_kw), 30.0)
    now = combine.truth
    crankshaft_radps = now.engine_speed_rpm * RADPS_PER_RPM
    machine_w = engine.machine_torque_nm(PLAIN.engine, crop_kw, crankshaft_radps) * crankshaft_radps
    pump_w = now.line_pressure_bar * PA_PER_BAR * now.pump_flow_lpm * M3PS_PER_LPM
    assert abs(pump_w) > 3e3
    assert now.engine_torque_nm * crankshaft_radps - machine_w == pytest.approx(pump_w, rel=5e-3)


@pytest.mark.parametrize(("grade_deg", "slips"), [(0.0, 0.002), (9.0, 0.02)])
def test_the_wheels_turn_as_the_oil_does_that_is_not_leaked(grade_deg: float, slips: float):
    combine = Combine(PLAIN, seed=1)
    inputs = Inputs(800.0, gear=1, grade_deg=grade_deg, rolling_resistance=0.06)
    combine.advance(inputs, 30.0)
    now = combine.truth
    leaked_m3ps = Line.of(PLAIN.line, Oil.of(PLAIN.oil)).leakage(now.oil_temperature_c) * now.line_pressure_bar
    taken_m3ps = now.pump_flow_lpm * M3PS_PER_LPM - leaked_m3ps * PA_PER_BAR
    displacement_m3pm = wheels(gear=1).displacement_m3pm
    assert now.wheel_speed_mps == pytest.approx(taken_m3ps / displacement_m3pm, rel=1e-3)
    assert now.wheel_speed_mps > now.ground_speed_mps * (1.0 + slips)


def test_on_a_slope_the_ground_bears_less():
    level, steep = wheels(), wheels(grade_deg=30.0)
    weight_n = 15700.0 * GRAVITY_MPS2
    friction_n = TransmissionSettings().driveline_friction_n
    assert steep.dry_friction == pytest.approx(0.02 * weight_n * cos(radians(30.0)) + friction_n)
    assert steep.greatest_traction_n == pytest.approx(level.greatest_traction_n * cos(radians(30.0)))


@pytest.mark.parametrize("pressure_pa", [-60e5, 40e5, 150e5])
@pytest.mark.parametrize("speed", [-0.8, 0.3, 1.9])
def test_the_derivatives_of_the_load_are_those_of_its_rates(pressure_pa: float, speed: float):
    load, direction = wheels(lost=0.1, rolling_resistance=0.05), copysign(1.0, speed)
    rate = load.rate(pressure_pa, speed, direction)
    more, less = (load.rate(pressure_pa + step, speed, direction) for step in (1e3, -1e3))
    assert rate.flow_by_pressure == pytest.approx((more.flow - less.flow) / 2e3, rel=1e-4)
    assert rate.force_by_pressure == pytest.approx((more.force - less.force) / 2e3, rel=1e-4)
    more, less = (load.rate(pressure_pa, speed + step, direction) for step in (1e-5, -1e-5))
    assert rate.flow_by_speed == pytest.approx((more.flow - less.flow) / 2e-5, rel=1e-4)
    assert rate.force_by_speed == pytest.approx((more.force - less.force) / 2e-5, rel=1e-4)


def test_the_heat_of_a_step_that_is_halved_is_that_of_both_halves():
    """Full flow against a machine that stands: the valve opens within the step."""
    line = Line.of(LineSettings(), Oil.of(OilSettings()))
    load, flow_m3ps, leakage, step_s = wheels(grade_deg=25.0, rolling_resistance=0.3), 3e-3, line.leakage(55.0), 0.016
    whole = line.advance(load, 0.0, 0.0, flow_m3ps, leakage, step_s)
    pressure_pa, speed, heat_j, parts = 0.0, 0.0, 0.0, 256
    for _ in range(parts):
        pressure_pa, speed, loss_w = line.advance(load, pressure_pa, speed, flow_m3ps, leakage, step_s / parts)
        heat_j += loss_w * step_s / parts
    assert whole.pressure_pa == pytest.approx(pressure_pa, rel=0.05)
    assert whole.loss_w * step_s == pytest.approx(heat_j, rel=0.15)


def run_engine(settings: EngineSettings, load_nm: float, seconds: float, start: tuple[float, float, float]):
    state = engine.EngineStep(*start, 0.0)
    for _ in range(round(seconds / 0.01)):
        state = engine.advance(settings, state.speed_radps, state.torque_nm, state.governor_nm, 2100.0, load_nm, 0.01)
    return state


def test_the_governor_gives_way_as_soon_as_an_overload_ends():
    settings = EngineSettings(droop_share=0.0)
    start = run_engine(settings, 500.0, 20.0, (2100.0 * RADPS_PER_RPM, 500.0, 500.0))
    overloaded = run_engine(settings, 1300.0, 20.0, start[:3])
    assert overloaded.speed_radps < 1900.0 * RADPS_PER_RPM
    assert overloaded.governor_nm <= engine.full_load_torque_nm(settings, overloaded.speed_radps) * (1.0 + 1e-9)


def test_a_mechanical_governor_does_not_droop_upwards():
    """Downhill the pump drives the engine: its set speed is the one at no load."""
    settings = EngineSettings(droop_share=0.08)
    driven = run_engine(settings, -100.0, 30.0, (2100.0 * RADPS_PER_RPM, 0.0, 0.0))
    assert driven.torque_nm == pytest.approx(-100.0, rel=1e-3)
    assert driven.speed_radps == pytest.approx(2100.0 * RADPS_PER_RPM, rel=1e-4)
