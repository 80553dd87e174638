"""Model files: a model as YAML that an engineer can read, with where it came from.

Physical names and units stand in it; `delay_s` is a time, not a number of samples, so that it survives a change of
the period. A model whose core was fitted in physical terms holds these too, under `core`: the parameters follow from
them, and a file in which they don't is refused. Learning on moves the parameters alone; what it gives has no `core`.
"""

import dataclasses
import difflib
import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from cruise import settings
from cruise.effects import EFFECTS, Custom, Effect, Stage
from cruise.effects.expression import ExpressionError
from cruise.model.core import Core, discretised
from cruise.model.model import Model
from cruise.settings import Positive, SettingsError
from cruise.units import InputUnit

AGREE = 1e-4  # relative: between core and parameters, so that a file may be rounded to five digits


class CustomTerm(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A term of the user's own; its parameters and its place stand among the effects, under its name."""

    name: str
    stage: Stage  # command, gain or load
    expression: str  # of recorded signals, speed_mps, p1 to p9, and value in a command term
    bounds: dict[str, tuple[float, float]] = {}  # of its parameters, -1 to 1 for those without


NotNegative = Annotated[float, msgspec.Meta(ge=0)]
StrokeShare = Annotated[float, msgspec.Meta(ge=0, le=0.95)]


class Provenance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a model came from."""

    recordings: tuple[str, ...] = ()
    samples: int = 0
    made_by: str = ""
    made_on: str = ""  # date, ISO 8601
    error_ahead_mps: float | None = None  # RMS on held-out blocks
    horizon_s: float | None = None  # of that error
    input_unit: InputUnit = ""  # in which its recordings were read
    input_rest_ma: float = 0.0  # input of the recordings, in mA, that is 0 here
    note: str = ""


class PhysicalCore(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The core in physical terms, by the names of cruise.model.core, with what loads and rolling friction take."""

    gain_mps_per_ma: float
    delay_s: NotNegative
    lag_s: Positive
    time_constant_s: Positive
    second_lag_s: NotNegative = 0.0  # 0: there is none
    resonance_share: Annotated[float, msgspec.Meta(ge=-2, le=1)] = 0.0  # 0: there is none
    resonance_hz: Positive = 1.0
    damping: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.3
    servo_hz: NotNegative = 0.0  # 0: there is none
    servo_damping: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.8
    stroke_share: StrokeShare = 0.0  # 0: a time constant that is the same at any stroke
    loads_mps: dict[str, float] = {}  # by effect, per unit of its phi
    offset_mps: float = 0.0
    effects: tuple[str, ...] = ()  # that have no term but live in this core: transport_delay, resonance


class ModelFields(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of a model file that describe one model."""

    family: Literal["arx", "armax", "oe"] = "arx"  # how the parameters were found; all three drive as ARX
    period_s: Positive
    na: Annotated[int, msgspec.Meta(ge=0, le=100)]  # beyond 100 samples of memory a typing error is likelier
    nb: Annotated[int, msgspec.Meta(ge=1, le=1000)]  # a lag of 2 s at 20 Hz has 213 taps
    delay_s: Annotated[float, msgspec.Meta(ge=0, le=60)]
    effects: dict[str, dict[str, float]] = {}  # in the order in which the current meets them
    custom: CustomTerm | tuple[CustomTerm, ...] = ()  # those that `effects` doesn't name come last
    core: PhysicalCore | None = None
    parameters: dict[str, float]
    standard_errors: dict[str, NotNegative] = {}
    residual_std_mps: Positive = 0.02
    stroke_share: StrokeShare = 0.0  # of the vehicle's time constant, that rises with the stroke
    noise_parameters: tuple[float, ...] = ()  # c_1 .. of an ARMAX model, which driving leaves aside
    provenance: Provenance = Provenance()


class Step(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """One step of a model's history: what was added to it, what that was worth, and what it was before."""

    effect: str = ""  # none for the first step of a model that began as a structure
    brought_along: tuple[str, ...] = ()  # effects without which it could not be: a dead zone where the drive begins
    structure: str = ""  # that was fitted in that first step
    error_before_mps: NotNegative | None = None  # RMS on held-out blocks, without the effect, fitted to the same data
    error_after_mps: NotNegative
    horizon_s: Positive
    floor_at_least_mps: NotNegative | None = None  # no model errs by less; None: not known
    floor_at_most_mps: NotNegative | None = None  # reached by a flexible model of the same signals
    recordings: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    samples: Annotated[int, msgspec.Meta(ge=1)]
    made_on: str  # date, ISO 8601
    before: ModelFields | None = None


class ModelFile(ModelFields, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of a model file: a model, and how it came about."""

    history: tuple[Step, ...] = ()  # oldest first


def load(path: str | Path) -> Model:
    """Read the model of a file. SettingsError names the file, the key, what is wrong and what to do."""
    return model_of(path, read(path))


def read(path: str | Path) -> ModelFile:
    """Read a model file as it stands there."""
    return settings.load(path, ModelFile)


def model_of(path: str | Path, file: ModelFields) -> Model:
    """The model that the fields of a file describe; `path` is named in what is wrong with them."""
    terms = _custom(path, file)
    shapes = file.effects | {name: {} for name in terms if name not in file.effects}
    effects = tuple(_effect(path, name, shape, terms.get(name)) for name, shape in shapes.items())
    delay = round(file.delay_s / file.period_s)
    if file.stroke_share and file.na != 1:
        raise SettingsError(
            f"{path}: stroke_share: {file.stroke_share:g} slows down a drive of one pole, this one has na: {file.na}; "
            "leave it out, or fit a model with na: 1"
        )
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
    model = Model(file.period_s, file.na, file.nb, delay, effects, theta, std, file.residual_std_mps, file.stroke_share)
    if file.core is not None:
        _check_core(path, file.core, model)
    return model


def save(
    path: str | Path,
    model: Model,
    provenance: Provenance,
    family: Literal["arx", "armax", "oe"] = "arx",
    noise_parameters: tuple[float, ...] = (),
) -> None:
    """Write a model file that `load` reads back as an equal model."""
    settings.save(path, file_of(path, model, provenance, family, noise_parameters))


def file_of(
    path: str | Path,
    model: Model,
    provenance: Provenance,
    family: Literal["arx", "armax", "oe"] = "arx",
    noise_parameters: tuple[float, ...] = (),
    core: PhysicalCore | None = None,
    history: tuple[Step, ...] = (),
) -> ModelFile:
    """The fields that describe a model; `path`, where they shall stand, is named in what is wrong with it."""
    names = model.parameter_names
    shapes = {
        effect.name: {name: float(getattr(effect, name)) for name in effect.parameters} for effect in model.effects
    }
    if len(shapes) < len(model.effects):
        names_twice = ", ".join(effect.name for effect in model.effects)
        raise ValueError(f"{path}: a model file holds every effect once, this model has {names_twice}")
    return ModelFile(
        period_s=model.period_s,
        na=model.na,
        nb=model.nb,
        delay_s=round(model.delay * model.period_s, 9),
        effects=shapes,
        custom=tuple(_term(effect) for effect in model.effects if isinstance(effect, Custom)),
        core=core,
        parameters=dict(zip(names, model.theta, strict=True)),
        standard_errors=dict(zip(names, model.theta_std, strict=True)) if model.theta_std else {},
        residual_std_mps=model.residual_std_mps,
        stroke_share=model.stroke_share,
        family=family,
        noise_parameters=noise_parameters,
        provenance=provenance,
        history=history,
    )


def _check_core(path: str | Path, core: PhysicalCore, model: Model) -> None:
    """SettingsError where the parameters don't follow from the core."""
    loads = [effect.name for _, effect in model.load_effects]
    wrong = set(loads).symmetric_difference(core.loads_mps)
    if wrong:
        raise SettingsError(f"{path}: core.loads_mps: {', '.join(sorted(wrong))} missing or no load of this model")
    physical = Core(**{field.name: getattr(core, field.name) for field in dataclasses.fields(Core)})
    at_rest_mps = [core.loads_mps[name] for name in loads]
    meant = discretised(physical, model.effects, at_rest_mps, core.offset_mps, model.period_s)
    remedy = "correct it, or delete the section core, which driving does without"
    for key, here, there in (("na", model.na, 1), ("nb", model.nb, meant.nb), ("delay", model.delay, meant.delay)):
        if here != there:
            raise SettingsError(f"{path}: core: asks for {key} of {there} samples, the model has {here}; {remedy}")
    if model.stroke_share != core.stroke_share:
        raise SettingsError(
            f"{path}: stroke_share: {model.stroke_share:g}, by the core it is {core.stroke_share:g}; {remedy}"
        )
    for name, here, there in zip(model.parameter_names, model.theta, meant.theta, strict=True):
        if not math.isclose(here, there, rel_tol=AGREE, abs_tol=1e-9):
            raise SettingsError(f"{path}: parameters.{name}: {here:g}, by the core it is {there:g}; {remedy}")


def _count(file: ModelFields, effects: tuple[Effect, ...]) -> int:
    return file.na + file.nb + sum(effect.acts_as == "load" for effect in effects) + 1


def _term(effect: Custom) -> CustomTerm:
    bounds = {name: (float(low), float(high)) for name, low, high in effect.bounds}
    return CustomTerm(name=effect.name, stage=effect.stage, expression=effect.expression, bounds=bounds)


def _custom(path: str | Path, file: ModelFields) -> dict[str, Custom]:
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
