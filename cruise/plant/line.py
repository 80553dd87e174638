"""The transmission line: oil between pump and motor, its leakage, its relief valves and the load that the motor turns.

    V / K(p) dp/dt = Q - q(p, v) - G p - Q_relief(p),    G = G_50 (nu_50 / nu)^e
    M dv/dt        = f(p, v)

p pressure difference of the two lines [Pa], Q pump flow [m3/s], V volume of one line with the compliance of hoses and
tyres [m3], K bulk modulus [Pa], G leakage of pump and motor [m3/(s Pa)], nu
viscosity, e = 1 for laminar gaps; v speed of the load [m/s or rad/s], q flow
that its motor takes [m3/s], f force or torque on it, M its inertia [kg or kg m2]. The stiffness K a^2 / V, a
displacement per travel, against the mass of the machine gives the 1 to 2 Hz bump of the paper's frequency response.

The pair is stiff at an open relief valve and with little oil: one step of the two-stage Rosenbrock method of second
order, L-stable (gamma = 1 - 1/sqrt 2). What switches (valve, dry friction) is decided once per step, so that within a
step the equations are smooth and nothing chatters; where much happens at once the step is halved. K is that of the
step's start, which leaves first order in the part of the compliance that is air.

Source: H.E. Merritt, Hydraulic Control Systems (1967), ch. 4; J.G. Verwer et al., SIAM J. Sci. Comput. 20 (1999)
1456-1480 (the method); the paper, section II.B and figure 2.
"""

from dataclasses import dataclass
from math import copysign, sqrt
from typing import NamedTuple, Protocol, Self

from msgspec import Struct

from cruise.plant.bounds import NotNegative, Positive
from cruise.plant.oil import ATMOSPHERE_PA, Oil

GAMMA = 1.0 - 1.0 / sqrt(2.0)
PA_PER_BAR = 1e5
SMALLEST_VOLUME_L = 0.2  # ports, pistons and hose ends; then the line's own frequency in 2nd gear is above 4 Hz
LARGEST_CHANGE_PA = 50e5  # within one step: several times what driving brings about
SHORTEST_STEP_S = 5e-4
M3PS_PER_LPM = 1e-3 / 60.0


class LineSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Oil column, leakage and valves."""

    volume_l: NotNegative = 2.7  # 2 m of 1 1/4 inch hose, ports and pistons, and the tyres' wind-up as oil: 1.5..6
    charge_pressure_bar: Positive = 25.0  # closed circuits: 18..30
    leakage_lpm_per_100bar: NotNegative = 2.5  # pump and motor at 50 degC, 97 % at 300 bar: 2..12 with wear
    leakage_thinning: NotNegative = 1.0  # exponent: 1 leaks as laminar gaps do, 0 regardless of viscosity; 0.7..1
    relief_bar: Positive = 400.0  # closed circuits of this class: 350..450
    braking_relief_bar: Positive = 300.0  # while the wheels drive the pump: 150..450
    relief_gradient_lpm_per_bar: Positive = 15.0  # full flow at 5 % above the setting: 5..30


class LoadRate(NamedTuple):
    """What the load takes at a pressure and a speed, with the derivatives of both to pressure and speed."""

    flow: float
    force: float
    flow_by_pressure: float
    flow_by_speed: float
    force_by_pressure: float
    force_by_speed: float


class Load(Protocol):
    """What a motor turns: the wheels of the machine, or its own free shaft.

    `rate` takes the direction of the dry friction: -1 or 1 while sliding, 0 for none.
    """

    @property
    def inertia(self) -> float: ...

    @property
    def dry_friction(self) -> float: ...

    def rate(self, pressure_pa: float, speed: float, direction: float) -> LoadRate: ...


class LineStep(NamedTuple):
    """Pressure and speed after a step, and the power that the line turns into heat there."""

    pressure_pa: float
    speed: float
    loss_w: float


@dataclass(frozen=True, slots=True)
class Line:
    """The line with its constants in SI units."""

    oil: Oil
    volume_m3: float
    low_side_pa: float
    leakage_50c: float
    viscosity_50c_mm2ps: float
    leakage_thinning: float
    relief_pa: float
    braking_relief_pa: float
    relief_gradient: float

    @classmethod
    def of(cls, settings: LineSettings, oil: Oil) -> Self:
        """The line filled with an oil."""
        return cls(
            oil=oil,
            volume_m3=1e-3 * max(settings.volume_l, SMALLEST_VOLUME_L),
            low_side_pa=ATMOSPHERE_PA + settings.charge_pressure_bar * PA_PER_BAR,
            leakage_50c=settings.leakage_lpm_per_100bar * M3PS_PER_LPM / (100.0 * PA_PER_BAR),
            viscosity_50c_mm2ps=oil.viscosity_mm2ps(50.0),
            leakage_thinning=settings.leakage_thinning,
            relief_pa=settings.relief_bar * PA_PER_BAR,
            braking_relief_pa=settings.braking_relief_bar * PA_PER_BAR,
            relief_gradient=settings.relief_gradient_lpm_per_bar * M3PS_PER_LPM / PA_PER_BAR,
        )

    def leakage(self, temperature_c: float) -> float:
        """Leakage G [m3/(s Pa)] at an oil temperature [degC]."""
        thinner = self.viscosity_50c_mm2ps / self.oil.viscosity_mm2ps(temperature_c)
        return self.leakage_50c * thinner**self.leakage_thinning

    def capacity(self, pressure_pa: float) -> float:
        """Oil that the loaded line takes up per pressure, V / K [m3/Pa]."""
        return self.volume_m3 * self.oil.compliance_per_pa(self.low_side_pa + abs(pressure_pa))

    def advance(
        self, load: Load, pressure_pa: float, speed: float, flow_in: float, leakage: float, step_s: float
    ) -> LineStep:
        """Pressure and speed a time `step_s` later under a held pump flow [m3/s] and leakage [m3/(s Pa)].

        A step that changes the pressure much (a valve opens, the wheels spin) is taken as two of half its size.
        """
        reached = self._step(load, pressure_pa, speed, flow_in, leakage, step_s)
        if abs(reached.pressure_pa - pressure_pa) <= LARGEST_CHANGE_PA or step_s < SHORTEST_STEP_S:
            return reached
        halfway = self.advance(load, pressure_pa, speed, flow_in, leakage, 0.5 * step_s)
        reached = self.advance(load, halfway.pressure_pa, halfway.speed, flow_in, leakage, 0.5 * step_s)
        return LineStep(reached.pressure_pa, reached.speed, 0.5 * (halfway.loss_w + reached.loss_w))

    def _step(
        self, load: Load, pressure_pa: float, speed: float, flow_in: float, leakage: float, step_s: float
    ) -> LineStep:
        direction = sliding_direction(load, pressure_pa, speed)
        reached_pa, reached = self._solve(load, pressure_pa, speed, direction, flow_in, leakage, step_s)
        opening_pa = self.braking_relief_pa if reached_pa * speed < 0.0 else self.relief_pa
        spilled = 0.0
        if abs(reached_pa) > opening_pa:
            # The step that would end above the setting is solved again with the valve open throughout: its flow,
            # gradient (p - opening), is a further leakage beside a constant flow.
            gradient, opening_pa = self.relief_gradient, copysign(opening_pa, reached_pa)
            reached_pa, reached = self._solve(
                load, pressure_pa, speed, direction, flow_in + gradient * opening_pa, leakage + gradient, step_s
            )
            spilled = gradient * (reached_pa - opening_pa)
        loss_w = reached_pa * (leakage * reached_pa + spilled)
        return LineStep(reached_pa, stopped(reached, direction), max(loss_w, 0.0))

    def _solve(
        self,
        load: Load,
        pressure_pa: float,
        speed: float,
        direction: float,
        flow_in: float,
        leakage: float,
        step_s: float,
    ) -> tuple[float, float]:
        """One Rosenbrock step of pressure and speed without valves; a held load (direction 0) keeps its speed."""
        capacity = self.capacity(pressure_pa)
        inertia = load.inertia
        h = GAMMA * step_s

        taken, force, taken_by_pressure, taken_by_speed, force_by_pressure, force_by_speed = load.rate(
            pressure_pa, speed, direction
        )
        if direction == 0.0:
            force = force_by_pressure = force_by_speed = 0.0
        flow = flow_in - taken - leakage * pressure_pa
        # (M - h J) k = right-hand side, by Cramer's rule.
        a = capacity + h * (taken_by_pressure + leakage)
        b = h * taken_by_speed
        c = -h * force_by_pressure
        d = inertia - h * force_by_speed
        determinant = a * d - b * c
        first_pa = (flow * d - b * force) / determinant
        first = (a * force - c * flow) / determinant

        stage_pa = pressure_pa + step_s * first_pa
        stage = load.rate(stage_pa, speed + step_s * first, direction)
        force = stage.force - 2.0 * inertia * first if direction else 0.0
        flow = flow_in - stage.flow - leakage * stage_pa - 2.0 * capacity * first_pa
        second_pa = (flow * d - b * force) / determinant
        second = (a * force - c * flow) / determinant
        return (
            pressure_pa + step_s * (1.5 * first_pa + 0.5 * second_pa),
            speed + step_s * (1.5 * first + 0.5 * second),
        )


def coast(load: Load, speed: float, step_s: float) -> float:
    """Speed a time `step_s` later of a load that no motor turns, by the same method."""
    direction = sliding_direction(load, 0.0, speed)
    if direction == 0.0:
        return 0.0
    inertia = load.inertia
    rate = load.rate(0.0, speed, direction)
    diagonal = inertia - GAMMA * step_s * rate.force_by_speed
    first = rate.force / diagonal
    force = load.rate(0.0, speed + step_s * first, direction).force
    second = (force - 2.0 * inertia * first) / diagonal
    return stopped(speed + step_s * (1.5 * first + 0.5 * second), direction)


def sliding_direction(load: Load, pressure_pa: float, speed: float) -> float:
    """Direction of the dry friction in a step: 1 or -1 while sliding or breaking away, 0 while it holds the load."""
    if speed != 0.0:
        return 1.0 if speed > 0.0 else -1.0
    force = load.rate(pressure_pa, 0.0, 0.0).force
    return copysign(1.0, force) if abs(force) > load.dry_friction else 0.0


def stopped(speed: float, direction: float) -> float:
    """The speed after a step, at which dry friction, which never turns a motion around, may have ended it."""
    return speed if speed * direction > 0.0 else 0.0
