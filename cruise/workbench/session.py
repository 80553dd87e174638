"""The work of one browser tab: what was opened, the model step by step, what was found, and the job under way.

It lives in the server, so that a reload finds it again; it knows nothing of the page.
"""

import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec import structs

from cruise.effects import Stage
from cruise.model.files import CustomTerm
from cruise.service.recordings import ReadingSettings
from cruise.service.settings import CruiseSettings
from cruise.workbench import verbs
from cruise.workbench.examples import Example, make
from cruise.workbench.found import Added, Asked, Compared, Diagnosed, Opened, Predicted, Question, Show, Source
from cruise.workbench.jobs import Job
from cruise.workbench.setup import Setup

MODEL: Final = "arx:na=1,nb=3,delay_s=0.5"  # the paper's order, and nothing that an effect could hide behind
SEARCH: Final = "Looking for what is missing"
HERE: Final = (
    (re.compile(r"; choose with [^;]* in the file of --columns"), "; say below what the columns mean"),
    (re.compile(r"take it out with cruise ladder --undo"), "take it out with Undo"),
    (re.compile(r"cruise diagnose says"), "What is missing says"),
    (re.compile(r"give the DBC file with --database"), "drop the log together with its DBC file"),
    (
        re.compile(r"give the machine's own database with --database, .* in --columns"),
        "drop the log together with the machine's own DBC file",
    ),
    (re.compile(r"choose (\S+ columns? with )?--(in|out)put( and --output)?"), "change what the columns mean"),
    (re.compile(r"give --period \S+ or more, or record faster"), "record faster"),
    (re.compile(r"choose a shorter period"), "record for longer"),
)
"""What the command line advises, and what does it on the page."""


@dataclass(eq=False)
class Step:
    """The model as it was at one step; `added` says how it came to be, None for the first."""

    name: str
    question: Question
    compared: Compared | None = None
    added: Added | None = None
    diagnosed: Diagnosed | None = None
    predicted: Predicted | None = None  # before all of `compared` is known

    @property
    def curves(self) -> Predicted | None:
        """What is known of its predictions."""
        return self.compared.predicted if self.compared else self.predicted


@dataclass(eq=False)
class Draft:
    """A term of one's own as it stands in its fields: what shows the page anew does not lose it."""

    name: str = "my_term"
    stage: Stage = Stage.GAIN
    expression: str = ""  # empty: the example of the stage
    within: float | None = 1.0


