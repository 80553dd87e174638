"""`cruise effects`: the physical effects that the model knows, each explained."""

import difflib
import json
import re
import textwrap
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli import effects_picture
from cruise.cli.console import bold, printer
from cruise.cli.reading import PICTURES, AsJson, writable
from cruise.effects import EFFECTS, Effect, Parameter, Stage
from cruise.effects.custom import Custom
from cruise.report.effect import headline, paragraphs
from cruise.settings import SettingsError
from cruise.signals import SIGNALS

STAGES: Final = {
    Stage.COMMAND: "reshape the current",
    Stage.GAIN: "scale the drive",
    Stage.LOAD: "add a force",
    Stage.DYNAMICS: "change delay, order or time constant",
    Stage.SENSOR: "change what the sensor shows",
}
CUSTOM: Final = Custom(  # the user's own terms are explained by one of them
    "custom", Stage.GAIN, "1 + p1 * (pitch_deg - 2) * engine_load_pct", bounds=(("p1", -0.001, 0.001),)
)
LEFT_SIDES: Final = {
    "gain": "g factor on the drive, ",
    "load": "phi the force's term, which has a coefficient in the model, ",
}
APART: Final = re.compile(r" {3,}")  # between two equations of a line
WIDTH: Final = 80  # columns of running text; longer lines are tiring to read
NAMES_WIDTH, NEEDS_WIDTH = 29, 17  # columns of the list


def effects(
    name: Annotated[str | None, typer.Argument(help="The effect to explain; none: list them.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Where to draw what the effect does.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the physical effects that the model knows, or explain one."""
    if name is None:
        if picture is not None:
            raise SettingsError("--picture: name the effect to draw, such as: cruise effects grade --picture grade.png")
        if as_json:
            print(json.dumps({"effects": [report(kind()) for kind in EFFECTS.values()]}, indent=2))
        else:
            _list()
        return
    effect = _named(name)
    drawn = None
    if picture is not None:
        drawn = effects_picture.draw(effect, writable("--picture", picture, PICTURES))
    if as_json:
        print(json.dumps(report(effect) | ({"picture": str(drawn)} if drawn else {}), indent=2))
    else:
        _explain(effect, drawn)


def _named(name: str) -> Effect:
    if name == CUSTOM.name:
        return CUSTOM
    if name not in EFFECTS:
        near = difflib.get_close_matches(name.lower().replace("-", "_"), EFFECTS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(EFFECTS)}"
        raise SettingsError(f"no effect is called {name}; {hint}")
    return EFFECTS[name]()


def report(effect: Effect) -> dict[str, Any]:
    """All that is known of an effect, ready for JSON."""
    about = effect.about
    return {
        "name": effect.name,
        "stage": effect.stage,
        "what": headline(effect),
        "physics": about.physics,
        "equation": about.equation,
        "in_full": in_full(effect),
        "symbols": symbols(effect),
        "source": about.source,
        "needs": list(effect.needs),
        "helps": list(effect.helps),
        "reads_speed": effect.reads_speed,
        "parameters": {
            key: {"unit": one.unit, "low": one.low, "high": one.high, "neutral": one.neutral, "meaning": one.meaning}
            for key, one in effect.parameters.items()
        },
        "signature": about.signature,
        "look_alikes": list(about.look_alikes),
        "experiment": about.experiment,
    }


def symbols(effect: Effect) -> str:
    """What the symbols of the equations mean, with their units: the module's text between equation and source."""
    told = [" ".join(text.split()) for text in paragraphs(effect)[1:] if not text.startswith(" ")]
    return LEFT_SIDES.get(effect.acts_as, "") + " ".join(told).partition("Source:")[0].strip()


def in_full(effect: Effect) -> list[str]:
    """The equations as they are computed: those of the module, one a line."""
    lines = (line for text in paragraphs(effect)[1:] if text.startswith(" ") for line in text.splitlines())
    return [one.strip(" ,") for line in lines for one in APART.split(line.strip())]


def bounds(one: Parameter) -> str:
    """The plausible range with its unit."""
    return f"{one.low:g}..{one.high:g}{'' if one.unit == '-' else f' {one.unit}'}"


def _list() -> None:
    console = printer()
    for stage, does in STAGES.items():
        table = Table(box=box.SIMPLE_HEAD, title=bold(stage, f" effects {does}"), title_justify="left")
        table.add_column("effect and its parameters", no_wrap=True, width=NAMES_WIDTH)
        table.add_column("what it is", ratio=1)
        table.add_column("needs", no_wrap=True, width=NEEDS_WIDTH)
        for effect in (kind() for kind in EFFECTS.values() if kind.stage is stage):
            names = [effect.name]
            for key, one in effect.parameters.items():
                line = f"  {key} {bounds(one)}"
                names += [line] if len(line) <= NAMES_WIDTH else [f"  {key}", f"    {bounds(one)}"]
            table.add_row("\n".join(names), headline(effect).partition(": ")[2], "\n".join(effect.needs))
        console.print(table)
    console.print("cruise effects NAME explains one, --picture FILE.png draws it; custom is a term of your own")


def _explain(effect: Effect, drawn: Path | None) -> None:
    console, about = printer(), effect.about
    first, _, rest = headline(effect).partition(": ")
    console.print(bold(first, f" ({effect.name}, {effect.stage} effect)"))
    _paragraph(console, f"{rest[:1].upper()}{rest[1:]} {about.physics}")
    console.print()
    for line in textwrap.wrap(about.equation, WIDTH - 4, break_on_hyphens=False):
        console.print(f"    {line}")
    _part(console, "in full", in_full(effect))
    _paragraph(console, symbols(effect))
    _part(console, "source", [about.source])
    needed = [f"{name}: {_meaning(name)}" for name in effect.needs]
    _part(console, "needs", needed or ["no signal beside current and speed"])
    _part(console, "helped by", [f"{name}: {_meaning(name)}" for name in effect.helps])
    shape = [f"{key} {bounds(one)}, neutral {one.neutral:g}: {one.meaning}" for key, one in effect.parameters.items()]
    none = "none beside its coefficient" if effect.acts_as == "load" else "none of its own: the core holds them"
    _part(console, "parameters", shape or [none])
    _part(console, "signature", [about.signature])
    _part(console, "looks like", [headline(_named(name)) for name in about.look_alikes])
    _part(console, "told apart", [about.experiment])
    if drawn is not None:
        console.print(f"\npicture: {drawn}", soft_wrap=True)


def _meaning(signal: str) -> str:
    one = SIGNALS[signal]
    return one.meaning if one.unit == "-" else f"{one.meaning}, {one.unit}"


def _paragraph(console: Console, text: str) -> None:
    console.print()
    console.print(textwrap.fill(text, min(WIDTH, console.width), break_on_hyphens=False))


def _part(console: Console, title: str, entries: list[str]) -> None:
    """A title and its entries beside it, each wrapped and indented."""
    if entries:
        console.print()
    for entry, word in zip(entries, [title, *[""] * len(entries)], strict=False):
        width, indent = min(WIDTH, console.width), " " * 12
        text = textwrap.fill(
            entry, width, initial_indent=f"{word:12}", subsequent_indent=indent, break_on_hyphens=False
        )
        console.print(text)
