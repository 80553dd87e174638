"""Shapes that no fit of the speed should look for: the signals themselves tell them, or the kind of an effect does."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from cruise.effects import EFFECTS
from cruise.recording import Recording
from cruise.validation.beginnings import Shapes
from cruise.validation.line_pressure import Force, Traction, force_of_a_bar, load_of_a_bar
from cruise.validation.slope import pitch_share

BY_SLOPE: Final[Mapping[str, tuple[str, ...]]] = {
    "power_limit": ("rolling_resistance", "acceleration_share"),
    "crop_load": ("inertia_pct_per_m2ps3",),
}
"""Shapes that say nothing where the line pressure shows the force."""


def told_shapes(name: str, recordings: Sequence[Recording]) -> tuple[Shapes, ...]:
    """Shapes of an effect that no fit looks for, in every way in which they may be: told by signals, or by its kind."""
    return TOLD[name](recordings) if name in TOLD else kinds_of(name)


def kinds_of(name: str) -> tuple[Shapes, ...]:
    """Shapes of every kind that an effect may be of: what lies between two of them bends as much else does."""
    kinds = EFFECTS[name].kinds if name in EFFECTS else ()
    return tuple(tuple(kind.items()) for kind in kinds) or ((),)


def _grade(recordings: Sequence[Recording]) -> tuple[Shapes]:
    """Shapes of the grade that no fit of the speed should find: the pitch sensor's; the mass's, where none is known."""
    share = ("acceleration_share", pitch_share(recordings))
    weighed = all("machine_mass_kg" in one.columns for one in recordings)
    return ((share,) if weighed else (share, ("mass_share", 0.0)),)


def _power(recordings: Sequence[Recording]) -> tuple[Shapes, ...]:
    """The force that a bar is, and where a fit may start with the pressure at rest; or none: it goes by the slope."""
    bar, by_slope = force_of_a_bar(recordings), _neutral("power_limit", Force._fields)
    if bar is None:
        return (by_slope,)
    return _meant("power_limit", bar), _meant("power_limit", bar._replace(rest_bar=0.0)), by_slope


def _crop(recordings: Sequence[Recording]) -> tuple[Shapes, ...]:
    """The load that the drive's pressure makes of the engine's; or none, as crop itself may be in the pressure."""
    bar, without_it = load_of_a_bar(recordings), _neutral("crop_load", Traction._fields)
    return (without_it,) if bar is None else (_meant("crop_load", bar), without_it)


def _meant(name: str, bar: Force | Traction) -> Shapes:
    """What a bar means, within bounds, and neutral values of what it makes superfluous."""
    shapes = EFFECTS[name].parameters
    meant = ((shape, min(max(value, shapes[shape].low), shapes[shape].high)) for shape, value in bar._asdict().items())
    return (*meant, *_neutral(name, BY_SLOPE[name]))


def _neutral(name: str, shapes: Sequence[str]) -> Shapes:
    return tuple((shape, EFFECTS[name].parameters[shape].neutral) for shape in shapes)


TOLD: Final[Mapping[str, Callable[[Sequence[Recording]], tuple[Shapes, ...]]]] = {
    "grade": _grade,
    "power_limit": _power,
    "crop_load": _crop,
}
"""Shapes of effects that the signals themselves tell; where they may be told in two ways, both."""
