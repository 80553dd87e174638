"""What the columns of a file mean, where they are not named as cruise names them."""

import math
from typing import Any, Final

from msgspec.structs import replace
from nicegui import ui

from cruise.columns import ColumnSettings
from cruise.service.recordings import TABLES, ReadingSettings
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.units import UNITS, bracketed, spelt
from cruise.usual_names import TIME, guessed, unit_of, units_of
from cruise.workbench.found import Asked, Source
from cruise.workbench.page import Page
from cruise.workbench.parts import card, labelled

BY_SIZE: Final = ("%", "share")  # of a table's current: its reader sees which, and says so
AS_IT_IS: Final = "leave as it is"
AS_SET: Final = "as set"  # scale and offset of the settings, which are those of no unit here
SAME: Final = 1e-4  # relative: 0.277778 is 1 / 3.6
LEAVING_OUT: Final = ("cruise_", "requested_", "setpoint", "lever", "pump_current_command")


def show(page: Page, asked: Asked) -> None:
    """One row a column: what it is, and in which unit."""
    table = asked.paths[0].suffix.lower() in TABLES  # logs and measurements have times of their own
    meanings = [*([TIME] if table else []), *filter(_offered, SIGNALS)]
    needed = [TIME, INPUT, OUTPUT] if table else [INPUT, OUTPUT]
    meant = known(asked.reading, list(asked.names), meanings)
    chosen: dict[str, tuple[Any, Any]] = {}

    def read() -> None:
        told = {name: (str(meaning.value), str(unit.value)) for name, (meaning, unit) in chosen.items()}
        meanings = [meaning for meaning, _ in told.values() if meaning != AS_IT_IS]
        absent = [one for one in needed if one not in meanings]
        twice = [one for one in dict.fromkeys(meanings) if meanings.count(one) > 1]
        if absent or twice:
            problem = f"Which column is {absent[0]}?" if absent else f"Two columns are {twice[0]}: only one can be."
            ui.notify(problem, type="warning")
            return
        page.session.open(Source(asked.paths, reading_of(asked.reading, told), asked.paths[0].name))
        page.refresh()

    with card("What do the columns mean?"):
        words = "one time, one pump current and one ground speed" if table else "one pump current and one ground speed"
        ui.label(
            f"cruise needs {words}. The rest stays under its own name unless you say what it is. What is filled in is "
            "guessed from the names: look whether it is right."
        ).classes("quiet measure")
        with ui.element("table").classes("figures").style("max-width:720px"):
            with ui.element("tr"):
                for words in ("column" if table else "signal", "is", "in"):
                    with ui.element("th").classes("words"):
                        ui.label(words)
            for name in asked.names:
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(name).classes("mono").style("overflow-wrap:anywhere; min-width:110px")
                    chosen[name] = _choice(name, meanings, *meant.get(name, (AS_IT_IS, "-")))
        ui.button("Open it like this", on_click=read).props("unelevated no-caps").style("align-self:flex-start")


def _choice(name: str, meanings: list[str], value: str, in_unit: str) -> tuple[Any, Any]:
    """The two fields of one column."""
    with ui.element("td").classes("words"):
        meaning = ui.select([AS_IT_IS, *meanings], value=value)
        labelled(meaning.props("outlined dense options-dense").style("width:240px"), f"meaning of {name}")
    with ui.element("td").classes("words"):
        units = units_of(value)
        units = [*units, AS_SET] if in_unit == AS_SET else units
        unit = ui.select(units, value=in_unit if in_unit in units else units[0])
        labelled(unit.props("outlined dense options-dense").style("width:110px"), f"unit of {name}")
        meaning.on_value_change(
            lambda event: unit.set_options(
                units_of(event.value), value=spelt(name, unit_of(event.value)) or units_of(event.value)[0]
            )
        )
    return meaning, unit


def known(reading: ReadingSettings, names: list[str], meanings: list[str]) -> dict[str, tuple[str, str]]:
    """Column to meaning and unit: what was said before, else what each may be by its name alone."""
    roles = {reading.time: TIME, reading.input: INPUT, reading.output: OUTPUT}
    found: dict[str, tuple[str, str]] = {}
    for name in names:
        said = reading.columns.get(name)
        meaning = roles.get(name) or (said.signal if said is not None else None)
        if meaning in meanings:
            found[name] = meaning, _unit_by(name, meaning, said)
    taken = {meaning for meaning, _ in found.values()}
    rest = guessed([name for name in names if name not in found], [one for one in meanings if one not in taken])
    return found | {name: (meaning, _unit_by(name, meaning, None)) for name, meaning in rest.items()}


def _unit_by(name: str, meaning: str, said: ColumnSettings | None) -> str:
    """The unit that has this scale and offset; where none was said, that of the name."""
    if said is None:
        return spelt(name, unit_of(meaning)) or (AS_SET if meaning == INPUT else units_of(meaning)[0])
    units = UNITS.get(unit_of(meaning), {units_of(meaning)[0]: (1.0, 0.0)})
    for unit, (scale, offset) in units.items():
        if math.isclose(scale, said.scale, rel_tol=SAME) and math.isclose(offset, said.offset, rel_tol=SAME):
            return unit
    return AS_SET


def reading_of(usual: ReadingSettings, meant: dict[str, tuple[str, str]]) -> ReadingSettings:
    """The settings of the command line that say the same: column to meaning and unit.

    What the usual ones say of columns that are not asked about, or of what is offered as no meaning, holds on.
    """
    named = {meaning: column for column, (meaning, _) in meant.items() if meaning != AS_IT_IS}
    asked = {*named.values(), usual.time, usual.input, usual.output}
    settings = {
        column: said
        for column, said in usual.columns.items()
        if column not in asked and said.signal not in named and (column not in meant or not _offered(said.signal))
    }
    for meaning, column in named.items():
        unit, said = meant[column][1], usual.columns.get(column)
        scale, offset = UNITS.get(unit_of(meaning), {}).get(unit, (1.0, 0.0))
        by_size = meaning == INPUT and unit in BY_SIZE and TIME in named
        another = bracketed(column) and spelt(column, "mA") not in ("", unit)  # that its name says
        if (unit == AS_SET and said is None) or (by_size and not another):
            continue
        if unit == AS_SET and said is not None:
            scale, offset = said.scale, said.offset
        if column == meaning and (scale, offset) == (1.0, 0.0):
            continue
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


def _offered(signal: str | None) -> bool:
    return signal is not None and not signal.startswith(LEAVING_OUT)
