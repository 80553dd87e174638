"""The machine on its wheels: driveline, tyres, rolling resistance, slope, brake.

    m_e dv/dt = limit(a p - F_c t) - (beta m g cos alpha + F_b + F_i) t - m g sin alpha - F_w - d v
    q         = a (v_wheel + c |v|^e v),   v_wheel = v + slip,   a = D i / r,   m_e = m + J (i / r)^2,   t = sign(v)

v ground speed [m/s], p line pressure [Pa], a displacement per travel [m3/m], D motor displacement [m3/rad], i turns of
the motor per turn of the wheels [-], r rolling radius [m], m mass [kg], J inertia of the motor's shaft [kg m2], beta
rolling resistance coefficient [-], F_c friction of the driveline [N], F_b brake [N], F_i resistance of an implement
[N], F_w pull from outside [N], alpha slope [rad], d viscous drag [N s/m], c share of the flow that the motor loses at
1 m/s [-], e its exponent [-]. Dry friction holds the machine at standstill as long as it can. With the gear in neutral
or the clutch pressed the motor turns freely: J dw/dt = D p - T_c sign(w) - k w, k its drag [N m s].

Source: the paper, equations 1, 2, 8 and 9; W.E. Wilson, Positive-displacement pumps and fluid motors (1950), for the
restriction loss; ASAE D497 (rolling resistance 0.02 on concrete to 0.12 on soft soil); data sheets of fixed axial
piston motors.
"""

from dataclasses import dataclass
from math import copysign, cos, pi, radians, sin
from typing import Annotated

from msgspec import Meta, Struct

from cruise.plant import tyre
from cruise.plant.bounds import NotNegative, Positive, Share
from cruise.plant.line import LoadRate

GRAVITY_MPS2 = 9.80665
LOSS_AT_RADPS = 100.0 * pi  # 3000 rpm, the speed for which the share of the motor's speed loss stands


class TransmissionSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Motor and gears."""

    motor_displacement_cm3: Positive = 105.0  # per revolution, fixed: 75..130
    # Motor over wheel: full pump flow at 2100 rpm gives 1.4, 2.5, 4.4 and 7.8 m/s (5, 9, 16 and 28 km/h, hydrostatic
    # combines with four gears; the paper's 2nd gear is for harvesting); each +-20 %.
    gear_ratio: tuple[float, ...] = (176.0, 98.6, 56.0, 31.6)
    wheel_radius_m: Positive = 0.9  # rolling radius of 800/65 R32: 0.88; 0.8..1.0
    shaft_inertia_kgm2: Positive = 0.08  # motor 0.02 and the gearbox's input: 0.03..0.2
    shaft_friction_nm: NotNegative = 5.0  # 1..10
    shaft_drag_nms: NotNegative = 0.05  # 0.01..0.1
    # Flow that the motor lets through at 3000 rpm without turning for it (restriction of its ports), and how it grows.
    speed_loss_share: NotNegative = 0.0  # of its displacement: 0..0.1, good motors hardly any
    speed_loss_exponent: Annotated[float, Meta(ge=0.5, le=4)] = 1.5  # of the shaft's speed: 1..3
    driveline_friction_n: NotNegative = 1500.0  # gears and final drives at the tread, 4 % of 40 kN: 500..3000


class VehicleSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mass, resistances and brake."""

    mass_kg: Positive = 15700.0  # empty bin; the paper loads it to 17200 and 18800
    bin_capacity_kg: NotNegative = 6700.0  # 9000 l of wheat at 0.75 kg/l: 4000..9000
    driven_axle_share: Share = 0.68  # of the weight, with a header: 0.6..0.8
    viscous_drag_n_per_mps: NotNegative = 300.0  # tyres' and gears' speed dependence: 100..800
    brake_force_n: NotNegative = 60000.0  # service brake, 3.5 m/s2 empty: 40e3..80e3
    slip_scale: NotNegative = 1.0  # of Brixius' slip


