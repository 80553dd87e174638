"""The model file that an added effect makes: the better model, what it was fitted to, and its history."""

from typing import Any

from cruise.identification.structures import Structure
from cruise.model import files
from cruise.model.files import ModelFile, Provenance, Step
from cruise.model.history import fields_of
from cruise.recording import input_rest_of, input_unit_of
from cruise.validation import ladder
from cruise.validation.ladder import Added
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.study import Study, discrete


def model_file(
    model: str,
    structure: Structure,
    file: ModelFile | None,
    earlier: tuple[Step, ...],
    study: Study,
    added: Added,
    floor: NoiseFloor,
    made_on: str,
) -> ModelFile:
    """The better model with its history; one that began as a structure has the fitted structure as its first step."""
    names = tuple(f"{one.source}, {one.time_s[0]:g} to {one.time_s[-1]:g} s" for one in study.recordings)
    samples = sum(len(one) for one in study.recordings)

    def provenance(made_by: str, error_mps: float) -> Provenance:
        return Provenance(
            recordings=names,
            samples=samples,
            made_by=made_by,
            made_on=made_on,
            error_ahead_mps=error_mps,
            horizon_s=study.horizon_s,
            input_unit=input_unit_of(study.recordings),
            input_rest_ma=input_rest_of(study.recordings),
            note=f"physical core, fitted to speeds simulated from {study.horizon_s:g} s ahead on",
        )

    def step(**own: Any) -> Step:
        return Step(
            horizon_s=study.horizon_s,
            floor_at_least_mps=float(floor.white.value_mps) if floor.white else None,
            floor_at_most_mps=float(floor.reached.value_mps) if floor.reached else None,
            recordings=names,
            samples=samples,
            made_on=made_on,
            **own,
        )

    history = earlier
    if file is not None:
        before = fields_of(file)
    else:
        made = provenance(f"cruise add {added.effect} --model {model}, before it", added.error_before_mps)
        begun = discrete(study, study.base)
        before = fields_of(files.file_of(model, begun, made, core=ladder.physical(study.base.explanation)))
        history = (step(structure=structure.name or str(structure), error_after_mps=added.error_before_mps),)
    last = step(
        effect=added.effect,
        brought_along=added.brought_along,
        error_before_mps=added.error_before_mps,
        error_after_mps=added.error_after_mps,
        before=before,
    )
    made = provenance(f"cruise add {added.effect} --model {model}", added.error_after_mps)
    core = ladder.physical(added.after.explanation)
    return files.file_of(model, added.model, made, core=core, history=(*history, last))
