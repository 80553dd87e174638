"""The history of a model: which effects were added to it, one after the other, and the way back.

Every step keeps the model as it was before, so that the last one can be taken back exactly. A history that was edited
until its steps no longer follow from each other is refused: whatever it said would be wrong.
"""

from pathlib import Path

from cruise.model.files import CustomTerm, ModelFields, ModelFile, Step, model_of
from cruise.settings import SettingsError


def fields_of(file: ModelFile) -> ModelFields:
    """The model of a file without its history."""
    return ModelFields(**{name: getattr(file, name) for name in ModelFields.__struct_fields__})


def names_of(model: ModelFields) -> frozenset[str]:
    """The effects that a model holds, those of its core too."""
    custom = (model.custom,) if isinstance(model.custom, CustomTerm) else model.custom
    return frozenset((*model.effects, *(term.name for term in custom), *(model.core.effects if model.core else ())))


def history_of(path: str | Path, file: ModelFile) -> tuple[Step, ...]:
    """The steps of a file, oldest first. SettingsError names the first one that can't be."""
    for i, step in enumerate(file.history):
        where = f"{path}: history[{i}]"
        if step.before is None:
            if i or step.effect:
                raise SettingsError(f"{where}.before: missing; only a first step that adds nothing can do without it")
            continue
        if step.error_before_mps is None:
            raise SettingsError(f"{where}.error_before_mps: missing; restore the file")
        model_of(f"{where}.before", step.before)
        after = file.history[i + 1].before if i + 1 < len(file.history) else file
        earlier, later = names_of(step.before), names_of(after) if after else frozenset()
        added = (step.effect, *step.brought_along)
        if after and (not earlier.isdisjoint(added) or earlier.union(added) != later):
            raise SettingsError(
                f"{where}: {' and '.join(added) or 'nothing'} is said to have been added to {_listed(earlier)}, "
                f"but the model after it has {_listed(later)}; restore the file"
            )
    return file.history


def undone(path: str | Path, file: ModelFile) -> ModelFile:
    """The file as it was before its last step. SettingsError where there is none to take back."""
    history = history_of(path, file)
    before = history[-1].before if history else None
    if before is None:
        raise SettingsError(f"{path}: nothing to take back: no effect was added to this model")
    kept = {name: getattr(before, name) for name in ModelFields.__struct_fields__}
    return ModelFile(**kept, history=history[:-1])


def _listed(names: frozenset[str]) -> str:
    return ", ".join(sorted(names)) or "a model without effects"
