"""The closed-loop trials: courses are rows, figures follow their definitions, the baseline is the textbook's."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from cruise.control.controller import ControlSettings
from cruise.control.frame_model import cumulants_s
from cruise.control.shaping import CommandShaper
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.stroke import factor
from cruise.model.model import Model
from cruise.plant import Combine, Inputs, PlantSettings
from cruise.signals import Sample
from tools.benchmarks import control_step
from tools.closed_loop import courses, machines, picture, scores
from tools.closed_loop.courses import Begin, Course, SetpointRow, laid_over
from tools.closed_loop.drive import Driven, drive, rms
from tools.closed_loop.drivers import DRIVERS, PLAIN, Models
from tools.closed_loop.pid import Pid
from tools.closed_loop.trial import Hold, Run

MODEL = Model(0.2, 1, 2, 2, (GearRatio(1.4, 2.5, 4.4, 7.5),), (0.4, 1e-3, 8e-4, 0.0))
PLANT = PlantSettings()


def driven(speeds, setpoints, references=None) -> Driven:
    count = len(speeds)
    time_s = 0.05 * np.arange(1, count + 1)
    references = setpoints if references is None else references
    columns = (time_s, setpoints, references, speeds, np.full(count, 800.0), np.full(count, 2100.0))
    return Driven(*(np.asarray(column, float) for column in columns))


def test_the_courses_are_those_that_are_asked_for():
    found = {course.name: course for course in courses.load()}
    assert {"steps", "hill up", "hill down", "soft soil", "bin", "rpm", "warm-up", "crop", "hysteresis"} <= set(found)
    assert {course.begin.gear for course in found.values()} == {1, 2, 3, 4}
    rpm = found["rpm"]
    assert rpm.inputs(0.0, 22.5).engine_speed_setpoint_rpm == pytest.approx(1800.0)
    assert found["hill down"].inputs(0.0, 30.0).grade_deg == -5.0
    assert found["hysteresis"].machine(PLANT).effects.hysteresis == 1.4
    assert found["hysteresis"].machine(PLANT).effects.grade == 1.0


def test_overshoot_and_lateness_of_a_step():
    setpoint = np.where(np.arange(600) < 200, 1.0, 1.4)
    reference = np.interp(np.arange(600), [200, 260], [1.0, 1.4])
    speed = np.interp(np.arange(600), [200, 270], [1.0, 1.43])
    speed = np.where(np.arange(600) > 300, 1.4, speed)
    (step,) = scores.steps(driven(speed, setpoint, reference))
    assert step.overshoot == pytest.approx(0.03 / 0.02, rel=1e-6)
    at_reference = np.flatnonzero(np.abs(reference[200:] - 1.4) > 0.03)[-1]
    at_speed = np.flatnonzero(np.abs(speed[200:] - 1.4) > 0.03)[-1]
    assert step.late_s == pytest.approx(0.05 * (at_speed - at_reference))


def test_errors_leave_out_the_engagement_and_what_follows_a_change():
    speed = np.full(800, 1.1)
    speed[:160] = 9.0
    setpoint = np.where(np.arange(800) < 400, 1.0, 1.1)
    one = driven(speed, setpoint)
    assert rms([scores.to_setpoint(replace(one, speed_mps=speed + (np.arange(800) >= 400) * 1.0))]) > 0.3
    assert len(scores.to_setpoint(one)) == 800 - 160 - 161
    assert scores.to_reference(one).max() == pytest.approx(0.1)


def test_the_lesson_teaches_when_the_drive_answers():
    """Its mean delay is that of a small step at the lesson's usual stroke, hysteresis aside; the pitch takes none."""
    off = laid_over(PLANT.effects, {"hysteresis": 0.0, "sensor_noise": 0.0})
    combine = Combine(structs.replace(PLANT, effects=off), 3)
    speeds = []
    for k in range(600):
        combine.advance(Inputs(750.0 if k < 300 else 770.0, gear=2, rolling_resistance=0.05), 0.05 * (k + 1))
        speeds.append(combine.truth.ground_speed_mps)
    way = (np.array(speeds[300:]) - speeds[299]) / (speeds[-1] - speeds[299])
    taught = machines.learned(machines.lesson(PLANT, 3, 200.0), machines.gears(PLANT, 3))
    mean_s, _ = cumulants_s(taught)  # at the usual stroke
    slow_s = -machines.PERIOD_S / math.log(taught.theta[0])
    mean_s += slow_s * (factor(taught.stroke_share, speeds[299]) - 1.0)
    assert mean_s == pytest.approx(0.05 * float(np.sum(1.0 - way)), abs=0.04)


