"""The command lines that do what was done on the page."""

import shlex
from pathlib import Path
from typing import Any

import msgspec
import yaml
from msgspec.structs import fields

from cruise.effects import Custom
from cruise.effects.custom import USUAL_BOUNDS
from cruise.workbench.found import Added
from cruise.workbench.parts import speed
from cruise.workbench.session import Session, Step

COLUMNS = "columns.yaml"


def lines(session: Session) -> list[str]:
    """One command after the other, from the recording to the model as it is now."""
    opened, steps = session.opened, session.steps[: session.at + 1]
    if opened is None or not steps:
        return []
    files = " ".join(shlex.quote(Path(one).name) for one in opened.source.paths)
    first = steps[0].question
    options = "" if first.horizon_s == 3.0 else f" --horizon {first.horizon_s:g}"
    if column_settings(session):
        options += f" --columns {COLUMNS}"
    database = opened.source.reading.database
    if database is not None and database != session.setup.reading.database:
        options += f" --database {shlex.quote(Path(database).name)}"
    model = shlex.quote(first.model)
    said = [f"cruise compare {files} --model {model}{options}"]
    for place, step in enumerate(steps):
        if step.diagnosed is not None:
            said.append(f"cruise diagnose {files} --model {model}{options}")
        following = steps[place + 1] if place + 1 < len(steps) else None
        if following is None or following.added is None:
            continue
        if following.added.by_hand:
            said.append("# then parameters were set by hand, which no command does: take the model file")
        else:
            out = f"better-{place + 1}.yaml" if following is not steps[-1] else "better.yaml"
            word, differs = _word(following.added)
            said += [f"# {differs}"] if differs else []
            said.append(f"cruise add {shlex.quote(word)} --model {model} {files}{options} -o {out}")
            model = out
    if len(steps) > 1:
        said += [f"cruise ladder {model}", f"cruise compare {files} --model {model}{options}"]
        worse = no_better(steps[-1])
        said.append(f"# {worse}" if worse else f"cruise run config/cruise.yaml    # with model: {model} in it")
    return said


def no_better(step: Step) -> str:
    """Why a step's model is none to drive with: by how much its error did not fall; or empty."""
    added = step.added
    if added is None or added.error_after_mps < added.error_before_mps:
        return ""
    before, after = speed(added.error_before_mps), speed(added.error_after_mps)
    which = "error on all data" if added.by_hand else "held-out error"
    return f"{step.name} did not lower the {which}, {before} before and {after} m/s now: drive with the model before it"


def column_settings(session: Session) -> str:
    """The settings file that says what the columns mean; empty where nobody had to say it."""
    if session.opened is None:
        return ""
    own = _own(msgspec.structs.replace(session.opened.source.reading, database=None))
    return yaml.safe_dump(own, sort_keys=False) if own else ""


def _own(settings: msgspec.Struct) -> dict[str, Any]:
    """What of the settings is not the default, all the way down; a column that is named stays."""
    usual, found = type(settings)(**{f.name: getattr(settings, f.name) for f in fields(settings) if f.required}), {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        if not field.required and value == getattr(usual, field.name):
            continue
        if isinstance(value, dict):
            value = {name: _own(one) for name, one in value.items()}
        found[field.name] = _own(value) if isinstance(value, msgspec.Struct) else value
    return found


def _word(added: Added) -> tuple[str, str]:
    """An effect as `cruise add` is told it, its name or the term written out, and what that leaves unsaid."""
    file, name = added.file, added.effect
    terms = file.custom if isinstance(file.custom, tuple) else (file.custom,)
    for term in terms:
        if term.name == name:
            other = {one: bounds for one, bounds in term.bounds.items() if bounds != USUAL_BOUNDS}
            here = ", ".join(f"{one} from {low:g} to {high:g}" for one, (low, high) in other.items())
            low, high = USUAL_BOUNDS
            differs = f"{name} was fitted with {here}, which no command says: the next looks from {low:g} to {high:g}"
            return str(Custom(term.name, term.stage, term.expression)), differs if other else ""
    return name, ""
