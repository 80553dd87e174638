"""How the virtual combine makes each effect of the design's table, and how large small, medium and large are.

Sizes are physical. The forms are the plant's, so other ones than the model's, and their shapes (exponents, edges,
asymmetries) are drawn from the seed. `cannot` says what the combine can't make as an effect of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from cruise.plant import PlantSettings
from cruise.plant.engine import EngineSettings
from cruise.plant.vehicle import GRAVITY_MPS2

from .course import FULL_MA, RATED_RPM, Course, held, smooth
from .machine import Machine
from .trial import Tier, Trial

Rng = np.random.Generator
Make = Callable[[Machine, Course, float, Rng], None]
SOIL: Final = 0.01  # coefficient of rolling resistance by which the soil of the field tier varies: stubble +-30 %
STIFF_LPM: Final = 0.2  # leakage at 100 bar of a drive that hardly feels a force; new machines leak 2
STIFF_BAR: Final = 1e6  # bulk modulus
TOP_SPEED_MPS: Final = 3.7  # of the base machine at full current
SLOW_SERVO: Final = 2.5  # lag over that of the base machine
STREAM: Final = 100  # of the first effect's shape; each has its own


@dataclass(frozen=True)
class Row:
    """One effect: what makes it, what its size is, and the ranges from which small, medium and large are drawn.

    In the clean tier, the free-run error of a linear model at 20 Hz, 0.010 m/s without an effect, grows by about 1.1 to
    1.3 (small), 1.35 to 2 (medium) and 2.2 to 4 (large), for saturation, rate_limit and power_limit by half to twice
    that from seed to seed. Means over 0.2 s, whose noise is half, see twice as much of it.
    """

    make: Make
    unit: str
    small: tuple[float, float]
    medium: tuple[float, float]
    large: tuple[float, float]
    note: str
    behind: Make | None = None  # what makes it as a part of the background, where it can be one
    signals: tuple[str, ...] = ()  # columns that show what drives it, for unlisted effects
    apart: tuple[str, ...] = ()  # effects that can't be in the same recording
    field: float = 3.0  # sizes of the field tier over those of the clean tier: noise and soil hide more


def change(machine: Machine, part: str, **values: Any) -> None:
    """Other parameters in one part of the plant's settings."""
    settings: PlantSettings = machine.settings
    machine.settings = replace(settings, **{part: replace(getattr(settings, part), **values)})


def _stiffen(machine: Machine, leakage_lpm: float = 0.0) -> None:
    """A drive that hardly feels a force beyond its leakage at 100 bar.

    Its oil is stiff, or the line would ring, and its servo slow, or the wheels would skid.
    """
    change(machine, "line", leakage_lpm_per_100bar=STIFF_LPM + leakage_lpm)
    change(machine, "oil", bulk_modulus_bar=STIFF_BAR)
    change(machine, "pump", servo_lag_s=SLOW_SERVO * machine.settings.pump.servo_lag_s)


