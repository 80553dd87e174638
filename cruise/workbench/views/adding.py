"""Add: the ladder of steps with undo and redo, parameters by hand, and terms of one's own."""

import math
from typing import Final

from nicegui import ui

from cruise.effects import Stage
from cruise.effects.expression import ExpressionError
from cruise.model.files import CustomTerm
from cruise.signals import OUTPUT
from cruise.workbench import plots
from cruise.workbench.by_hand import Setting, judged, settings_of
from cruise.workbench.found import Added
from cruise.workbench.page import Page
from cruise.workbench.parts import NO_FIGURE, card, figure, heading, labelled, nothing_open, row_button, speed
from cruise.workbench.session import Session, said_here
from cruise.workbench.verbs import term as own
from cruise.workbench.views.tracks import timeline

STAGES: Final = {
    Stage.GAIN: "gain: scales the drive",
    Stage.LOAD: "load: adds a force",
    Stage.COMMAND: "command: reshapes the current",
}
EXAMPLE: Final = {
    Stage.GAIN: "1 + p1*(oil_temperature_c - 50)",
    Stage.LOAD: "-sin(pitch_deg*0.01745)",
    Stage.COMMAND: "value + p1*value*abs(value)",
}
STEPS_OF_SLIDER: Final = 200


def show(page: Page) -> None:
    """The whole view."""
    session = page.session
    heading("Add", "Every step refits the whole model. The error is judged on data that the fit has not seen.")
    if nothing_open(page):
        return
    with ui.element("div").classes("grid2 wide-left"):
        with card("How the error fell"):
            _ladder(page)
        with card("Steps"):
            _steps(page)
    with card("On the time axis"):
        _beside(page)
        timeline(page, compact=True)
    step = session.step
    if step is not None and step.added is not None:
        how = _how(step.added)
        with card("Parameters", f"As {how}. Moving one shows at once what the error becomes; nothing is refitted."):
            _by_hand(page, step.added)
    with card("A term of your own"):
        _custom(page)


def levels(session: Session) -> list[plots.Level]:
    """Every step with its held-out error; one that was set by hand has none."""
    found: list[plots.Level] = []
    for place, step in enumerate(session.steps):
        if step.added is None or step.added.by_hand:
            continue
        if not found:
            found.append(plots.Level(place - 1, session.steps[place - 1].name, step.added.error_before_mps))
        found.append(plots.Level(place, step.name, step.added.error_after_mps))
    return found


def _ladder(page: Page) -> None:
    session = page.session
    found, floors = levels(session), [step.added.floor_mps for step in session.steps if step.added is not None]
    if found:
        plots.stairs(found, floors[-1], session.at, page.colors)
    elif not floors:
        ui.label("Nothing was added yet. Ask what is missing, or write a term of your own below.").classes("quiet")
    step = session.step
    added = step.added if step else None
    if added is not None:
        fall = 100 * (1 - added.error_after_mps / added.error_before_mps)
        with ui.row().classes("gap-10"):
            figure(
                f"{speed(added.error_before_mps)} → {speed(added.error_after_mps)}",
                "m/s",
                "error on all data, set by hand" if added.by_hand else "held-out error of this step",
                tone="good" if fall > 2 else "",
            )
            figure(f"{abs(fall):.0f} %", "", "less" if fall >= 0 else "more than before")
            figure(speed(_floor(added)), "m/s", "noise floor")
        for sentence in added.doubts:
            ui.label(said_here(sentence)).classes("measure")


def _floor(added: Added) -> float:
    least, most = added.floor_mps
    return least if math.isfinite(least) else most


def _steps(page: Page) -> None:
    session = page.session
    with ui.row().classes("gap-2"):
        back = ui.button("Undo", icon="undo", on_click=page.do(session.undo)).props("flat dense no-caps")
        back.set_enabled(session.at > 0 and not session.busy)
        on = ui.button("Redo", icon="redo", on_click=page.do(session.redo)).props("flat dense no-caps")
        on.set_enabled(session.at + 1 < len(session.steps) and not session.busy)
    for place, step in enumerate(session.steps):
        with row_button(place == session.at).on("click", page.do(lambda place=place: session.go(place))):
            ui.label(step.name).classes("strong")
            if step.added is not None:
                how = "on all data" if step.added.by_hand else "held-out"
                ui.label(
                    f"{how} {speed(step.added.error_before_mps)} → {speed(step.added.error_after_mps)} m/s"
                ).classes("quiet small num")
            else:
                ui.label("where it began").classes("quiet small")
    with ui.row().classes("gap-3"):
        ui.button("What is still missing?", on_click=lambda: page.go("/missing")).props("outline no-caps")
        ui.button("Take it away", on_click=lambda: page.go("/take")).props("outline no-caps")


def _beside(page: Page) -> None:
    session = page.session
    if len(session.steps) < 2:
        return

    def choose() -> None:
        session.other = None if chosen.value == -1 else int(chosen.value or 0)
        page.refresh()

    names = {-1: "nothing"} | {i: step.name for i, step in enumerate(session.steps) if i != session.at}
    value = session.other if session.other in names else -1
    with ui.row().classes("items-center gap-4"):
        chosen = ui.select(names, value=value, label="Beside it", on_change=choose).props("outlined dense")
        chosen.style("width:280px")
        other = session.steps[value] if value >= 0 else None
        step = session.step
        if other is not None and other.compared and step is not None and step.compared:
            ui.label(
                f"compared on all data: {speed(other.compared.error_mps)} → {speed(step.compared.error_mps)} m/s"
            ).classes("num quiet")


