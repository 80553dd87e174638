"""A model whose physical parameters are moved by hand: what its error becomes, without a fit."""

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from msgspec.structs import replace

from cruise.effects import EFFECTS
from cruise.identification.accuracy import accuracy
from cruise.identification.identify import validation_filter
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.identification.regressors import Smooth
from cruise.identification.structures import Family
from cruise.model import files
from cruise.model.core import Core, discretised
from cruise.model.files import ModelFile, PhysicalCore, Step
from cruise.model.history import names_of
from cruise.model.model import Model
from cruise.validation.comparison import of_parameters
from cruise.validation.explanation import CORE, RESONANCE
from cruise.workbench.found import Compared

AROUND: Final = 1.0  # times the value, that a parameter without bounds can be moved to either side
LEAST_SPAN: Final = 0.1  # where that is nothing


@dataclass(frozen=True)
class Setting:
    """One parameter: where it is and how far it can be moved."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    meaning: str


def settings_of(file: ModelFile) -> list[Setting]:
    """The parameters of a file that has a physical core: its effects first, then the core."""
    found = []
    for effect, shape in file.effects.items():
        known = EFFECTS[effect].parameters if effect in EFFECTS else {}
        for name, value in shape.items():
            bound = known.get(name)
            low, high = (bound.low, bound.high) if bound else _around(value)
            unit, meaning = (bound.unit, bound.meaning) if bound else ("-", "")
            found.append(Setting(f"{effect}.{name}", unit, value, low, high, meaning))
    core = file.core
    if core is None:
        return found
    for effect, value in core.loads_mps.items():
        low, high = _around(value)
        found.append(Setting(f"{effect}.load", "m/s", value, low, high, "steady speed that one unit of phi brings"))
    names = ["gain_mps_per_ma", "delay_s", "lag_s", "second_lag_s", "time_constant_s"]
    names += ["servo_hz", "servo_damping"] if core.servo_hz else []
    names += ["stroke_share"] if core.stroke_share else []
    names += list(RESONANCE) if core.resonance_share else []
    for name in names:
        bound, value = {**CORE, **RESONANCE}[name], getattr(core, name)
        low, high = _around(value) if name == "gain_mps_per_ma" else (bound.low, min(bound.high, 4 * value + 0.5))
        found.append(Setting(name, bound.unit, value, min(low, value), max(high, value), bound.meaning))
    low, high = _around(core.offset_mps)
    found.append(Setting("offset_mps", "m/s", core.offset_mps, low, high, "speed without current"))
    return found


def changed(file: ModelFile, values: dict[str, float]) -> tuple[PhysicalCore, Model]:
    """Core and model with other values, by the names of `settings_of`."""
    assert file.core is not None
    shapes = {
        effect: {name: values.get(f"{effect}.{name}", value) for name, value in shape.items()}
        for effect, shape in file.effects.items()
    }
    own = {name: values[name] for name in (*CORE, *RESONANCE, "offset_mps") if name in values}
    loads = {name: values.get(f"{name}.load", value) for name, value in file.core.loads_mps.items()}
    core = replace(file.core, loads_mps=loads, **own)
    reshaped = files.model_of("by hand", replace(file, effects=shapes, core=None))
    order = [effect.name for _, effect in reshaped.load_effects]
    physical = Core(**{field.name: getattr(core, field.name) for field in fields(Core)})
    at_rest_mps = [loads[name] for name in order]
    return core, discretised(physical, reshaped.effects, at_rest_mps, core.offset_mps, file.period_s)


def judged(file: ModelFile, values: dict[str, float], compared: Compared) -> float:
    """The RMS error ahead in m/s of the file's model with other values, on all samples, as `cruise compare` has it."""
    _, model = changed(file, values)
    recordings = compared.predicted.recordings
    smooth: Smooth | None = smoother(PreparationSettings(period_s=model.period_s), model.period_s)
    validation = validation_filter(model, smooth)
    horizon = max(round(compared.predicted.horizon_s / model.period_s), 1)
    with np.errstate(over="ignore", invalid="ignore"):
        ahead = [of_parameters(Family.ARX, model).ahead(one, horizon, validation) for one in recordings]
    return float(accuracy([one.output for one in recordings], ahead).rmse_mps)


def begun_anew(file: ModelFile, floor_mps: tuple[float, float], compared: Compared) -> Step:
    """The first step of a file that was set by hand: the errors of the fits before it are not those of its model."""
    least, most = (one if math.isfinite(one) else None for one in floor_mps)
    effects = " + ".join(sorted(names_of(file))) or "core"
    return Step(
        structure=f"{effects}, set by hand (error on all data)",
        error_after_mps=compared.error_mps,
        horizon_s=round(compared.predicted.horizon_s, 9),
        floor_at_least_mps=least,
        floor_at_most_mps=most,
        recordings=file.provenance.recordings,
        samples=file.provenance.samples,
        made_on=file.provenance.made_on,
    )


def _around(value: float) -> tuple[float, float]:
    span = max(AROUND * abs(value), LEAST_SPAN * (value == 0.0))
    return value - span, value + span