@dataclass(frozen=True, slots=True)
class Wheels:
    """The machine as the motor's load."""

    inertia: float
    dry_friction: float
    displacement_m3pm: float
    driveline_friction_n: float
    slope_n: float
    drag_n_per_mps: float
    speed_loss: float
    speed_loss_exponent: float
    greatest_traction_n: float
    slip_scale: float

    def rate(self, pressure_pa: float, speed: float, direction: float) -> LoadRate:
        """Oil that the wheels take [m3/s], force on the machine [N] and their derivatives."""
        a, greatest_n = self.displacement_m3pm, self.greatest_traction_n
        shaft_friction_n = self.driveline_friction_n * direction
        traction_n = a * pressure_pa - shaft_friction_n
        slip, slip_by_use, slip_by_speed = tyre.slip_speed_mps(traction_n / greatest_n, speed)
        traction_by_pressure = a
        if abs(traction_n) > greatest_n:
            traction_n = copysign(greatest_n, traction_n)
            traction_by_pressure = 0.0
        slip_flow = a * self.slip_scale
        resistance_n = self.dry_friction * direction - shaft_friction_n
        lost = self.speed_loss * abs(speed) ** self.speed_loss_exponent if self.speed_loss else 0.0
        return LoadRate(
            a * speed * (1.0 + lost) + slip_flow * slip,
            traction_n - resistance_n - self.slope_n - self.drag_n_per_mps * speed,
            slip_flow * slip_by_use * a / greatest_n,
            a * (1.0 + lost * (1.0 + self.speed_loss_exponent)) + slip_flow * slip_by_speed,
            traction_by_pressure,
            -self.drag_n_per_mps,
        )

    def wheel_speed_mps(self, pressure_pa: float, speed_mps: float) -> float:
        """Speed at the circumference of the driven wheels [m/s]."""
        traction_n = self.displacement_m3pm * pressure_pa
        if traction_n == 0.0:
            return speed_mps
        if speed_mps != 0.0:
            traction_n -= copysign(self.driveline_friction_n, speed_mps)
        slip_mps, _, _ = tyre.slip_speed_mps(traction_n / self.greatest_traction_n, speed_mps)
        return speed_mps + self.slip_scale * slip_mps


@dataclass(frozen=True, slots=True)
class Shaft:
    """The motor's shaft as its own load, while nothing couples it to the wheels."""

    inertia: float
    dry_friction: float
    displacement_m3_per_rad: float
    drag_nms: float

    def rate(self, pressure_pa: float, speed: float, direction: float) -> LoadRate:
        """Oil that the shaft takes [m3/s], torque on it [N m] and their derivatives."""
        displacement = self.displacement_m3_per_rad
        torque_nm = displacement * pressure_pa - self.dry_friction * direction - self.drag_nms * speed
        return LoadRate(displacement * speed, torque_nm, 0.0, displacement, displacement, -self.drag_nms)


def motor_displacement_m3_per_rad(settings: TransmissionSettings) -> float:
    """Displacement D of the motor [m3/rad]."""
    return settings.motor_displacement_cm3 * 1e-6 / (2.0 * pi)


def shaft_per_travel_radpm(settings: TransmissionSettings, gear: int, clutch: bool) -> float:
    """Turns of the motor's shaft per travel of the machine [rad/m], 0 while they are not coupled."""
    if gear == 0 or clutch:
        return 0.0
    if not 1 <= gear <= len(settings.gear_ratio):
        raise ValueError(f"gear {gear}: the transmission has 0 (neutral) to {len(settings.gear_ratio)}")
    return settings.gear_ratio[gear - 1] / settings.wheel_radius_m


def wheels(
    vehicle: VehicleSettings,
    transmission: TransmissionSettings,
    shaft_per_travel_radpm: float,
    mass_kg: float,
    grade_deg: float,
    rolling_resistance: float,
    brake: float,
    implement_drag_n: float = 0.0,
    pull_n: float = 0.0,
) -> Wheels:
    """The machine as a load, for its mass, its coupling to the motor, the ground, the brake pedal [0..1] and forces."""
    slope_rad = radians(grade_deg)
    exponent = transmission.speed_loss_exponent
    weight_n = mass_kg * GRAVITY_MPS2
    normal_n = weight_n * cos(slope_rad)
    return Wheels(
        inertia=mass_kg + transmission.shaft_inertia_kgm2 * shaft_per_travel_radpm**2,
        displacement_m3pm=motor_displacement_m3_per_rad(transmission) * shaft_per_travel_radpm,
        dry_friction=rolling_resistance * normal_n
        + brake * vehicle.brake_force_n
        + implement_drag_n
        + transmission.driveline_friction_n,
        driveline_friction_n=transmission.driveline_friction_n,
        slope_n=weight_n * sin(slope_rad) + pull_n,
        drag_n_per_mps=vehicle.viscous_drag_n_per_mps,
        speed_loss=transmission.speed_loss_share * (shaft_per_travel_radpm / LOSS_AT_RADPS) ** exponent,
        speed_loss_exponent=exponent,
        greatest_traction_n=tyre.greatest_traction(rolling_resistance) * vehicle.driven_axle_share * normal_n,
        slip_scale=vehicle.slip_scale,
    )


def shaft(transmission: TransmissionSettings) -> Shaft:
    """The uncoupled motor as a load."""
    return Shaft(
        inertia=transmission.shaft_inertia_kgm2,
        dry_friction=transmission.shaft_friction_nm,
        displacement_m3_per_rad=motor_displacement_m3_per_rad(transmission),
        drag_nms=transmission.shaft_drag_nms,
    )
