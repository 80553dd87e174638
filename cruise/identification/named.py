"""The model that a word means: the name of a preset, a structure written out, or a model file."""

from pathlib import Path

from cruise.effects import Custom
from cruise.identification.structures import PRESETS, Family, Structure, parse
from cruise.model import files
from cruise.model.model import Model


def model_named(text: str) -> tuple[Structure, Model | None]:
    """The structure that a name, a structure written out or a model file means; the file's model beside it."""
    if text in PRESETS or not (text.endswith((".yaml", ".yml")) or Path(text).is_file()):
        return parse(text), None
    file = files.read(text)
    model = files.model_of(text, file)
    effects = tuple(effect.name for effect in model.effects)
    family = Family(file.family)
    custom = tuple(effect for effect in model.effects if isinstance(effect, Custom))
    orders = file.na, file.nb, file.delay_s, len(file.noise_parameters)
    return Structure(family, *orders, effects=effects, custom=custom), model