def _how(added: Added) -> str:
    """How the parameters of a step came to be."""
    return "set by hand" if added.by_hand else "fitted"


def _by_hand(page: Page, added: Added) -> None:
    session = page.session
    step = session.step
    assert step is not None
    settings = settings_of(added.file)
    values = {one.name: one.value for one in settings}
    as_it_was = f"as {_how(added)}"
    with ui.row().classes("items-end gap-10"):
        shown = ui.label(speed(step.compared.error_mps) if step.compared else NO_FIGURE).classes("figure")
        words = ui.label(f"m/s RMS ahead, {as_it_was}").classes("quiet small")
    std = {one.name: one for one in added.parameters}
    inputs = []

    def set_to(one: Setting, value: float | None) -> None:
        if value is None or not step.compared:
            return
        values[one.name] = float(value)
        changed = any(not math.isclose(values[each.name], each.value, rel_tol=1e-9) for each in settings)
        error = judged(added.file, values, step.compared) if changed else step.compared.error_mps
        shown.set_text(speed(error))
        words.set_text(f"m/s RMS ahead, {'set by hand' if changed else as_it_was}")
        keep.set_enabled(changed and not session.busy)

    with ui.element("table").classes("figures"):
        with ui.element("tr"):
            for text in ("parameter", "by hand", "value", as_it_was, "±", "unit"):
                with ui.element("th").classes("words" if text in ("by hand", "unit") else ""):
                    ui.label(text)
        for one in settings:
            with ui.element("tr"):
                with ui.element("td"), ui.label(one.name):
                    if one.meaning:
                        ui.tooltip(one.meaning)
                with ui.element("td").classes("words").style("width:38%; min-width:92px"):
                    slider = ui.slider(
                        min=one.low,
                        max=one.high,
                        step=float(f"{(one.high - one.low) / STEPS_OF_SLIDER:.1g}"),
                        value=one.value,
                        on_change=lambda event, one=one: set_to(one, event.value),
                    ).props("dense")
                    labelled(slider, one.name)
                with ui.element("td"):
                    ui.label().bind_text_from(slider, "value", lambda value: f"{value:.4g}")
                with ui.element("td"):
                    ui.label(f"{one.value:.4g}")
                with ui.element("td"):
                    error = std.get(one.name)
                    known = error is not None and math.isfinite(error.std)
                    ui.label(f"{error.std:.2g}" if error is not None and known else NO_FIGURE).classes("quiet")
                with ui.element("td").classes("words"):
                    ui.label(one.unit).classes("quiet")
            inputs.append(slider)

    def reset() -> None:
        for one, slider in zip(settings, inputs, strict=True):
            values[one.name] = one.value
            slider.set_value(one.value)
        set_to(settings[0], settings[0].value)

    with ui.row().classes("gap-3"):
        keep = ui.button(
            "Keep as a step",
            on_click=page.do(lambda: session.by_hand("by hand", dict(values))),
        ).props("outline no-caps")
        keep.set_enabled(False)
        ui.button("Back" if added.by_hand else "Back to the fit", on_click=reset).props("flat no-caps")


def _custom(page: Page) -> None:
    session = page.session
    step = session.step
    opened = session.opened
    assert step is not None
    assert opened is not None
    draft = session.draft
    ui.label(
        "An expression of recorded signals, speed_mps (one sample ago), the parameters p1 to p9, which are fitted, and "
        "in a command term value, the current. A load term has a coefficient of its own, 0 or more: give its sign. "
        "Functions: abs, sqrt, exp, log, sin, cos, tanh, min, max and the like. It is read by a parser of its own and "
        "never run as a program."
    ).classes("quiet small measure")
    with ui.row().classes("items-end gap-3 w-full"):
        name = ui.input("Name", value=draft.name).props("outlined dense").style("width:150px")
        stage = ui.select(STAGES, value=draft.stage, label="Stage").props("outlined dense").style("width:230px")
        text = ui.input("Expression", value=draft.expression or EXAMPLE[draft.stage])
        text.props("outlined dense").classes("mono").style("flex:1; min-width:280px")
        bound = ui.number("Parameters within ±", value=draft.within, min=1e-9)
        bound.props("outlined dense").style("width:170px")

        def exemplify() -> None:
            if text.value in EXAMPLE.values():
                text.set_value(EXAMPLE[stage.value or Stage.GAIN])

        def keep() -> None:
            draft.name, draft.stage = str(name.value), stage.value or Stage.GAIN
            draft.expression, draft.within = str(text.value), bound.value

        stage.on_value_change(exemplify)
        for one in (name, stage, text, bound):
            one.on_value_change(keep)

    def add() -> None:
        try:
            term = own(CustomTerm(name=str(name.value), stage=stage.value, expression=str(text.value)))
        except ExpressionError as error:
            ui.notify(str(error), type="warning", multi_line=True, close_button=True)
            return
        limit = abs(float(bound.value or 1.0))
        bounds = dict.fromkeys(term.parameters, (-limit, limit))
        session.add(CustomTerm(name=term.name, stage=term.stage, expression=term.expression, bounds=bounds))
        page.refresh()

    with ui.row().classes("items-center gap-4"):
        button = ui.button("See whether it helps", on_click=add).props("outline no-caps")
        button.set_enabled(not session.busy)
        columns = ", ".join(one for one in opened.recordings[0].columns if one != OUTPUT)
        ui.label(f"recorded: {columns}").classes("quiet small")
