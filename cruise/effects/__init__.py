"""The physical effects that the model knows, one a file, in one table."""

from typing import Final

from cruise.effects.dead_zone import DeadZone
from cruise.effects.effect import Effect, Inverse, Parameter, Stage, over
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import Saturation

EFFECTS: Final[dict[str, type[Effect]]] = {
    "saturation": Saturation,
    "dead_zone": DeadZone,
    "quadratic_gain": QuadraticGain,
    "engine_speed": EngineSpeed,
    "gear_ratio": GearRatio,
}
"""Every effect by name. An effect that stands here meets the contract tests and can be used in every model file."""

__all__ = ["EFFECTS", "Effect", "Inverse", "Parameter", "Stage", "over"]
