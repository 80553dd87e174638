"""The command lines that do what was done on the page."""

import shlex
from pathlib import Path

import msgspec
import yaml

from cruise.effects import Custom
from cruise.service.recordings import ReadingSettings
from cruise.workbench.session import Session

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
            said.append(f"cruise add {shlex.quote(_word(following.added))} --model {model} {files}{options} -o {out}")
            model = out
    if len(steps) > 1:
        said += [f"cruise ladder {model}", f"cruise compare {files} --model {model}{options}"]
        said.append(f"cruise run config/cruise.yaml    # with model: {model} in it")
    return said


def column_settings(session: Session) -> str:
    """The settings file that says what the columns mean; empty where nobody had to say it."""
    if session.opened is None:
        return ""
    usual, mine = ReadingSettings(), session.opened.source.reading
    own = {
        name: msgspec.to_builtins(getattr(mine, name))
        for name in ("time", "input", "output", "columns")
        if getattr(mine, name) != getattr(usual, name)
    }
    for column in own.get("columns", {}).values():
        if column.get("signal") is None:
            column.pop("signal", None)
    return yaml.safe_dump(own, sort_keys=False) if own else ""


def _word(added: object) -> str:
    """An effect as `cruise add` is told it: its name, or the term written out."""
    file, name = added.file, added.effect  # pyright: ignore[reportAttributeAccessIssue]
    terms = file.custom if isinstance(file.custom, tuple) else (file.custom,)
    for term in terms:
        if term.name == name:
            return str(Custom(term.name, term.stage, term.expression))
    return name
