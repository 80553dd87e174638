"""What the columns of a file mean, where they are not named as cruise names them."""

import csv
import difflib
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace
from nicegui import ui

from cruise.recording import ColumnSettings
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.workbench.found import Source
from cruise.workbench.page import Page
from cruise.workbench.parts import card

TIME: Final = "time_s"
UNITS: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "s": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0)},
    "mA": {"mA": (1.0, 0.0), "A": (1000.0, 0.0)},
    "m/s": {"m/s": (1.0, 0.0), "km/h": (1 / 3.6, 0.0), "mm/s": (1e-3, 0.0), "mph": (0.44704, 0.0)},
    "rpm": {"rpm": (1.0, 0.0), "1/s": (60.0, 0.0), "rad/s": (9.549297, 0.0)},
    "deg": {"deg": (1.0, 0.0), "rad": (57.29578, 0.0), "%": (0.5729578, 0.0)},
    "kg": {"kg": (1.0, 0.0), "t": (1000.0, 0.0)},
    "degC": {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5 / 9, -160 / 9)},
    "bar": {"bar": (1.0, 0.0), "kPa": (0.01, 0.0), "psi": (0.0689476, 0.0)},
}
"""Units of a file by the unit of the signal: scale and offset."""
AS_IT_IS: Final = "leave as it is"
LEAVING_OUT: Final = ("cruise_", "requested_", "setpoint", "lever", "brake", "clutch", "pump_current_command")


def show(page: Page, paths: tuple[Path, ...]) -> None:
    """One row a column: what it is, and in which unit."""
    names = columns(paths[0])
    meanings = [TIME, *(name for name in SIGNALS if not name.startswith(LEAVING_OUT))]
    with card("What do the columns mean?"):
        ui.label(
            "cruise needs one time, one pump current and one ground speed. The rest stays under its own name unless "
            "you say what it is."
        ).classes("quiet measure")
        if not names:
            _roles_only(page, paths)
            return
        chosen: dict[str, tuple[Any, Any]] = {}
        guesses = guessed(names, meanings)
        with ui.element("table").classes("figures"):
            with ui.element("tr"):
                for words in ("column", "is", "in"):
                    with ui.element("th").classes("words"):
                        ui.label(words)
            for name in names:
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(name).classes("mono")
                    with ui.element("td").classes("words"):
                        meaning = ui.select([AS_IT_IS, *meanings], value=guesses.get(name, AS_IT_IS))
                        meaning.props(f'outlined dense options-dense aria-label="meaning of {name}"').style(
                            "width:240px"
                        )
                    with ui.element("td").classes("words"):
                        unit = ui.select(_units(meaning.value), value=_units(meaning.value)[0])
                        unit.props(f'outlined dense options-dense aria-label="unit of {name}"').style("width:110px")
                        meaning.on_value_change(
                            lambda event, unit=unit: unit.set_options(_units(event.value), value=_units(event.value)[0])
                        )
                chosen[name] = meaning, unit

        def read() -> None:
            meant = {name: (str(meaning.value), str(unit.value)) for name, (meaning, unit) in chosen.items()}
            absent = [one for one in (TIME, INPUT, OUTPUT) if one not in [what for what, _ in meant.values()]]
            if absent and not (absent == [TIME] and paths[0].suffix != ".csv"):
                ui.notify(f"Which column is {absent[0]}?", type="warning")
                return
            page.session.open(Source(paths, reading_of(page.tools.reading, meant), paths[0].name))
            page.refresh()

        ui.button("Open it like this", on_click=read).props("unelevated no-caps").style("align-self:flex-start")


def reading_of(usual: Any, meant: dict[str, tuple[str, str]]) -> Any:
    """The settings of the command line that say the same: column to meaning and unit."""
    named: dict[str, str] = {}
    settings: dict[str, ColumnSettings] = {}
    for column, (meaning, unit) in meant.items():
        if meaning == AS_IT_IS:
            continue
        named[meaning] = column
        scale, offset = UNITS.get(_unit_of(meaning), {}).get(unit, (1.0, 0.0))
        settings[column] = ColumnSettings(
            signal=None if meaning in (TIME, INPUT, OUTPUT) else meaning, scale=scale, offset=offset
        )
    return replace(
        usual,
        time=named.get(TIME, usual.time),
        input=named.get(INPUT, usual.input),
        output=named.get(OUTPUT, usual.output),
        columns=settings,
    )


def columns(path: Path) -> list[str]:
    """The names in the header of a table; none where the file is no table."""
    if path.suffix.lower() != ".csv":
        return []
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        first = stream.readline()
    row = next(csv.reader([first], delimiter=max(",;\t", key=first.count), skipinitialspace=True), [])
    return [name.strip() for name in row if name.strip()]


def guessed(names: list[str], meanings: list[str]) -> dict[str, str]:
    """What each column may be by its name alone; each meaning once."""
    found: dict[str, str] = {}
    for meaning in meanings:
        free = [name for name in names if name not in found]
        alike = difflib.get_close_matches(meaning, free, n=1, cutoff=0.75)
        if meaning in free:
            found[meaning] = meaning
        elif alike:
            found[alike[0]] = meaning
    return found


def _roles_only(page: Page, paths: tuple[Path, ...]) -> None:
    usual = page.tools.reading
    with ui.row().classes("gap-4 items-end"):
        current = ui.input("Pump current", value=usual.input).props("outlined dense")
        speed = ui.input("Ground speed", value=usual.output).props("outlined dense")

        def read() -> None:
            reading = replace(usual, input=current.value, output=speed.value)
            page.session.open(Source(paths, reading, paths[0].name))
            page.refresh()

        ui.button("Open it like this", on_click=read).props("unelevated no-caps")


def _unit_of(meaning: str) -> str:
    return "s" if meaning == TIME else SIGNALS[meaning].unit if meaning in SIGNALS else ""


def _units(meaning: str) -> list[str]:
    unit = _unit_of(meaning)
    return list(UNITS.get(unit, {unit or "-": (1.0, 0.0)}))
