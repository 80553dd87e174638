"""The virtual combine: one machine, advanced in steps of a fixed time, that emits the readings of its sensors.

Each step goes down the drive: coil, delay, spool friction, swash, engine, oil line with what its motor turns, oil
temperature, grain. Each part is solved exactly or implicitly for what the part before was at the middle of the step.

Steps lie on a grid of `step_s` from zero: however `advance` is cut into calls, the same inputs on the same steps give
the same machine and the same readings.
"""

from collections import deque
from math import atan, degrees, floor

from cruise.plant import engine, hysteresis, line, oil, pump, sensors, solenoid, vehicle
from cruise.plant.engine import RADPS_PER_RPM
from cruise.plant.inputs import Inputs
from cruise.plant.line import M3PS_PER_LPM, PA_PER_BAR, Line
from cruise.plant.oil import Oil
from cruise.plant.road import Road
from cruise.plant.settings import PlantSettings, inputs_with_effects, with_effects
from cruise.plant.state import State, Truth
from cruise.plant.vehicle import GRAVITY_MPS2, Wheels
from cruise.signals import Reading

LONGEST_TRANSPORT_DELAY_S = 2.0
GRID_TOLERANCE = 1e-6  # share of a step by which `until_s` may miss a grid time through rounding


class Combine:
    """A combine harvester on its wheels, at standstill with a running engine at time zero."""

    def __init__(self, settings: PlantSettings, seed: int) -> None:
        self._seed = seed
        self._configure(settings)
        parameters = self._parameters
        rated_radps = parameters.engine.rated_speed_rpm * RADPS_PER_RPM
        torque_nm = engine.machine_torque_nm(parameters.engine, 0.0, rated_radps)
        entries = self._entries(LONGEST_TRANSPORT_DELAY_S)
        self.state = State(
            step=0,
            inputs=Inputs(pump_current_ma=0.0, gear=0),
            coil_current_ma=0.0,
            coil_history_ma=deque([0.0] * entries, maxlen=entries),
            spool_current_ma=0.0,
            spool_friction=0.0,
            swash=0.0,
            pump_flow_m3ps=0.0,
            line_pressure_pa=0.0,
            ground_speed_mps=0.0,
            travel_m=0.0,
            wheel_speed_mps=0.0,
            acceleration_mps2=0.0,
            shaft_speed_radps=0.0,
            shaft_per_travel_radpm=0.0,
            engine_speed_radps=rated_radps,
            engine_torque_nm=torque_nm,
            engine_load_pct=100.0 * torque_nm / engine.full_load_torque_nm(parameters.engine, rated_radps),
            governor_nm=torque_nm,
            oil_temperature_c=parameters.oil.start_temperature_c,
            grain_kg=0.0,
            history=deque(maxlen=self._entries(sensors.LONGEST_DELAY_S)),
            sensors=sensors.start(parameters.sensors, seed, 0.0),
        )
        history = self.state.history
        history.extend([self._shown()] * (history.maxlen or 0))

    def change(self, settings: PlantSettings) -> None:
        """Other parameters from now on; the state stays as it is. Raises ValueError for another step."""
        if settings.step_s != self._parameters.step_s:
            raise ValueError(f"step_s can't change under way: {self._parameters.step_s} s is the grid of the state")
        self._configure(settings)

    def advance(self, inputs: Inputs, until_s: float) -> list[Reading]:
        """Integrates to the last grid time not after `until_s` [s]; returns the readings that fell due, in time order.

        Raises ValueError for a gear that the transmission doesn't have.
        """
        parameters, state = self._parameters, self.state
        step_s = parameters.step_s
        state.inputs = inputs = inputs_with_effects(parameters, inputs)
        self._shift(vehicle.shaft_per_travel_radpm(parameters.transmission, inputs.gear, inputs.clutch))
        wheels = self._wheels()
        filling, rolling = inputs.grain_flow_kgps != 0.0, bool(self._road.waves)
        readings: list[Reading] = []
        for _ in range(floor(until_s / step_s + GRID_TOLERANCE) - state.step):
            if filling:
                self._fill(inputs.grain_flow_kgps * step_s)
            if filling or rolling:
                wheels = self._wheels()
            self._step(wheels)
            state.history.append(self._shown())
            sensors.sample(
                self._sensors,
                state.sensors,
                parameters.sensors.jitter_s,
                state.history,
                state.step * step_s,
                step_s,
                readings,
            )
        readings.sort(key=_time)
        return readings

    @property
    def truth(self) -> Truth:
        """The machine as it is now."""
        state = self.state
        return Truth(
            time_s=state.step * self._parameters.step_s,
            pump_current_ma=state.coil_current_ma,
            swash=state.swash,
            pump_flow_lpm=state.pump_flow_m3ps / M3PS_PER_LPM,
            line_pressure_bar=state.line_pressure_pa / PA_PER_BAR,
            ground_speed_mps=state.ground_speed_mps,
            acceleration_mps2=state.acceleration_mps2,
            wheel_speed_mps=state.wheel_speed_mps,
            motor_speed_rpm=state.shaft_speed_radps / RADPS_PER_RPM,
            engine_speed_rpm=state.engine_speed_radps / RADPS_PER_RPM,
            engine_torque_nm=state.engine_torque_nm,
            engine_load_pct=state.engine_load_pct,
            oil_temperature_c=state.oil_temperature_c,
            machine_mass_kg=self._mass_kg(),
            gear=state.inputs.gear,
            grade_deg=self._grade_deg(),
            pitch_deg=self._pitch_deg(),
        )

    def _configure(self, settings: PlantSettings) -> None:
        parameters = with_effects(settings)
        if parameters.pump.transport_delay_s > LONGEST_TRANSPORT_DELAY_S:
            raise ValueError(f"transport delay {parameters.pump.transport_delay_s} s > {LONGEST_TRANSPORT_DELAY_S} s")
        self._parameters = parameters
        self._sensors = sensors.sensors(parameters.sensors)
        self._shaft = vehicle.shaft(parameters.transmission)
        self._road = Road.of(parameters.road, self._seed)
        self._line = Line.of(parameters.line, Oil.of(parameters.oil))
        self._pump_m3_per_rad = pump.displacement_m3_per_rad(parameters.pump) * parameters.pump.speed_ratio

    def _step(self, wheels: Wheels) -> None:
        parameters, state = self._parameters, self.state
        step_s, inputs = parameters.step_s, state.inputs

        coil = solenoid.advance(parameters.solenoid, state.coil_current_ma, inputs.pump_current_ma, step_s)
        state.coil_current_ma = coil.current_ma
        state.coil_history_ma.append(coil.mean_ma)
        spool_ma = self._delayed_current_ma()
        friction = hysteresis.advance(parameters.hysteresis, state.spool_friction, spool_ma - state.spool_current_ma)
        state.spool_current_ma, state.spool_friction = spool_ma, friction
        effective_ma = spool_ma - parameters.hysteresis.half_width_ma * friction

        full_flow_m3ps = self._pump_m3_per_rad * state.engine_speed_radps
        target = pump.target(parameters.pump, effective_ma, state.line_pressure_pa, full_flow_m3ps)
        swash = pump.advance(parameters.pump, state.swash, target, step_s)
        displacement = self._pump_m3_per_rad * 0.5 * (state.swash + swash)
        state.swash = swash

        load_nm = displacement * state.line_pressure_pa
        load_nm += engine.machine_torque_nm(parameters.engine, inputs.crop_power_kw, state.engine_speed_radps)
        driven = engine.advance(
            parameters.engine,
            state.engine_speed_radps,
            state.engine_torque_nm,
            state.governor_nm,
            inputs.engine_speed_setpoint_rpm,
            load_nm,
            step_s,
        )
        state.pump_flow_m3ps = displacement * 0.5 * (state.engine_speed_radps + driven.speed_radps)
        state.engine_speed_radps, state.engine_torque_nm, state.governor_nm, state.engine_load_pct = driven

        coupled = state.shaft_per_travel_radpm > 0.0
        turned = self._line.advance(
            wheels if coupled else self._shaft,
            state.line_pressure_pa,
            state.ground_speed_mps if coupled else state.shaft_speed_radps,
            state.pump_flow_m3ps,
            self._line.leakage(state.oil_temperature_c),
            step_s,
        )
        state.line_pressure_pa = turned.pressure_pa
        speed_mps = turned.speed if coupled else line.coast(wheels, state.ground_speed_mps, step_s)
        state.travel_m += 0.5 * (state.ground_speed_mps + speed_mps) * step_s
        state.acceleration_mps2 = (speed_mps - state.ground_speed_mps) / step_s
        state.ground_speed_mps = speed_mps
        state.wheel_speed_mps = wheels.wheel_speed_mps(state.line_pressure_pa, speed_mps)
        state.shaft_speed_radps = state.wheel_speed_mps * state.shaft_per_travel_radpm if coupled else turned.speed

        state.oil_temperature_c = oil.advance(parameters.oil, state.oil_temperature_c, turned.loss_w, step_s)
        state.step += 1

    def _shift(self, shaft_per_travel_radpm: float) -> None:
        """Couples the motor's shaft to the wheels: an inelastic impact, which keeps the momentum of the two."""
        state = self.state
        if shaft_per_travel_radpm == state.shaft_per_travel_radpm:
            return
        state.shaft_per_travel_radpm = shaft_per_travel_radpm
        if shaft_per_travel_radpm > 0.0:
            shaft_kgm2 = self._parameters.transmission.shaft_inertia_kgm2
            momentum = self._mass_kg() * state.ground_speed_mps
            momentum += shaft_kgm2 * shaft_per_travel_radpm * state.shaft_speed_radps
            state.ground_speed_mps = momentum / (self._mass_kg() + shaft_kgm2 * shaft_per_travel_radpm**2)

    def _fill(self, grain_kg: float) -> None:
        capacity_kg = self._parameters.vehicle.bin_capacity_kg
        self.state.grain_kg = min(max(self.state.grain_kg + grain_kg, 0.0), capacity_kg)

    def _wheels(self) -> Wheels:
        inputs = self.state.inputs
        return vehicle.wheels(
            self._parameters.vehicle,
            self._parameters.transmission,
            self.state.shaft_per_travel_radpm,
            self._mass_kg(),
            self._grade_deg(),
            inputs.rolling_resistance,
            inputs.brake,
            inputs.implement_drag_n,
            inputs.pull_n,
        )

    def _grade_deg(self) -> float:
        return self.state.inputs.grade_deg + self._road.slope_deg(self.state.travel_m)

    def _mass_kg(self) -> float:
        return self._parameters.vehicle.mass_kg + self.state.grain_kg

    def _delayed_current_ma(self) -> float:
        """Mean coil current of the step a transport delay ago, between the steps on either side of that time."""
        past = self._parameters.pump.transport_delay_s / self._parameters.step_s
        back = min(int(past), len(self.state.coil_history_ma) - 2)
        later, earlier = self.state.coil_history_ma[-1 - back], self.state.coil_history_ma[-2 - back]
        return later + (past - back) * (earlier - later)

    def _pitch_deg(self) -> float:
        felt = self._parameters.sensors.pitch_inertia_share * self.state.acceleration_mps2
        return self._grade_deg() + degrees(atan(felt / GRAVITY_MPS2))

    def _shown(self) -> tuple[float, ...]:
        """What the sensors look at, in the order of `sensors.TRUTH`."""
        state = self.state
        return (
            state.ground_speed_mps,
            state.coil_current_ma,
            state.wheel_speed_mps,
            state.engine_speed_radps / RADPS_PER_RPM,
            state.engine_load_pct,
            float(state.inputs.gear),
            self._pitch_deg(),
            state.oil_temperature_c,
            self._mass_kg(),
            state.line_pressure_pa / PA_PER_BAR,
        )

    def _entries(self, span_s: float) -> int:
        return int(span_s / self._parameters.step_s) + 2


def _time(reading: Reading) -> float:
    return reading.time_s
