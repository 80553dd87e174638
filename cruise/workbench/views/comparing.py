"""Compare: measured and predicted over one time axis, and the fit beside what is possible."""

from pathlib import Path

from nicegui import ui

from cruise.signals import INPUT, OUTPUT
from cruise.validation.quantities import spoken
from cruise.workbench.found import Compared
from cruise.workbench.page import Page
from cruise.workbench.parts import card, figure, heading, not_compared, number, speed
from cruise.workbench.views.tracks import timeline

EXPLAINED = "How much of the variance of the speed the prediction explains. It is blind to a constant error."
NRMSE = "1 minus the RMS error over the standard deviation of the speed; 100 % is perfect, 0 % as good as the mean."
RMSE = "The root of the mean squared error: the figure that everything else here is measured by."
MEAN = "The constant part of the error; + means that the machine is faster than predicted."


def show(page: Page) -> None:
    """The whole view."""
    session = page.session
    heading("Compare", "What the machine did, and what the model says it should have done.")
    if session.opened is None:
        with card():
            ui.label("No recording is open.")
            ui.button("Open a recording", on_click=lambda: page.go("/")).props("unelevated no-caps").style(
                "align-self:flex-start"
            )
        return
    compared = session.step.compared if session.step else None
    if compared is not None:
        _headline(compared)
    with card():
        _choices(page)
        timeline(page)
        ui.label(
            "Drag to move, scroll to zoom, double-click for all of it. Shaded green: twice the noise floor on either "
            "side of no error."
            if compared
            else "Drag to move, scroll to zoom, double-click for all of it."
        ).classes("quiet small")
    if compared is not None:
        _table(compared)
    elif not session.busy:
        not_compared(page, "")


def _headline(compared: Compared) -> None:
    ahead = compared.figures[0]
    rows = {one.name: one for one in compared.figures}
    if compared.not_held_out:
        ui.label(f"The model was fitted before: {compared.not_held_out}.").classes("quiet measure")
    with ui.row().classes("gap-12"):
        figure(speed(ahead.rmse_mps), "m/s", f"RMS error, {ahead.name}", ahead.words)
        for name, words in (("floor at most", "a flexible model reaches"), ("persistence", "persistence")):
            if name in rows:
                figure(speed(rows[name].rmse_mps), "m/s", words, rows[name].words)
        figure(number(ahead.explained_pct, 1), "%", "of the variance explained", EXPLAINED)


def _choices(page: Page) -> None:
    session = page.session
    assert session.opened is not None
    recordings = session.opened.recordings
    with ui.row().classes("items-center gap-3 w-full"):
        if len(recordings) > 1:

            def other(event: object) -> None:
                session.recording, session.window = int(chosen.value or 0), None
                page.refresh()

            names = {i: Path(one.source).name for i, one in enumerate(recordings)}
            chosen = ui.select(names, value=session.recording, label="Recording", on_change=other)
            chosen.props("outlined dense").style("width:240px")
        context = {
            name: " ".join(filter(None, (spoken(name)[0], f"({spoken(name)[1]})" if spoken(name)[1] else "")))
            for name in recordings[session.recording].columns
            if name not in (INPUT, OUTPUT)
        }
        if context:

            def signals() -> None:
                session.context = list(shown.value or [])
                page.refresh()

            shown = ui.select(
                context,
                value=[one for one in session.context if one in context],
                label="Further signals",
                multiple=True,
                on_change=signals,
            )
            shown.props('outlined dense use-chips options-dense aria-label="further signals"').style("min-width:260px")
        else:
            ui.label("The recording holds current and speed only: no context signals.").classes("quiet")

        def free() -> None:
            session.free_run = bool(switch.value)
            page.refresh()

        switch = ui.switch("free run", value=session.free_run, on_change=free)
        with switch:
            ui.tooltip("The model on its own from the first sample, never corrected by a measurement.")


def _table(compared: Compared) -> None:
    with card("How good, and how good at best"):
        with ui.element("table").classes("figures"):
            with ui.element("tr"):
                for words, hint in (
                    ("", ""), ("RMS error (m/s)", RMSE), ("mean error (m/s)", MEAN), ("NRMSE (%)", NRMSE),
                    ("explained (%)", EXPLAINED),
                ):  # fmt: skip
                    with ui.element("th"):
                        label = ui.label(words)
                        if hint:
                            label.classes("hint").style("display:inline").props("tabindex=0")
                            with label:
                                ui.tooltip(hint)
            for one in compared.figures:
                with ui.element("tr"):
                    with (
                        ui.element("td"),
                        ui.label(one.name).classes("hint").style("display:inline").props("tabindex=0"),
                    ):
                        ui.tooltip(one.words)
                    for text in (
                        number(one.rmse_mps),
                        number(one.mean_error_mps),
                        number(one.nrmse_pct, 1),
                        number(one.explained_pct, 1),
                    ):
                        with ui.element("td"):
                            ui.label(text)
        ui.label(f"The model was {compared.how}.").classes("quiet small measure")
        for sentence in compared.floor_words:
            ui.label(sentence).classes("quiet small measure")
