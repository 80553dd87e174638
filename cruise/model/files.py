"""Model files: a model as YAML that an engineer can read, with where it came from.

Physical names and units stand in it; `delay_s` is a time, not a number of samples, so that it survives a change of
the period.
"""

import difflib
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from cruise import settings
from cruise.effects import EFFECTS, Custom, Effect, Stage
from cruise.effects.expression import ExpressionError
from cruise.model.model import Model
from cruise.settings import SettingsError


class CustomTerm(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A term of the user's own; its parameters and its place stand among the effects, under its name."""

    name: str
    stage: Stage  # command, gain or load
    expression: str  # of recorded signals, speed_mps, p1 to p9, and value in a command term
    bounds: dict[str, tuple[float, float]] = {}  # of its parameters, -1 to 1 for those without


Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class Provenance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a model came from."""

    recordings: tuple[str, ...] = ()
    samples: int = 0
    made_by: str = ""
    made_on: str = ""  # date, ISO 8601
    error_ahead_mps: float | None = None  # RMS on held-out blocks
    horizon_s: float | None = None  # of that error
    note: str = ""


class ModelFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The fields of a model file."""

    family: Literal["arx", "armax", "oe"] = "arx"  # how the parameters were found; all three drive as ARX
    period_s: Positive
    na: Annotated[int, msgspec.Meta(ge=0, le=100)]  # beyond 100 samples of memory a typing error is likelier
    nb: Annotated[int, msgspec.Meta(ge=1, le=100)]
    delay_s: Annotated[float, msgspec.Meta(ge=0, le=60)]
    effects: dict[str, dict[str, float]] = {}  # in the order in which the current meets them
    custom: CustomTerm | tuple[CustomTerm, ...] = ()  # those that `effects` doesn't name come last
    parameters: dict[str, float]
    standard_errors: dict[str, NotNegative] = {}
    residual_std_mps: Positive = 0.02
    noise_parameters: tuple[float, ...] = ()  # c_1 .. of an ARMAX model, which driving leaves aside
    provenance: Provenance = Provenance()


def load(path: str | Path) -> Model:
    """Read the model of a file. SettingsError names the file, the key, what is wrong and what to do."""
    return model_of(path, read(path))


def read(path: str | Path) -> ModelFile:
    """Read a model file as it stands there."""
    return settings.load(path, ModelFile)


def model_of(path: str | Path, file: ModelFile) -> Model:
    """The model that the fields of a file describe; `path` is named in what is wrong with them."""
    terms = _custom(path, file)
    shapes = file.effects | {name: {} for name in terms if name not in file.effects}
    effects = tuple(_effect(path, name, shape, terms.get(name)) for name, shape in shapes.items())
    delay = round(file.delay_s / file.period_s)
    empty = Model(file.period_s, file.na, file.nb, delay, effects, (0.0,) * _count(file, effects))
    if abs(delay * file.period_s - file.delay_s) > 1e-6:
        raise SettingsError(f"{path}: delay_s: {file.delay_s} is no multiple of period_s, {file.period_s}")
    for key, given in (("parameters", file.parameters), ("standard_errors", file.standard_errors)):
        wrong = set(given).symmetric_difference(empty.parameter_names)
        if wrong and (given or key == "parameters"):
            raise SettingsError(
                f"{path}: {key}: {', '.join(sorted(wrong))} missing or not of this structure; "
                f"it needs {', '.join(empty.parameter_names)}"
            )
    names = empty.parameter_names
    std = tuple(file.standard_errors[name] for name in names) if file.standard_errors else ()
    theta = tuple(file.parameters[name] for name in names)
    return Model(file.period_s, file.na, file.nb, delay, effects, theta, std, file.residual_std_mps)


def save(
    path: str | Path,
    model: Model,
    provenance: Provenance,
    family: Literal["arx", "armax", "oe"] = "arx",
    noise_parameters: tuple[float, ...] = (),
) -> None:
    """Write a model file that `load` reads back as an equal model."""
    names = model.parameter_names
    shapes = {
        effect.name: {name: float(getattr(effect, name)) for name in effect.parameters} for effect in model.effects
    }
    if len(shapes) < len(model.effects):
        names_twice = ", ".join(effect.name for effect in model.effects)
        raise ValueError(f"{path}: a model file holds every effect once, this model has {names_twice}")
    settings.save(
        path,
        ModelFile(
            period_s=model.period_s,
            na=model.na,
            nb=model.nb,
            delay_s=round(model.delay * model.period_s, 9),
            effects=shapes,
            custom=tuple(_term(effect) for effect in model.effects if isinstance(effect, Custom)),
            parameters=dict(zip(names, model.theta, strict=True)),
            standard_errors=dict(zip(names, model.theta_std, strict=True)) if model.theta_std else {},
            residual_std_mps=model.residual_std_mps,
            family=family,
            noise_parameters=noise_parameters,
            provenance=provenance,
        ),
    )


def _count(file: ModelFile, effects: tuple[Effect, ...]) -> int:
    return file.na + file.nb + sum(effect.acts_as == "load" for effect in effects) + 1


def _term(effect: Custom) -> CustomTerm:
    bounds = {name: (float(low), float(high)) for name, low, high in effect.bounds}
    return CustomTerm(name=effect.name, stage=effect.stage, expression=effect.expression, bounds=bounds)


def _custom(path: str | Path, file: ModelFile) -> dict[str, Custom]:
    """The user's own terms by name, their parameters 0."""
    terms: dict[str, Custom] = {}
    for term in (file.custom,) if isinstance(file.custom, CustomTerm) else file.custom:
        if term.name in EFFECTS or term.name in terms:
            raise SettingsError(f"{path}: custom: name {term.name}: an effect has this name already; choose another")
        bounds = tuple((name, low, high) for name, (low, high) in term.bounds.items())
        try:
            terms[term.name] = Custom(term.name, term.stage, term.expression, bounds)
        except ExpressionError as error:
            raise SettingsError(f"{path}: custom.{term.name}: {error}") from error
    return terms


def _effect(path: str | Path, name: str, shape: dict[str, float], term: Custom | None) -> Effect:
    kind = term or EFFECTS.get(name)
    if kind is None:
        near = difflib.get_close_matches(name, EFFECTS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(EFFECTS)}"
        raise SettingsError(f"{path}: effects.{name}: no such effect; {hint}")
    unknown = set(shape) - set(kind.parameters)
    if unknown:
        raise SettingsError(
            f"{path}: effects.{name}: no parameter {', '.join(sorted(unknown))}; known: {', '.join(kind.parameters)}"
        )
    for parameter, value in shape.items():
        bounds = kind.parameters[parameter]
        if not bounds.low <= value <= bounds.high:
            raise SettingsError(
                f"{path}: effects.{name}.{parameter}: {value} is outside {bounds.low} to {bounds.high} {bounds.unit}"
            )
    return kind(**shape) if isinstance(kind, type) else kind.reshaped(**shape)
