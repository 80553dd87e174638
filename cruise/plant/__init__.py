"""The virtual combine: independent physics of the propulsion of a combine harvester, on which everything is tested."""

from cruise.plant.combine import Combine
from cruise.plant.inputs import Inputs
from cruise.plant.sensors import SensorReading
from cruise.plant.settings import EffectFactors, PlantSettings
from cruise.plant.state import State, Truth

__all__ = ["Combine", "EffectFactors", "Inputs", "PlantSettings", "SensorReading", "State", "Truth"]
