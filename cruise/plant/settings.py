"""The settings of the virtual combine, and its physical effects as factors: 1 as the parameters say, 0 off, 2 doubled.

A factor acts on parameters or inputs before any equation sees them, so that no equation knows of it. What limits
(saturation, rate, power, relief) is divided by its factor: 0 takes the limit away. Two factors choose between forms
instead: quadratic_gain goes from a linear valve (0) to the half bridge (1 and more), gear_ratio from four gears like
the second (0) to the real ones (1).
"""

from math import inf
from typing import Annotated, Final

from msgspec import Meta, Struct, structs

from cruise.plant.bounds import NotNegative
from cruise.plant.engine import EngineSettings
from cruise.plant.hysteresis import HysteresisSettings
from cruise.plant.inputs import Inputs
from cruise.plant.line import LineSettings
from cruise.plant.oil import OilSettings
from cruise.plant.pump import PumpSettings
from cruise.plant.road import RoadSettings
from cruise.plant.sensors import ChannelSettings, DriveFeedbackSettings, SensorsSettings
from cruise.plant.solenoid import SolenoidSettings
from cruise.plant.vehicle import TransmissionSettings, VehicleSettings

SECOND = 1  # place of the second gear, the paper's reference, among the ratios


class EffectFactors(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One factor per effect, without unit, 0 or greater."""

    solenoid_lag: NotNegative = 1.0  # time constant of the coil current
    transport_delay: NotNegative = 1.0  # dead time between coil and swash
    hysteresis: NotNegative = 1.0  # width of the spool's friction loop
    dead_zone: NotNegative = 1.0  # threshold current
    quadratic_gain: NotNegative = 1.0  # 0 a linear valve, 1 the half bridge
    saturation: NotNegative = 1.0  # stop of the swash plate; 0: none
    load_sensitivity: NotNegative = 1.0  # stroke lost to pressure
    servo_lag: NotNegative = 1.0  # small-signal lag of the swash servo
    rate_limit: NotNegative = 1.0  # greatest swash rate; 0: none
    engine_speed: NotNegative = 1.0  # departure of the set speed from rated speed
    engine_droop: NotNegative = 1.0  # droop of the governor
    power_limit: NotNegative = 1.0  # full-load curve, power control; 0: none, engine load then reads 0
    compressibility: NotNegative = 1.0  # oil volume of the line
    entrained_air: NotNegative = 1.0  # air in the oil
    leakage: NotNegative = 1.0  # leakage of pump and motor
    oil_temperature: NotNegative = 1.0  # dependence of the leakage on viscosity
    oil_warming: NotNegative = 1.0  # heating of the oil; 0: its temperature stays
    relief_valve: NotNegative = 1.0  # pressure limit; 0: none
    active_braking: NotNegative = 1.0  # pressure while the wheels drive the pump; 0: coasts
    gear_ratio: NotNegative = 1.0  # difference of the gears; 0: all as the 2nd
    coulomb_friction: NotNegative = 1.0  # dry friction of the driveline and of the free motor
    viscous_drag: NotNegative = 1.0  # drag proportional to speed
    wheel_slip: NotNegative = 1.0  # slip of the driven tyres
    grade: NotNegative = 1.0  # slope of the ground
    rolling_resistance: NotNegative = 1.0  # rolling resistance of the ground
    crop_load: NotNegative = 1.0  # power that threshing takes
    grain_filling: NotNegative = 1.0  # grain into the bin
    pitch_acceleration: NotNegative = 1.0  # acceleration that the pitch sensor takes for slope
    sensor_noise: NotNegative = 1.0  # noise of every sensor
    sensor_resolution: NotNegative = 1.0  # steps in which every sensor shows its value
    sensor_delay: NotNegative = 1.0  # delay of every sensor
    sensor_bias: NotNegative = 1.0  # bias of every sensor
    sampling_jitter: NotNegative = 1.0  # jitter of the sampling instants


LINEAR: Final = EffectFactors(
    solenoid_lag=0,
    hysteresis=0,
    dead_zone=0,
    quadratic_gain=0,
    saturation=0,
    load_sensitivity=0,
    rate_limit=0,
    engine_droop=0,
    power_limit=0,
    compressibility=0,
    entrained_air=0,
    oil_temperature=0,
    oil_warming=0,
    relief_valve=0,
    coulomb_friction=0,
    wheel_slip=0,
)
"""Off is all that bends; delay, lags, inertia, viscous drag and what gear and ground do are left."""


class PlantSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that makes one combine differ from another."""

    step_s: Annotated[float, Meta(gt=0, le=0.02)] = 0.01  # half moves the speed by 2 mm/s rms in noise; 0.001..0.02
    effects: EffectFactors = EffectFactors()
    solenoid: SolenoidSettings = SolenoidSettings()
    hysteresis: HysteresisSettings = HysteresisSettings()
    pump: PumpSettings = PumpSettings()
    engine: EngineSettings = EngineSettings()
    oil: OilSettings = OilSettings()
    line: LineSettings = LineSettings()
    transmission: TransmissionSettings = TransmissionSettings()
    vehicle: VehicleSettings = VehicleSettings()
    road: RoadSettings = RoadSettings()
    sensors: SensorsSettings = SensorsSettings()


def with_effects(settings: PlantSettings) -> PlantSettings:
    """The settings with every factor worked into the parameters on which it acts; the factors of inputs remain."""
    e = settings.effects
    pump, engine, oil, line = settings.pump, settings.engine, settings.oil, settings.line
    transmission, vehicle = settings.transmission, settings.vehicle
    second = transmission.gear_ratio[SECOND]
    return structs.replace(
        settings,
        road=structs.replace(settings.road, undulation_deg=settings.road.undulation_deg * e.grade),
        solenoid=structs.replace(settings.solenoid, regulated_lag_s=settings.solenoid.regulated_lag_s * e.solenoid_lag),
        hysteresis=structs.replace(settings.hysteresis, half_width_ma=settings.hysteresis.half_width_ma * e.hysteresis),
        pump=structs.replace(
            pump,
            transport_delay_s=pump.transport_delay_s * e.transport_delay,
            threshold_ma=pump.threshold_ma * e.dead_zone,
            threshold_edge_ma=pump.threshold_edge_ma * e.dead_zone,
            bridge_share=min(pump.bridge_share * e.quadratic_gain, 1.0),
            stop=_limit(pump.stop, e.saturation),
            power_kw=_limit(pump.power_kw, e.power_limit),
            load_sensitivity_per_bar=pump.load_sensitivity_per_bar * e.load_sensitivity,
            servo_lag_s=pump.servo_lag_s * e.servo_lag,
            stroke_rate_per_s=_limit(pump.stroke_rate_per_s, e.rate_limit),
            return_rate_per_s=_limit(pump.return_rate_per_s, e.rate_limit),
        ),
        engine=structs.replace(
            engine,
            droop_share=engine.droop_share * e.engine_droop,
            torque_scale=_limit(engine.torque_scale, e.power_limit),
        ),
        oil=structs.replace(
            oil,
            free_air_share=oil.free_air_share * e.entrained_air,
            heat_capacity_j_per_k=_limit(oil.heat_capacity_j_per_k, e.oil_warming),
        ),
        line=structs.replace(
            line,
            volume_l=line.volume_l * e.compressibility,
            leakage_lpm_per_100bar=line.leakage_lpm_per_100bar * e.leakage,
            leakage_thinning=line.leakage_thinning * e.oil_temperature,
            relief_bar=_limit(line.relief_bar, e.relief_valve),
            # Without active braking the valve lets the wheels turn the pump at no pressure, whatever else it does.
            braking_relief_bar=_limit(line.braking_relief_bar, e.relief_valve) * e.active_braking
            if e.active_braking
            else 0.0,
        ),
        transmission=structs.replace(
            transmission,
            gear_ratio=tuple(second * (ratio / second) ** e.gear_ratio for ratio in transmission.gear_ratio),
            driveline_friction_n=transmission.driveline_friction_n * e.coulomb_friction,
            shaft_friction_nm=transmission.shaft_friction_nm * e.coulomb_friction,
        ),
        vehicle=structs.replace(
            vehicle,
            viscous_drag_n_per_mps=vehicle.viscous_drag_n_per_mps * e.viscous_drag,
            slip_scale=vehicle.slip_scale * e.wheel_slip,
        ),
        sensors=_sensors(settings.sensors, e),
    )


def inputs_with_effects(settings: PlantSettings, inputs: Inputs) -> Inputs:
    """The inputs with the factors that act on them, as plain floats: numpy's scalars would slow every step down."""
    e = settings.effects
    rated_rpm = settings.engine.rated_speed_rpm
    return Inputs(
        pump_current_ma=float(inputs.pump_current_ma),
        engine_speed_setpoint_rpm=float(rated_rpm + e.engine_speed * (inputs.engine_speed_setpoint_rpm - rated_rpm)),
        gear=int(inputs.gear),
        grade_deg=float(inputs.grade_deg * e.grade),
        rolling_resistance=float(inputs.rolling_resistance * e.rolling_resistance),
        crop_power_kw=float(inputs.crop_power_kw * e.crop_load),
        grain_flow_kgps=float(inputs.grain_flow_kgps * e.grain_filling),
        brake=float(inputs.brake),
        clutch=bool(inputs.clutch),
        implement_drag_n=float(inputs.implement_drag_n),
        pull_n=float(inputs.pull_n),
    )


def _limit(value: float, factor: float) -> float:
    return value / factor if factor else inf


def _sensors(sensors: SensorsSettings, e: EffectFactors) -> SensorsSettings:
    def scaled(channel: ChannelSettings) -> ChannelSettings:
        return structs.replace(
            channel,
            noise=channel.noise * e.sensor_noise,
            resolution=channel.resolution * e.sensor_resolution,
            bias=channel.bias * e.sensor_bias,
            delay_s=channel.delay_s * e.sensor_delay,
        )

    drive = sensors.drive_feedback
    changed: dict[str, ChannelSettings | DriveFeedbackSettings] = {
        name: scaled(value) for name, value in structs.asdict(sensors).items() if isinstance(value, ChannelSettings)
    }
    changed["drive_feedback"] = structs.replace(
        drive, ground_speed_mps=scaled(drive.ground_speed_mps), pump_current_ma=scaled(drive.pump_current_ma)
    )
    return structs.replace(
        sensors,
        **changed,
        jitter_s=sensors.jitter_s * e.sampling_jitter,
        pitch_inertia_share=sensors.pitch_inertia_share * e.pitch_acceleration,
    )
