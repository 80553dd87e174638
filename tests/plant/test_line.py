"""The oil line with its load against a fine reference solution, and its balances of oil and energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cruise.plant import vehicle
from cruise.plant.line import Line, LineSettings, coast
from cruise.plant.oil import Oil, OilSettings
from cruise.plant.vehicle import TransmissionSettings, VehicleSettings, Wheels

LINE = Line.of(LineSettings(), Oil.of(OilSettings()))
LEAKAGE = LINE.leakage(55.0)


def wheels(gear: int = 2, grade_deg: float = 0.0, rolling_resistance: float = 0.02, brake: float = 0.0) -> Wheels:
    transmission = TransmissionSettings()
    ratio = vehicle.shaft_per_travel_radpm(transmission, gear, clutch=False)
    return vehicle.wheels(VehicleSettings(), transmission, ratio, 15700.0, grade_deg, rolling_resistance, brake)


def drive(
    load: Wheels, flow_in: float, seconds: float, step_s: float, start: tuple[float, float], line: Line = LINE
) -> tuple[float, float]:
    pressure_pa, speed = start
    for _ in range(round(seconds / step_s)):
        pressure_pa, speed, _ = line.advance(load, pressure_pa, speed, flow_in, LEAKAGE, step_s)
    return pressure_pa, speed


def test_line_is_solved_with_second_order() -> None:
    line = Line.of(LineSettings(), Oil.of(OilSettings(free_air_share=0.0)))
    load, flow_in, start, times_s = wheels(grade_deg=2.0), 2e-3, (30e5, 0.9), [0.2, 0.4, 0.6, 0.8, 1.0]

    def slope(_: float, y: np.ndarray) -> list[float]:
        rate = load.rate(y[0], y[1], 1.0)
        return [(flow_in - rate.flow - LEAKAGE * y[0]) / line.capacity(y[0]), rate.force / load.inertia]

    reference = solve_ivp(slope, (0.0, 1.0), start, t_eval=times_s, rtol=1e-10, atol=1e-9, method="LSODA").y[1]
    errors = []
    for step_s in (0.02, 0.01, 0.005):
        speeds = [drive(load, flow_in, time_s, step_s, start, line)[1] for time_s in times_s]
        errors.append(np.abs(speeds - reference).max())
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=1.0)
    assert errors[1] / errors[2] == pytest.approx(4.0, abs=1.0)


def test_oil_that_enters_the_line_is_oil_that_leaves_or_stays() -> None:
    load, step_s = wheels(grade_deg=3.0), 1e-4
    pressure_pa, speed, entered, left, stored = 0.0, 1.0, 0.0, 0.0, 0.0
    for index in range(20_000):
        flow_in = 2e-3 + 5e-4 * np.sin(index * step_s * 6.0)
        before_pa = pressure_pa
        middle = load.rate(pressure_pa, speed, 1.0)
        pressure_pa, speed, _ = LINE.advance(load, pressure_pa, speed, flow_in, LEAKAGE, step_s)
        entered += flow_in * step_s
        left += (0.5 * (middle.flow + load.rate(pressure_pa, speed, 1.0).flow) + LEAKAGE * pressure_pa) * step_s
        stored += LINE.capacity(0.5 * (before_pa + pressure_pa)) * (pressure_pa - before_pa)
    assert entered == pytest.approx(left + stored, rel=1e-4)
    assert stored > 1e-6


def test_hydraulic_work_is_motion_height_friction_and_heat() -> None:
    load, step_s = wheels(grade_deg=3.0), 1e-4
    pressure_pa, speed, work_j, out_j = 20e5, 0.5, 0.0, 0.0
    motion_j = -0.5 * load.inertia * speed**2
    for _ in range(20_000):
        before_pa, before = pressure_pa, speed
        pressure_pa, speed, loss_w = LINE.advance(load, pressure_pa, speed, 2.5e-3, LEAKAGE, step_s)
        mean_pa, mean = 0.5 * (before_pa + pressure_pa), 0.5 * (before + speed)
        slip_w = mean_pa * (load.rate(mean_pa, mean, 1.0).flow - load.displacement_m3pm * mean)
        resistance_n = load.dry_friction + load.slope_n + load.drag_n_per_mps * mean
        work_j += 2.5e-3 * mean_pa * step_s
        out_j += (loss_w + slip_w + resistance_n * mean) * step_s
        out_j += mean_pa * LINE.capacity(mean_pa) * (pressure_pa - before_pa)
    motion_j += 0.5 * load.inertia * speed**2
    assert work_j == pytest.approx(motion_j + out_j, rel=1e-3)
    assert motion_j > 0.1 * work_j


def test_leakage_grows_with_temperature() -> None:
    assert LINE.leakage(50.0) == pytest.approx(2.5e-3 / 60.0 / 1e7)
    assert LINE.leakage(80.0) > 2.0 * LINE.leakage(50.0) > 4.0 * LINE.leakage(25.0)


@pytest.mark.parametrize("step_s", [0.002, 0.01])
def test_relief_valve_bounds_the_pressure_at_any_step(step_s: float) -> None:
    pressure_pa, speed = drive(wheels(gear=4, grade_deg=8.0), 4.5e-3, 1.0, step_s, (0.0, 0.0))
    assert 400e5 < pressure_pa < 425e5
    assert 0.0 <= speed < 2.0


def test_pressure_while_braking_stops_at_its_own_valve() -> None:
    pressure_pa, speed = drive(wheels(), 0.0, 0.2, 0.01, (0.0, 2.5))
    assert -320e5 < pressure_pa < -300e5
    assert 0.0 < speed < 2.5


@pytest.mark.parametrize("brake", [0.0, 1.0])
@pytest.mark.parametrize("step_s", [0.005, 0.01, 0.02])
def test_dry_friction_stops_the_machine_and_holds_it(brake: float, step_s: float) -> None:
    load = wheels(rolling_resistance=0.12, brake=brake)
    speed, turned_around = 1.0, False
    for _ in range(round(2.0 / step_s)):
        speed = coast(load, speed, step_s)
        turned_around |= speed < 0.0
    assert speed == 0.0
    assert not turned_around


@pytest.mark.parametrize(("grade_deg", "moves"), [(6.0, False), (-6.0, False), (9.0, True)])
def test_slope_moves_the_uncoupled_machine_only_beyond_its_friction(grade_deg: float, moves: bool) -> None:
    load, speed = wheels(grade_deg=grade_deg, rolling_resistance=0.12), 0.0
    for _ in range(100):
        speed = coast(load, speed, 0.01)
    assert (speed < -0.1) if moves else (speed == 0.0)