@dataclass(eq=False)
class Session:
    """Everything of one tab."""

    setup: Setup
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="cruise-workbench-")))
    opened: Opened | None = None
    draft: Draft = field(default_factory=Draft)
    refused: Question | None = None  # the last, to be asked better
    steps: list[Step] = field(default_factory=list)
    at: int = 0
    job: Job | None = None
    fault: str = ""  # of the last job
    asked: Asked | None = None  # files that could not be read as they are: what do their columns mean?
    recording: int = 0  # number of the one that is shown
    window: tuple[float, float] | None = None
    context: list[str] = field(default_factory=list)  # further signals that are shown
    free_run: bool = False
    cell: tuple[int, int] | None = None  # of the heat map
    other: int | None = None  # step that is shown beside
    dark: bool | None = None
    files: int = 0  # written so far
    pages: int = 0  # of browsers that show it now
    version: int = 0  # rises whenever there is more to see
    searching: bool = False  # what is missing is looked for as soon as the comparison is there
    fresh: bool = False  # a recording has just been opened, and nobody has seen it
    _then: Callable[[Any], None] | None = None
    _part: Callable[[Any], None] | None = None
    _seen: object = None

    @property
    def step(self) -> Step | None:
        """The model as it is now."""
        return self.steps[self.at] if self.steps else None

    @property
    def busy(self) -> bool:
        """Whether a job is under way."""
        return self.job is not None and self.job.running

    @property
    def found_before(self) -> tuple[str, ...]:
        """What the last search named and was not added yet, if all that was added since is what it named, too."""
        steps = self.steps[: self.at + 1]
        last = next((place for place in reversed(range(len(steps))) if steps[place].diagnosed), len(steps))
        found = steps[last].diagnosed if last < len(steps) - 1 else None
        added = {step.added.effect for step in steps[last + 1 :] if step.added and not step.added.by_hand}
        if found is None or found.verdict != "missing" or not added <= set(found.effects):
            return ()
        return tuple(one.effect for one in found.cards if one.worth_adding and one.effect not in added)

    def open(self, source: Source) -> None:
        """Read recordings and compare the first model with them."""
        self.searching = False
        self._start(f"Opening {source.title}", verbs.opened, (source,), self._opened, self._ask)

    @property
    def uploads(self) -> Path:
        """Where files that were sent are kept, each time in a folder of their own."""
        return self.folder / "uploads"

    def ask_columns(self) -> None:
        """Have it said again what the columns of the recording mean."""
        if self.opened is not None:
            self._start("Looking at the columns", verbs.asked, (self.opened.source,), self._ask)

    def open_example(self, example: Example) -> None:
        """Open a bundled recording; the virtual combine drives it first, where nobody has opened it before."""
        self.searching = False
        self._start(f"Opening {example.title}", _example, (self.setup, example), self._opened)

    def open_live(self, path: Path, service: CruiseSettings, seconds: float) -> None:
        """Diagnose a service's model with the last `seconds` of its bus, read as the service reads it."""

        def done(found: Opened) -> None:
            self.steps, self.searching = [Step("the service's model", Question(str(service.model)))], True
            self._opened(found)

        reading = structs.replace(self.setup.reading, database=str(service.database), can=service.can)
        self._start("Opening what the bus said", _last, (reading, path, seconds), done)

    def left(self) -> None:
        """A page that showed it is gone."""
        self.pages -= 1

    def close(self) -> None:
        """Forget everything."""
        self.cancel()
        shutil.rmtree(self.folder, ignore_errors=True)

    def ask(self, question: Question, name: str = "") -> None:
        """Begin again with another model, or another horizon; where that can't be, everything stays as it was."""
        try:
            verbs.meant(question)
        except verbs.EXPECTED as error:
            self.fault, self.refused = str(error), question
            return
        self._begin(question, name)

    def _begin(self, question: Question, name: str) -> None:
        self.steps, self.refused = [Step(name or Path(question.model).name, question)], None
        self.at, self.cell, self.other = 0, None, None
        self.compare()

    def compare(self) -> None:
        """Judge the present model."""
        step = self.step
        if self.opened is None or step is None:
            return

        def done(found: Compared) -> None:
            step.compared = found
            if self.searching:
                self.searching = False
                self.diagnose()

        def part(found: Predicted | Compared) -> None:
            if isinstance(found, Compared):
                step.compared = found
            else:
                step.predicted = found

        self._start(
            "Comparing the model with the recording",
            verbs.compared,
            (self.opened.recordings, step.question),
            done,
            part,
        )

    def diagnose(self) -> None:
        """Ask what the present model lacks."""
        step = self.step
        if self.opened is None or step is None:
            return

        def done(found: Diagnosed) -> None:
            step.diagnosed = found

        self._start(SEARCH, verbs.diagnosed, (self.opened.recordings, step.question), done)

    def add(self, effect: str | CustomTerm) -> None:
        """Refit the present model with one effect more, as a new step."""
        step = self.step
        if self.opened is None or step is None:
            return
        name = effect if isinstance(effect, str) else effect.name
        self._start(
            f"Adding {name}: everything is refitted",
            verbs.added,
            (self.opened.recordings, step.question, effect, self._next_file()),
            self._stepped,
        )

    def by_hand(self, name: str, values: dict[str, float]) -> None:
        """Keep parameters that were set by hand, as a new step."""
        step = self.step
        if self.opened is None or step is None or step.added is None:
            return
        self._start(
            "Judging the model as set by hand",
            verbs.by_hand,
            (self.opened.recordings, step.question, step.added, values, name, self._next_file()),
            self._stepped,
        )

    def undo(self) -> None:
        """One step back."""
        self.go(self.at - 1)

    def redo(self) -> None:
        """One step on again."""
        self.go(self.at + 1)

    def go(self, number: int) -> None:
        """To any step."""
        if 0 <= number < len(self.steps) and not self.busy:
            self.at, self.cell = number, None

    def cancel(self) -> None:
        """Stop the job under way; everything stays as it was before."""
        self.searching = False
        if self.job is not None:
            self.job.cancel()
            self.poll()  # at once: a page that is drawn a second time for it loses what is pressed meanwhile

    def poll(self) -> None:
        """Take in what the job under way has found; `version` tells every page that shows this session."""
        job = self.job
        if job is None:
            return
        job.poll()
        if job.part is not None and job.part is not self._seen:
            self._seen = job.part
            self.version += 1
            if self._part is not None:
                self._part(job.part)
        if job.running:
            return
        self.job = None
        self.version += 1
        if job.fault:
            self.fault = "" if job.cancelled else said_here(self._named(job.fault))
            self.searching = False
            return
        self.fault = ""
        if self._then is not None:
            self._then(job.result)

    def _start(
        self,
        title: str,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        then: Callable[[Any], None],
        part: Callable[[Any], None] | None = None,
    ) -> None:
        if self.busy:
            self.cancel()
        self.fault, self.asked, self._then, self._part, self._seen = "", None, then, part, None
        self.job = Job(title, function, arguments, verbs.EXPECTED)

    def _ask(self, found: Asked) -> None:
        self.asked = found

    def _named(self, text: str) -> str:
        """The text with the files that were sent under their names alone: nobody knows the folders of the page."""
        return re.sub(f"{re.escape(str(self.uploads))}/[^/]+/", "", text)

    def _opened(self, found: Opened) -> None:
        known = (replace(one, source=self._named(one.source)) for one in found.recordings)
        self.opened, self.fresh = replace(found, recordings=tuple(known)), True
        self.recording, self.window = 0, None
        names = [name for name in found.recordings[0].context() if moves(found, name)]
        self.context = [name for name in names if name == "pitch_deg"] or names[:1]
        first = self.steps[0] if self.steps else Step("", Question(MODEL))
        self._begin(first.question, first.name)

    def _stepped(self, found: Added) -> None:
        del self.steps[self.at + 1 :]
        question = replace(self.steps[0].question, model=str(found.path))
        self.steps.append(Step(f"+ {found.effect}", question, found.compared, found))
        self.other, self.at, self.cell = self.at, self.at + 1, None
        if found.effect == self.draft.name:
            self.draft = Draft()

    def _next_file(self) -> Path:
        self.files += 1
        return self.folder / f"model-{self.files}.yaml"


def moves(found: Opened, name: str) -> bool:
    """Whether a signal takes more than one value in the first recording."""
    values = found.recordings[0].columns[name]
    values = values[np.isfinite(values)]
    return bool(values.max() - values.min() > 0.0) if len(values) else False


def said_here(fault: str) -> str:
    """What a verb says, with the remedies that the page has."""
    for advice, remedy in HERE:
        fault = advice.sub(remedy, fault)
    return fault


def _example(setup: Setup, example: Example, show: Show) -> Opened:
    """A bundled recording, made if it has to be, then opened under its own names, which are cruise's."""
    path = make(example, setup.cache, lambda text: show(text))
    return verbs.opened(Source((path,), ReadingSettings(), example.title), show)


def _last(reading: ReadingSettings, path: Path, seconds: float, show: Show) -> Opened:
    """The end of a log of the bus."""
    opened = verbs.opened(Source((path,), reading, f"the last {seconds / 60:.0f} minutes"), show)
    return replace(
        opened, recordings=tuple(one[-min(round(seconds / one.dt_s), len(one)) :] for one in opened.recordings)
    )