def test_the_gears_are_told_by_what_a_current_more_is_worth():
    """Not by the speeds: what rolling costs grows with the square of the ratio. The machine's own are 4.40 and 7.80."""
    gears = machines.gears(PLANT, 3)
    assert gears.gear_2_mps == machines.SECOND_MPS
    assert 1.35 < gears.gear_1_mps < 1.45
    assert 4.15 < gears.gear_3_mps < 4.4
    assert 6.75 < gears.gear_4_mps < 7.8


def test_the_share_within_a_limit():
    assert scores.within([np.array([0.5, -0.5, 2.0]), np.array([-3.0])], 1.0) == 0.5


def test_the_pid_is_simc_on_the_models_core():
    """Delay 0.4 s and more, all of the rest in one small time constant: nearly an integrator of 1 / (2 theta)."""
    pid = Pid(MODEL, ControlSettings())
    signals = {"gear": 2.0}
    for k in range(40):
        pid.step(Sample(0.05 * k, 500.0, 1.5, signals), None)
    first = pid.step(Sample(2.0, 500.0, 1.5, signals), 1.5)
    assert first == pytest.approx(500.0, abs=0.5)
    begun = pid.integral_mps
    for k in range(20):
        pid.step(Sample(2.05 + 0.05 * k, 500.0, 1.4, signals), 1.5)
    theta = pid.core.delay_s
    tau = max(pid.core.time_constant_s, pid.core.lag_s)
    expected = tau / (2.0 * theta) / min(tau, 8.0 * theta) * 0.1 * 1.0
    assert pid.integral_mps - begun == pytest.approx(expected, rel=0.08)


def test_a_pid_that_is_held_to_1_hz_is_slower_by_the_laws_shaper():
    """Half of the third lag and all of the fourth count as dead time, and the current moves as the shaper lets it."""
    moved, learned = [], []
    for held in (False, True):
        pid = Pid(MODEL, ControlSettings(), held)
        sample = Sample(0.0, 500.0, 1.5, {"gear": 2.0})
        for _ in range(40):
            pid.step(sample, None)
        first_ma, begun = pid.step(sample, 1.5), pid.integral_mps
        moved.append(pid.step(replace(sample, speed_mps=1.49), 1.5) - first_ma)
        learned.append(pid.integral_mps - begun)
    settings = ControlSettings()
    shaper = CommandShaper(settings.shaping_hz, settings.shaping_order, settings.frame_s)
    assert 0.0 < moved[1] < 2.0 * shaper.share**settings.shaping_order * moved[0]
    theta = pid.core.delay_s + 1.5 / (2.0 * math.pi * settings.shaping_hz)  # the core's own lag is a little longer
    assert learned[1] / learned[0] == pytest.approx(pid.core.delay_s / theta, rel=0.05)


def test_without_feed_forward_a_driver_sees_gear_and_drive_only():
    given = Models(MODEL, MODEL, MODEL)
    assert set(PLAIN) == {
        "engine_speed_rpm",
        "pitch_deg",
        "machine_mass_kg",
        "oil_temperature_c",
        "engine_load_pct",
        "line_pressure_bar",
    }
    for name in ("pid", "pid_factory", "pid_1hz", "plain"):
        currents = []
        for rpm in (2100.0, 1500.0):
            driver = DRIVERS[name].make(given, ControlSettings())
            sample = Sample(0.0, 500.0, 1.5, {"gear": 2.0, "engine_speed_rpm": rpm})
            driver.step(sample, None)
            currents.append(driver.step(sample, 1.6))
        assert currents[0] == currents[1]


