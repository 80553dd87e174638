"""Take away: the model, the report, and the command lines that do the same."""

from pathlib import Path

from nicegui import run, ui

from cruise.workbench import commands, report
from cruise.workbench.page import Page
from cruise.workbench.parts import card, heading, nothing_open, number


def show(page: Page) -> None:
    """The whole view."""
    session = page.session
    heading("Take away", "Everything that was done here, to use and to show.")
    if nothing_open(page):
        return
    step = session.step
    assert step is not None
    with ui.element("div").classes("grid3"):
        with card("Model"):
            if step.added is not None:
                path: Path = step.added.path
                error = step.compared.error_mps if step.compared else float("nan")
                worse = commands.no_better(step)
                if worse:
                    ui.label(f"{worse}.").classes("bad")
                what = "the model" if worse else "the model that estimator and controller run"
                ui.label(
                    f"{step.name}: {what}, with its history. cruise compare on this recording prints {number(error)} "
                    "m/s."
                ).classes("quiet")
                ui.button(
                    "Model file",
                    icon="download",
                    on_click=lambda: ui.download.content(path.read_bytes(), "better.yaml"),
                ).props("unelevated no-caps").style("align-self:flex-start")
            elif Path(step.question.model).is_file():
                ui.label(
                    f"{step.question.model}, as it was opened. Another file comes with the first effect that is added."
                ).classes("quiet measure")
            else:
                ui.label(
                    "The model is a structure that is fitted wherever it is used. A file comes with the first effect "
                    "that is added."
                ).classes("quiet")
        with card("Report"):
            ui.label("Every figure, sentence and picture of this work in one file that needs nothing else.").classes(
                "quiet"
            )
            with ui.row().classes("gap-2"):

                async def pdf() -> None:
                    made = await run.io_bound(report.as_pdf, session)
                    if made is not None:  # the server is going down
                        ui.download.content(made, "cruise-report.pdf")

                ui.button(
                    "HTML",
                    icon="download",
                    on_click=lambda: ui.download.content(report.as_html(session), "cruise-report.html"),
                ).props("unelevated no-caps")
                ui.button("PDF", icon="download", on_click=pdf).props("outline no-caps")
        with card("Settings of the columns"):
            columns = commands.column_settings(session)
            if columns:
                ui.label("What the columns mean, for the option --columns of every verb.").classes("quiet")
                ui.button(
                    commands.COLUMNS,
                    icon="download",
                    on_click=lambda: ui.download.content(columns, commands.COLUMNS),
                ).props("outline no-caps").style("align-self:flex-start")
            else:
                ui.label("The columns have cruise's own names: nothing has to be said about them.").classes("quiet")
    with card("The same on the command line"):
        text = "\n".join(commands.lines(session))
        ui.label(text).classes("formula mono")
        ui.button("Copy", icon="content_copy", on_click=lambda: ui.clipboard.write(text)).props("flat no-caps").style(
            "align-self:flex-start"
        )
