"""Drives the machine of a trial over its course and writes down what the sensors show, at 20 Hz."""

from math import cos, pi
from typing import Final

import numpy as np
from msgspec.structs import replace

from cruise.plant import Combine, Inputs
from cruise.plant import engine as engines
from cruise.plant.engine import RADPS_PER_RPM, EngineSettings
from cruise.plant.line import PA_PER_BAR
from cruise.plant.pump import displacement_m3_per_rad
from cruise.plant.vehicle import GRAVITY_MPS2

from . import course as courses
from . import effects, machine
from .course import Course, FloatArray
from .machine import STEPS, Machine
from .trial import NOISE_MPS, PERIOD_S, Trial

STREAM: Final = 3
EXPERIMENT_STREAM: Final = 5
SLOW: Final = 20  # samples between two values of oil temperature and mass: 1 s
RADIUS_EVERY: Final = 10  # samples between two changes of the wheels' radius, where it changes

Columns = dict[str, FloatArray]


def simulate(trial: Trial, experiment: Course | None = None) -> Columns:
    """The recording of a trial, or of an experiment with its machine: name to values of 20 Hz (N,), `time_s` first."""
    course = courses.draw(trial)
    driven = made(trial, course)
    if experiment is not None:
        settings, course = driven.settings, experiment
        driven = made(trial, course)
        driven.settings = (
            settings  # the recording's machine, where a size is in relation to what the recording asks of it
        )
    truth = _drive(driven, course, trial.seed)
    rpm, load_pct = (truth["rpm"], truth["load_pct"]) if driven.one_engine else _other_engine(driven, course, truth)
    noise = trial.rng(STREAM if experiment is None else EXPERIMENT_STREAM)
    shown = _sensors(trial, noise, driven, course, truth, rpm, load_pct)
    return {name: values for name, values in shown.items() if name not in driven.unrecorded}


def made(trial: Trial, course: Course) -> Machine:
    """The machine of a trial with its effects, as it feels a course."""
    driven = machine.base(trial, course)
    effects.make(driven, course, trial)
    return driven


def _drive(driven: Machine, course: Course, seed: int) -> Columns:
    """The machine's true state at the end of each sample."""
    combine = Combine(driven.settings, seed)
    state, rows = combine.state, []
    radius_m, radius_shares = driven.settings.transmission.wheel_radius_m, driven.wheel_radius_share.tolist()
    ripple_n, ripple_per_m = driven.ripple_n, 2.0 * pi / driven.ripple_wave_m
    columns = (
        course.time_s,
        course.current_ma,
        driven.felt_rpm,
        course.gear,
        driven.felt_grade_deg,
        driven.rolling_resistance,
        course.crop_kw,
        driven.implement_drag_n,
        driven.pull_n,
        course.oil_c,
        driven.felt_grain_kg,
    )
    for k, (time_s, current, rpm, gear, grade, rolling, crop, drag, pull, oil_c, grain_kg) in enumerate(
        zip(*(column.tolist() for column in columns), strict=True)
    ):
        if k % RADIUS_EVERY == 0 and radius_shares[k] != radius_shares[k - RADIUS_EVERY]:
            transmission = replace(driven.settings.transmission, wheel_radius_m=radius_m * radius_shares[k])
            combine.change(replace(driven.settings, transmission=transmission))
        state.oil_temperature_c, state.grain_kg = oil_c, grain_kg
        if ripple_n:
            pull += ripple_n * cos(ripple_per_m * state.travel_m)
        inputs = Inputs(
            pump_current_ma=current,
            engine_speed_setpoint_rpm=rpm,
            gear=gear,
            grade_deg=grade,
            rolling_resistance=rolling,
            crop_power_kw=crop,
            implement_drag_n=drag,
            pull_n=pull,
        )
        combine.advance(inputs, time_s)
        rows.append(
            (
                state.coil_current_ma,
                state.ground_speed_mps,
                state.wheel_speed_mps,
                state.engine_speed_radps / RADPS_PER_RPM,
                state.engine_load_pct,
                state.swash,
                state.line_pressure_pa,
            )
        )
    names = ("current_ma", "speed_mps", "wheel_mps", "rpm", "load_pct", "swash", "pressure_pa")
    return dict(zip(names, np.array(rows).T, strict=True))


def _other_engine(driven: Machine, course: Course, truth: Columns) -> tuple[FloatArray, FloatArray]:
    """Speed [rpm] and load [%] of an engine that carries the load of drive and crop but turns no pump."""
    engine = EngineSettings()
    pump = driven.settings.pump
    torque_nm = displacement_m3_per_rad(pump) * pump.speed_ratio * truth["swash"] * truth["pressure_pa"]
    speed = engine.rated_speed_rpm * RADPS_PER_RPM
    torque = governor = engines.machine_torque_nm(engine, 0.0, speed)
    rows = []
    for rpm, crop_kw, drive_nm in zip(
        driven.shown_rpm.tolist(), course.crop_kw.tolist(), torque_nm.tolist(), strict=True
    ):
        load_nm = drive_nm + engines.machine_torque_nm(engine, crop_kw, speed)
        load_pct = 0.0
        for _ in range(STEPS):
            speed, torque, governor, load_pct = engines.advance(
                engine, speed, torque, governor, rpm, load_nm, PERIOD_S / STEPS
            )
        rows.append((speed / RADPS_PER_RPM, load_pct))
    shown = np.array(rows).T
    return shown[0], shown[1]


def _sensors(
    trial: Trial,
    rng: np.random.Generator,
    driven: Machine,
    course: Course,
    truth: Columns,
    rpm: FloatArray,
    load_pct: FloatArray,
) -> Columns:
    """What is measured of the truth, with the noise of the plant's sensors [unit of each name]."""
    count = len(course.time_s)

    def noisy(values: FloatArray, deviation: float) -> FloatArray:
        return values + rng.normal(0.0, deviation, count)

    def slow(values: FloatArray) -> FloatArray:
        return np.repeat(values[::SLOW], SLOW)[:count]

    speed_mps = truth["speed_mps"]
    acceleration_mps2 = np.diff(speed_mps, prepend=0.0) / PERIOD_S
    felt_deg = np.degrees(np.arctan(acceleration_mps2 / GRAVITY_MPS2))
    # A rolling radius is less under load: the wheels seem to turn up to 1 % faster with a full bin, slip or not.
    radius = 1.0 + 0.01 * course.grain_kg / courses.GRAIN_KG
    return {
        "time_s": course.time_s,
        "pump_current_ma": noisy(truth["current_ma"], 1.0),
        "ground_speed_mps": noisy(speed_mps + driven.bias_mps, NOISE_MPS[trial.tier]),
        "wheel_speed_mps": noisy(truth["wheel_mps"] * radius, 0.008),
        "engine_speed_rpm": noisy(rpm, 2.0),
        "gear": course.gear.astype(float),
        "pitch_deg": noisy(driven.shown_grade_deg + felt_deg, 0.25),
        "machine_mass_kg": slow(noisy(driven.settings.vehicle.mass_kg + course.grain_kg, 50.0)),
        "oil_temperature_c": slow(noisy(course.oil_c, 0.2)),
        "engine_load_pct": noisy(load_pct, 0.8).clip(0.0, 125.0),
        "line_pressure_bar": noisy(truth["pressure_pa"] / PA_PER_BAR, 1.5),
        "header_height_mm": noisy(course.header_mm, 3.0),
        "tyre_pressure_bar": noisy(course.tyre_bar, 0.01),
    }