def _dead_zone(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", dead_zone=1.0)
    change(machine, "pump", threshold_ma=size, threshold_edge_ma=rng.uniform(0.02, 0.08) * size)


def _saturation(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", saturation=1.0)
    change(machine, "pump", stop=max(1.0 - size, 0.05))


def _quadratic_gain(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", quadratic_gain=1.0)
    change(machine, "pump", bridge_share=min(size, 1.0), bridge_opening=rng.uniform(0.5, 0.9))


def _hysteresis(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", hysteresis=1.0)
    change(machine, "hysteresis", half_width_ma=size, shape=rng.uniform(0.5, 1.0))


def _rate_limit(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    if size > 0.0:
        change(machine, "effects", rate_limit=1.0)
        change(machine, "pump", stroke_rate_per_s=1.0 / size, return_rate_per_s=rng.uniform(1.0, 1.6) / size)


def _engine_speed(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.one_engine = True
    change(machine, "engine", **_real_engine())
    machine.felt_rpm = RATED_RPM + size * (course.rpm - RATED_RPM)


def _engine_droop(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.one_engine = True
    change(machine, "effects", engine_droop=1.0)
    change(machine, "engine", **_real_engine(3.0), droop_share=size)
    machine.unrecorded.add("engine_speed_rpm")


def _power_limit(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    # A stiff drive, so that slope and weight are felt through the power control alone.
    _stiffen(machine)
    rolling = rng.uniform(0.03, 0.06)
    machine.felt_grade_deg = machine.shown_grade_deg = course.grade_deg
    machine.felt_grain_kg = course.grain_kg
    machine.rolling_resistance = machine.rolling_resistance + rolling
    if size > 0.0:
        weight_n = GRAVITY_MPS2 * (machine.settings.vehicle.mass_kg + course.grain_kg)
        speed_mps = TOP_SPEED_MPS * smooth(course.current_ma / FULL_MA, machine.settings.pump.servo_lag_s)
        demand_w = weight_n * (np.sin(np.radians(course.grade_deg)) + rolling) * speed_mps
        change(machine, "effects", power_limit=1.0)
        change(machine, "engine", torque_scale=1e6)
        change(machine, "pump", power_kw=1e-3 * float(np.quantile(demand_w, 0.98)) / size)


def _real_engine(scale: float = 1.0) -> dict[str, float]:
    real = EngineSettings()
    return {
        "inertia_kgm2": scale * real.inertia_kgm2,
        "governor_gain_nm_per_radps": scale * real.governor_gain_nm_per_radps,
        "governor_integral_nm_per_rad": scale * real.governor_integral_nm_per_rad,
        "drag_torque_nm": scale * real.drag_torque_nm,
    }


def _gear_ratio(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", gear_ratio=size)


def _oil_temperature(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", oil_temperature=1.0)
    change(machine, "line", leakage_thinning=size)


def _speed_droop(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "transmission", speed_loss_share=size, speed_loss_exponent=rng.uniform(0.8, 2.2))


def _engine_speed_share(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    # A small part of what the shown engine does: the share stands in for a small departure of its set speed.
    machine.felt_rpm = RATED_RPM + size * (course.rpm - RATED_RPM)


def _grade_share(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.felt_grade_deg = size * course.grade_deg


def _grade(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.felt_grade_deg = machine.shown_grade_deg = size * course.grade_deg


def _rolling_resistance(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    mass_kg = machine.settings.vehicle.mass_kg
    machine.rolling_resistance = machine.rolling_resistance + size * (1.0 + course.grain_kg / mass_kg)


def _crop_load(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    exponent = rng.uniform(0.85, 1.2)
    machine.implement_drag_n = machine.implement_drag_n + size * 50.0 * (course.crop_kw / 50.0) ** exponent


def _coulomb_friction(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", coulomb_friction=1.0)
    change(machine, "transmission", driveline_friction_n=size)


def _leakage(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    _stiffen(machine, size)
    machine.pull_n = machine.pull_n + 9000.0 * course.soil


def _active_braking(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    # While the wheels drive the pump, oil passes a valve past it: the machine brakes, but less than it drives.
    if size > 0.0:
        change(machine, "effects", relief_valve=1.0)
        change(machine, "line", relief_bar=1e4, braking_relief_bar=rng.uniform(2.0, 10.0))
        change(machine, "line", relief_gradient_lpm_per_bar=size)


def _resonance(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", compressibility=1.0, entrained_air=1.0)
    change(machine, "line", volume_l=size)
    change(machine, "oil", free_air_share=rng.uniform(0.002, 0.01))


def _sensor_bias(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.bias_mps = machine.bias_mps + size * held(
        rng, course.time_s, -1.7, 1.7, (60.0, 160.0), rng.uniform(1.0, 30.0)
    )


def _wheel_slip(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    change(machine, "effects", wheel_slip=1.0)
    change(machine, "vehicle", slip_scale=size)


EFFECTS: Final[dict[str, Row]] = {
    "dead_zone": Row(_dead_zone, "mA", (4, 8), (8.5, 17), (19, 38), "threshold of the spool, smooth edge", _dead_zone),
    "saturation": Row(
        _saturation,
        "-",
        (0.02, 0.035),
        (0.04, 0.065),
        (0.075, 0.13),
        "stroke that the stop cuts off",
        _saturation,
        field=5.0,
    ),
    "quadratic_gain": Row(
        _quadratic_gain, "-", (0.02, 0.042), (0.045, 0.09), (0.1, 0.2), "share of the half bridge", _quadratic_gain
    ),
    "hysteresis": Row(
        _hysteresis, "mA", (2.2, 4.4), (4.7, 9), (10, 21), "half width of the Bouc-Wen loop", _hysteresis
    ),
    "rate_limit": Row(
        _rate_limit, "s", (0.28, 0.42), (0.44, 0.68), (0.74, 1.2), "from neutral to full stroke", _rate_limit, field=6.0
    ),
    "engine_speed": Row(
        _engine_speed,
        "-",
        (0.045, 0.09),
        (0.093, 0.2),
        (0.22, 0.47),
        "departures of the set speed down to 1650 rpm",
        _engine_speed_share,
        apart=("engine_droop",),
    ),
    "engine_droop": Row(
        _engine_droop,
        "-",
        (0.018, 0.034),
        (0.036, 0.07),
        (0.08, 0.16),
        "droop between no and full load; set speed constant, speed not recorded: else it is engine_speed",
        apart=("engine_speed",),
    ),
    "power_limit": Row(
        _power_limit,
        "-",
        (0.65, 0.72),
        (0.75, 0.85),
        (0.9, 1.1),
        "power asked for in 2 % of the time over the pump's; a stiff drive, which feels slope and mass so alone",
        apart=("leakage", "grade", "rolling_resistance", "coulomb_friction", "crop_load"),
        field=1.1,
    ),
    "gear_ratio": Row(
        _gear_ratio, "-", (0.006, 0.012), (0.013, 0.026), (0.03, 0.06), "power of the ratio to the 2nd", _gear_ratio
    ),
    "oil_temperature": Row(
        _oil_temperature,
        "-",
        (0.08, 0.15),
        (0.16, 0.31),
        (0.35, 0.72),
        "power of viscosity in the leakage",
        _oil_temperature,
    ),
    "speed_droop": Row(
        _speed_droop,
        "-",
        (0.025, 0.05),
        (0.056, 0.12),
        (0.14, 0.36),
        "flow lost at 3000 rpm, power 0.8..2.2",
        _speed_droop,
    ),
    "grade": Row(_grade, "-", (0.04, 0.08), (0.085, 0.17), (0.19, 0.38), "slopes up to 5 degrees", _grade_share),
    "rolling_resistance": Row(
        _rolling_resistance,
        "-",
        (0.0045, 0.008),
        (0.0085, 0.0165),
        (0.0185, 0.037),
        "follows the mass in the bin",
        _rolling_resistance,
    ),
    "crop_load": Row(
        _crop_load, "N/kW", (7.5, 14), (14.5, 28), (32, 62), "push of the header through the crop", _crop_load
    ),
    "coulomb_friction": Row(
        _coulomb_friction,
        "N",
        (800, 1500),
        (1600, 3200),
        (3500, 7200),
        "dry friction of the driveline",
        _coulomb_friction,
    ),
    "leakage": Row(
        _leakage,
        "l/min",
        (1.2, 2.3),
        (2.5, 5),
        (5.6, 11.5),
        "at 100 bar, of a stiff drive; soil pulls with up to 9 kN, which only the pressure shows",
        apart=("power_limit",),
    ),
    "active_braking": Row(
        _active_braking,
        "l/min bar",
        (0.02, 0.035),
        (0.037, 0.083),
        (0.095, 0.215),
        "what a valve lets pass beyond 2 to 10 bar while the wheels drive the pump",
        _active_braking,
        field=20.0,
    ),
    "resonance": Row(
        _resonance, "l", (2.7, 3.8), (3.9, 5.4), (5.8, 9), "oil column with hoses and tyres", _resonance, field=5.0
    ),
    "sensor_bias": Row(
        _sensor_bias,
        "m/s",
        (0.006, 0.011),
        (0.012, 0.021),
        (0.024, 0.045),
        "deviation of a zero that shifts",
        _sensor_bias,
    ),
    "wheel_slip": Row(
        _wheel_slip, "-", (0.6, 1.25), (1.35, 3), (3.3, 9.8), "times Brixius' slip on hard ground", _wheel_slip
    ),
}
"""What the combine can make as an effect of its own, by the names of the design."""

CANNOT: Final[dict[str, str]] = {
    "transport_delay": "the base machine has one and every core fits it: a constant dead time is never missing",
}
"""Names of the design that are no effect beyond a base machine."""


def _header(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    # A header that is carried low drags on the ground, the more the lower.
    low = (1.0 - (course.header_mm / 700.0).clip(0.0, 1.0)) ** rng.uniform(1.0, 2.0)
    machine.implement_drag_n = machine.implement_drag_n + size * low


def _tyres(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.wheel_radius_share = 1.0 + size * (course.tyre_bar - 1.8)


def _ripple(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.ripple_n, machine.ripple_wave_m = size, rng.uniform(3.5, 6.5)


def _wind(machine: Machine, course: Course, size: float, rng: Rng) -> None:
    machine.pull_n = machine.pull_n + size * course.wind


UNLISTED: Final[dict[str, Row]] = {
    "header_drag": Row(
        _header, "N", (950, 1850), (1950, 3800), (4300, 8600), "header on the ground", signals=("header_height_mm",)
    ),
    "tyre_pressure": Row(
        _tyres, "1/bar", (0.02, 0.038), (0.04, 0.083), (0.093, 0.19), "rolling radius", signals=("tyre_pressure_bar",)
    ),
    "gearbox_ripple": Row(_ripple, "N", (450, 900), (950, 1850), (2100, 4150), "once in 3.5 to 6.5 m, on no sensor"),
    "wind": Row(_wind, "N", (650, 1350), (1450, 2700), (3050, 6000), "gusts, on no sensor"),
}
"""Effects that are in nobody's table."""


def apart(one: str, other: str) -> bool:
    """Whether two effects can't be in the same recording."""
    rows = EFFECTS | UNLISTED
    return other in rows[one].apart or one in rows[other].apart


def ranges(row: Row, size: str, tier: Tier) -> tuple[float, float]:
    """Least and greatest physical size that is called small, medium or large in a tier."""
    scale = row.field if tier == "field" else 1.0
    low, high = getattr(row, size)
    return scale * low, scale * high


def make(machine: Machine, course: Course, trial: Trial) -> None:
    """Put a trial's effects into its base machine, after the background that it has."""
    order, named = [*EFFECTS, *UNLISTED], {present.effect for present in (*trial.effects, *trial.unlisted)}
    for name, row in EFFECTS.items():
        if trial.background and row.behind and name not in named:
            low, high = ranges(row, "medium", trial.tier)
            size = trial.background * float(np.sqrt(low * high))
            row.behind(machine, course, size, trial.rng(STREAM + order.index(name)))
    if trial.tier == "field":
        machine.rolling_resistance = machine.rolling_resistance + SOIL * (1.0 + course.soil)
    for present in (*trial.effects, *trial.unlisted):
        row = (EFFECTS | UNLISTED)[present.effect]
        row.make(machine, course, present.size, trial.rng(STREAM + order.index(present.effect)))