def test_a_drive_is_the_same_again_and_the_reference_waits_for_the_dead_time():
    course = Course(name="short", seconds=3.0, setpoints=(SetpointRow(at_s=1.0, to=1.5),), begin=Begin())
    one, other = (drive(course, PLANT, Hold(790.0), 3) for _ in range(2))
    np.testing.assert_array_equal(one.speed_mps, other.speed_mps)
    still = drive(Course(name="still", seconds=3.0), PLANT, Hold(790.0), 3)
    first_s = one.time_s[np.flatnonzero(one.reference_mps != still.reference_mps)[0]]
    assert first_s == pytest.approx(1.0 + PLANT.pump.transport_delay_s, abs=0.04)


def test_a_run_has_its_figures_beside_their_targets():
    course = Course(name="short", seconds=25.0, setpoints=(SetpointRow(at_s=10.0, to=1.3),), judged=("steps",))
    run = Run("factory", PLANT, 1, (course,), Models(MODEL, MODEL, MODEL), ControlSettings())
    one = driven(np.full(500, 1.02), np.where(np.arange(500) < 200, 1.0, 1.3))
    two = driven(np.full(500, 1.01), np.where(np.arange(500) < 200, 1.0, 1.3))
    run.drives = {"pid": {"short": one}, "learned": {"short": two}}
    run.gains = {0.1: 200.0, 0.2: 250.0, 0.3: 250.0, 1.5: 20.0, 2.0: 10.0, 3.0: 5.0, 4.0: 1.0, 5.0: 1.0}
    found = {figure.key: figure for figure in run.figures()}
    assert found["ripple_db"].value == pytest.approx(20.0 * math.log10(12.5))
    assert found["reference_over_pid"].at_most == 0.45
    assert found["reference_over_pid"].value == pytest.approx(
        rms([scores.to_reference(two)]) / rms([scores.to_reference(one)])
    )
    assert found["overshoot"].value < 0.0
    assert "over_bound" not in found


def test_every_machine_can_be_made():
    for name in machines.MACHINES:
        machine = machines.machine(name, PLANT)
        assert (machine == PLANT) == (name == "factory")


def test_the_step_is_timed_and_its_memory_watched():
    part = control_step.measure(seconds=20.0, frames=50, hours=0.005)
    found = {figure.key: figure.value for figure in part.figures}
    assert 0.0 < found["step_p50_us"] <= found["step_p99_us"] <= found["step_max_us"]
    assert abs(found["growth_blocks"]) < control_step.GROWTH_BLOCKS


def test_a_step_that_keeps_something_is_seen(monkeypatch):
    step, kept = control_step.Step(20.0), []
    assert control_step.growth(step, 2000) < control_step.GROWTH_BLOCKS
    at = step.controller.step
    monkeypatch.setattr(step.controller, "step", lambda *given: kept.append(at(*given)))
    assert control_step.growth(step, 4000) > 2.0 * control_step.GROWTH_BLOCKS


def test_every_driver_is_in_the_picture(tmp_path):
    course = Course(name="short", seconds=25.0, setpoints=(SetpointRow(at_s=10.0, to=1.3),))
    run = Run("factory", PLANT, 1, (course,), Models(MODEL, MODEL, MODEL), ControlSettings())
    one = driven(np.full(500, 1.02), np.where(np.arange(500) < 200, 1.0, 1.3))
    run.drives = {name: {"short": one} for name in DRIVERS}
    assert picture.draw(run, tmp_path / "courses.png").stat().st_size > 10_000
    assert len({kind.colour for kind in DRIVERS.values()}) == len(DRIVERS)
