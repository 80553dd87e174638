"""Open: a recording of one's own or a bundled one, and the model that it is compared with."""

from dataclasses import replace
from pathlib import Path

from msgspec import structs
from nicegui import events, ui

from cruise.identification.structures import PRESETS
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.workbench.examples import EXAMPLES, Example
from cruise.workbench.found import Opened, Question, Source
from cruise.workbench.page import Page
from cruise.workbench.parts import card, heading
from cruise.workbench.session import MODEL
from cruise.workbench.uploads import DATABASE, ENDINGS, kept
from cruise.workbench.views import mapping

FIRST = (MODEL, *(name for name in PRESETS if not name.startswith("narx")))
SHOWN_NOTES = 4
SUGGESTED = "models"  # the list below the field of the model


def show(page: Page) -> None:
    """The whole view."""
    session = page.session
    heading(
        "Open a recording",
        "A drive with time, pump current and speed is enough. Further signals are what effects are recognised by.",
    )
    with ui.element("div").classes("grid2 wide-left"):
        with card("Your own"):
            _upload(page)
        with card("Bundled, from the virtual combine"):
            for example in EXAMPLES:
                _example(page, example)
    if session.asked is not None and not session.busy:
        mapping.show(page, session.asked)
    with card("The model that is compared"):
        _model(page)
    if session.opened is not None:
        _opened(page, session.opened)


def _upload(page: Page) -> None:
    setup, session = page.setup, page.session

    async def uploaded(event: events.MultiUploadEventArguments) -> None:
        paths = await kept(event.files, session.uploads)
        refused = [file.name for file, path in zip(event.files, paths, strict=True) if path is None]
        if refused:
            session.fault = f"{', '.join(refused)}: recordings end in {' '.join(ENDINGS)}"
        good = tuple(path for path in paths if path is not None and path.suffix.lower() != DATABASE)
        databases = [str(path) for path in paths if path is not None and path not in good]
        if good and not refused:
            title = good[0].name if len(good) == 1 else f"{good[0].name} and {len(good) - 1} more"
            database = databases[0] if databases else setup.reading.database
            session.open(Source(good, structs.replace(setup.reading, database=database), title))
        elif databases and not refused:
            session.fault = f"{Path(databases[0]).name}: drop it together with the logs that it describes"
        page.refresh()

    ui.upload(
        label="Drop files here, or press +",
        multiple=True,
        auto_upload=True,
        max_file_size=setup.upload_bytes,
        max_total_size=setup.upload_bytes,
        on_multi_upload=uploaded,
        on_rejected=lambda: ui.notify(
            f"Not taken: a recording ends in {' '.join(ENDINGS)} and has at most {setup.upload_bytes / 2**20:.0f} MB.",
            type="warning",
        ),
    ).props(f'flat accept="{",".join(ENDINGS)}" aria-label="recordings"')
    ui.label(
        "Tables (.csv, .parquet), measurements (.mf4), logs of the bus (.log, .asc, .blf, .trc, .db, also .gz; with "
        "them their .dbc, if it is not cruise's). Several files are one experiment each and are never joined."
    ).classes("quiet small")


def _example(page: Page, example: Example) -> None:
    def begin() -> None:
        page.session.open_example(example)
        page.refresh()

    with (
        ui.element("button")
        .props(f'type=button data-example="{example.name}"')
        .classes("row-button")
        .on("click", begin)
    ):
        ui.label(example.title).classes("strong")
        ui.label(example.words).classes("quiet small")


def _model(page: Page) -> None:
    session = page.session
    question = session.refused or (session.steps[0].question if session.steps else Question(MODEL))
    with ui.row().classes("items-end gap-4 w-full"):
        with ui.element("datalist").props(f"id={SUGGESTED}"):
            for name in FIRST:
                ui.element("option").props(f'value="{name}"')
        model = ui.input("Name, or structure written out", value=question.model)
        model.props(f"outlined dense list={SUGGESTED}").style("width:340px")
        horizon = (
            ui.number("Judged ahead (s)", value=question.horizon_s, min=0.2, max=60, step=0.5)
            .props("outlined dense")
            .style("width:150px")
        )

        def again() -> None:
            if session.steps:
                session.ask(
                    replace(
                        session.steps[0].question,
                        model=str(model.value).strip(),
                        horizon_s=float(horizon.value or 0.0),
                    )
                )
                page.refresh()

        model.on("keydown.enter", again)
        button = ui.button("Compare with this model", on_click=again).props("outline no-caps")
        button.set_enabled(session.opened is not None)
    ui.label(
        "The paper's structures by name, or written out: arx:na=1,nb=3,delay_s=0.5+dead_zone. A structure is fitted to "
        "the recording first."
    ).classes("quiet small")


def _opened(page: Page, opened: Opened) -> None:
    with card(opened.source.title):
        with ui.element("table").classes("figures"):
            with ui.element("tr"):
                for words in ("recording", "length", "rate", "samples"):
                    with ui.element("th"):
                        ui.label(words)
            for one in opened.recordings:
                with ui.element("tr"):
                    cells = (
                        Path(one.source).name,
                        f"{len(one) * one.dt_s:.0f} s",
                        f"{1.0 / one.dt_s:.4g} Hz",
                        f"{len(one):,}",
                    )
                    for text in cells:
                        with ui.element("td"):
                            ui.label(text).style("overflow-wrap:anywhere")
        first = opened.recordings[0]
        with ui.row().classes("gap-2"):
            for name in first.columns:
                known = SIGNALS.get(name)
                role = {INPUT: "input", OUTPUT: "output"}.get(name, "")
                with ui.label(f"{role}: {name}" if role else name).classes("chip now" if role else "chip"):
                    ui.tooltip(f"{known.meaning}, in {known.unit}" if known else "a signal that cruise has no name for")
        for note in opened.notes[:SHOWN_NOTES]:
            ui.label(note).classes("quiet small")
        if len(opened.notes) > SHOWN_NOTES:
            with ui.expansion(f"and {len(opened.notes) - SHOWN_NOTES} more").props("dense"):
                for note in opened.notes[SHOWN_NOTES:]:
                    ui.label(note).classes("quiet small")
        with ui.row().classes("gap-3 items-center"):
            ui.button("Compare", on_click=lambda: page.go("/compare")).props("unelevated no-caps")
            ui.button("Change what the columns mean", on_click=page.do(page.session.ask_columns)).props("flat no-caps")
