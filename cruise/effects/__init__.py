"""The physical effects that the model knows, one a file, in one table."""

from typing import Final

from cruise.effects.active_braking import ActiveBraking
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.crop_load import CropLoad
from cruise.effects.custom import Custom
from cruise.effects.dead_zone import DeadZone
from cruise.effects.effect import Effect, Inverse, Parameter, Stage
from cruise.effects.engine_droop import EngineDroop
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.leakage import Leakage
from cruise.effects.oil_temperature import OilTemperature
from cruise.effects.power_limit import PowerLimit
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.rate_limit import RateLimit
from cruise.effects.resonance import Resonance
from cruise.effects.rolling_resistance import RollingResistance
from cruise.effects.saturation import Saturation
from cruise.effects.sensor_bias import SensorBias
from cruise.effects.speed_droop import SpeedDroop
from cruise.effects.transport_delay import TransportDelay
from cruise.effects.wheel_slip import WheelSlip

EFFECTS: Final[dict[str, type[Effect]]] = {
    "rate_limit": RateLimit,  # the effects of the command in the order in which the current meets them
    "hysteresis": Hysteresis,
    "dead_zone": DeadZone,
    "quadratic_gain": QuadraticGain,
    "saturation": Saturation,
    "engine_speed": EngineSpeed,
    "engine_droop": EngineDroop,
    "power_limit": PowerLimit,
    "gear_ratio": GearRatio,
    "oil_temperature": OilTemperature,
    "speed_droop": SpeedDroop,
    "grade": Grade,
    "rolling_resistance": RollingResistance,
    "crop_load": CropLoad,
    "coulomb_friction": CoulombFriction,
    "leakage": Leakage,
    "transport_delay": TransportDelay,
    "active_braking": ActiveBraking,
    "resonance": Resonance,
    "sensor_bias": SensorBias,
    "wheel_slip": WheelSlip,
}
"""Every effect by name. An effect that stands here meets the contract tests and can be used in every model file."""

__all__ = ["EFFECTS", "Custom", "Effect", "Inverse", "Parameter", "Stage"]
