"""Holds trials: each is sized, recorded, diagnosed from its columns alone, and only then opened.

One JSON line a trial is appended to a file as soon as it is done, so that a run goes on where it stopped. What was
found about sizes goes to a file of its own, which other runs use too.
"""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from cruise.effects import EFFECTS as TABLE
from cruise.validation.candidates import owner
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose

from . import experiment
from .draw import draw
from .effects import UNLISTED
from .plan import NEXT_DRIVE, Task
from .score import MOST_ALIKE, NEVER, Line
from .simulate import Columns, simulate
from .sizing import Miss, Point, begun, rms_mps, sized, with_truth
from .trial import Trial

LINES: Final = "trials.jsonl"
MOST_DRIVES: Final = 5  # tried before a trial is given up
RANKED: Final = 5  # effects of the ranking that are kept

Found = Point | Miss


@dataclass(frozen=True)
class Held:
    """A trial that was held, and what was learnt about sizes on the way."""

    line: Line
    found: tuple[Found, ...]


@dataclass(frozen=True)
class Sealed:
    """The trial of a task, None where no drive excites its effects as much as wanted; the drives that did not."""

    trial: Trial | None
    misses: tuple[str, ...]
    found: tuple[Found, ...]


def processor_s() -> float:
    """CPU time of this process and of its children that have ended."""
    return sum(os.times()[:4])


def hold(task: Task, known: Sequence[Found]) -> Held:
    """Hold one trial."""
    begin_s = processor_s()
    answer = sealed(task, known)
    if answer.trial is None:
        return Held(Line(task=task, misses=answer.misses, failed=NEVER), answer.found)
    columns = simulate(answer.trial)
    if task.kind == "unlisted" and task.effects[0] in UNLISTED:
        true = begun(simulate(answer.trial.without())).base
    else:
        true = with_truth(begun(columns), task.effects)
    made_s = processor_s()
    with table_without(task.effects if task.kind == "unlisted" else ()):
        verdict = diagnose(begun(columns))
    diagnosed_s = processor_s()
    line = Line(
        task=task,
        trial=answer.trial,
        misses=answer.misses,
        verdict=verdict.verdict.value,
        effects=verdict.effects,
        signals=verdict.signals,
        beside=tuple(dict.fromkeys(owner(one) for one in verdict.final.explanation.effects if owner(one) != one.name)),
        ranking=tuple(one.effect for one in verdict.ranking[:RANKED]),
        confidence=verdict.confidence,
        margin=verdict.margin,
        base_mps=rms_mps(verdict.base),
        final_mps=rms_mps(verdict.final),
        true_mps=rms_mps(true),
        resolved=resolved(task, answer.trial, columns, verdict),
        diagnosis_s=diagnosed_s - made_s,
        trial_s=made_s - begin_s,
    )
    return Held(line, answer.found)


def resolved(task: Task, trial: Trial, columns: Columns, said: Diagnosis) -> tuple[str, ...]:
    """The effects that are named once the experiments of an ambiguous verdict are driven; none for another verdict.

    Only for a verdict that they can make right: they take long.
    """
    hopeless = task.kind != "single" or len(said.effects) > MOST_ALIKE or not set(task.effects) <= set(said.effects)
    if said.verdict is not Verdict.AMBIGUOUS or hopeless:
        return ()
    driven = [simulate(trial, experiment.course_of(name, trial)) for name in said.effects]
    again = diagnose(begun(columns, *driven))
    return again.effects if again.verdict is Verdict.MISSING else ()


def sealed(task: Task, known: Sequence[Found]) -> Sealed:
    """The trial of a task: every effect as large as it should be when it is alone on this drive."""
    found: list[Found] = []
    misses: list[str] = []
    for attempt in range(MOST_DRIVES):
        seed = task.seed + attempt * NEXT_DRIVE
        trial = draw(task.tier, "+".join(task.effects) or "nothing", task.size or "medium", seed)
        for name in task.effects:
            one = sized(task.tier, name, task.size, seed, (*known, *found))
            found += one.tried
            if one.miss is not None:
                found.append(one.miss)
                misses.append(f"{name}, seed {seed}: {one.miss.why}")
                break
            trial = trial.resized(name, one.size)
        else:
            return Sealed(trial, tuple(misses), tuple(found))
    return Sealed(None, tuple(misses), tuple(found))


@contextmanager
def table_without(names: Sequence[str]) -> Iterator[None]:
    """The program's table of effects without some of them, as if nobody had written them."""
    whole = dict(TABLE)
    for name in names:
        TABLE.pop(name, None)
    try:
        yield
    finally:
        TABLE.clear()
        TABLE.update(whole)


def go(
    tasks: Sequence[Task],
    folder: Path,
    sizes: Path,
    jobs: int,
    show: Callable[[Line], None],
    interrupted: Callable[[int], None] = lambda running: None,
) -> list[Line]:
    """Hold those of the tasks that have no line yet, and return the lines of all that were held.

    An interruption lets those that are under way end, after it told how many, writes them, and is raised again; another
    one drops them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sizes.parent.mkdir(parents=True, exist_ok=True)
    known: list[Found] = read(sizes, Found)
    done = {line.task for line in lines_of(folder) if not line.failed}
    waiting = [task for task in tasks if task not in done][::-1]
    running: dict[Future[Held], Task] = {}

    def finish() -> None:
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in ended:
            task, error = running.pop(future), future.exception()
            held = Held(Line(task=task, failed=repr(error)), ()) if error else future.result()
            append(sizes, held.found)
            append(folder / LINES, [held.line])
            known.extend(held.found)
            show(held.line)

    # Fresh processes: a copy of one that draws its progress in a thread could hang.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _deaf) as pool:
        try:
            while waiting or running:
                while waiting and len(running) < jobs:
                    task = waiting.pop()
                    of_task = [one for one in known if one.tier == task.tier and one.effect in task.effects]
                    running[pool.submit(hold, task, of_task)] = task
                finish()
        except KeyboardInterrupt:
            interrupted(len(running))
            try:
                while running:
                    finish()
            except KeyboardInterrupt:
                for worker in multiprocessing.active_children():
                    worker.terminate()
            raise
    wanted = set(tasks)
    return [line for line in lines_of(folder) if line.task in wanted]


def lines_of(folder: Path) -> list[Line]:
    """The lines of a folder; of a trial that was held again after it failed, the last."""
    return list({line.task: line for line in read(folder / LINES, Line)}.values())


def read(path: Path, kind: Any) -> list[Any]:
    """What a file holds, one JSON object a line; nothing where there is none. A line that was cut short is left out."""
    if not path.exists():
        return []
    whole, newline, _ = path.read_bytes().rpartition(b"\n")
    return [msgspec.json.decode(line, type=kind) for line in whole.splitlines()] if newline else []


def append(path: Path, objects: Sequence[Any]) -> None:
    """Add a line for each object, after the last that is whole."""
    with path.open("ab+") as file:
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)
        file.write(b"".join(msgspec.json.encode(one) + b"\n" for one in objects))


def _deaf() -> None:
    # An interruption from the keyboard reaches every process of the group; the first one decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
