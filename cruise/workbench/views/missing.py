"""What is missing: the search with its progress, then the verdict and one card a candidate."""

import math
from typing import Final

from nicegui import ui

from cruise.workbench import plots, theme
from cruise.workbench.found import Card, Diagnosed
from cruise.workbench.page import Page
from cruise.workbench.parts import bars, busy, card, figure, heading, legend, nothing_open, row_button, speed
from cruise.workbench.session import SEARCH, Session

TRIED_SHOWN: Final = 48
WORDS: Final = {
    "missing": "An effect is missing, and it is this one.",
    "several": "Effects are missing, and it is these.",
    "nothing": "Nothing is missing.",
    "unlisted": "Something is missing that is none of the effects that cruise knows.",
    "ambiguous": "Something is missing, and this recording can't tell which of these it is.",
}


def show(page: Page) -> None:
    """The whole view."""
    session = page.session
    heading(
        "What is missing",
        "Every physical effect is fitted jointly with the drive and judged on parts of the recording that its fit has "
        "not seen. A curve without physics runs along, so that what is in no table is noticed too.",
    )
    if nothing_open(page):
        return
    found = session.step.diagnosed if session.step else None
    if session.busy and session.job is not None and session.job.title == SEARCH:
        _progress(page)
    elif found is None:
        _ask(page)
    else:
        _verdict(page, found)


def _ask(page: Page) -> None:
    session = page.session
    rest = session.found_before
    if rest:
        with card("Found before, and not added yet"):
            ui.label(
                f"The search that named what was added named {' and '.join(rest)} with it, fitted jointly. A new "
                "search says what the model as it is now still lacks."
            ).classes("measure")
            with ui.row().classes("gap-3"):
                for name in rest:
                    _add(page, name, "unelevated")
    with card():
        ui.label("The search takes a minute or so, longer where several effects are missing. It can be stopped.")
        button = ui.button("What is missing?", on_click=page.do(session.diagnose)).props("unelevated no-caps")
        button.style("align-self:flex-start")
        button.set_enabled(not session.busy)
        if session.busy:
            ui.label("The comparison under way has to end first.").classes("quiet small")


def _progress(page: Page) -> None:
    session = page.session
    with card("Looking"):
        with ui.row().classes("items-center gap-3"):
            busy()
            ui.label().bind_text_from(session, "job", lambda job: job.told[-1] if job and job.told else "starting")
        tried = ui.element("div").style("display:flex; flex-wrap:wrap; gap:6px")
        chips: dict[str, ui.label] = {}

        def update() -> None:
            names = _tried(session)[:TRIED_SHOWN]
            for name in names[len(chips) :]:
                with tried:
                    chips[name] = ui.label(name).classes("chip")
            for name, chip in chips.items():
                now = bool(session.job and session.job.told and session.job.told[-1].endswith(f" {name}"))
                chip.classes(add="now" if now else "", remove="" if now else "now")

        update()
        ui.timer(0.3, update)
        ui.button("Stop", on_click=page.do(session.cancel)).props("outline no-caps").style("align-self:flex-start")


def _tried(session: Session) -> list[str]:
    job = session.job
    told = job.told if job else []
    return list(dict.fromkeys(text.removeprefix("tried ") for text in told if text.startswith("tried ")))


def floor_of(least_mps: float, most_mps: float) -> tuple[float, str, str]:
    """The noise floor, from below where it is known: its value, its name and a hint."""
    if math.isfinite(least_mps):
        return least_mps, "noise floor", "No model errs by less: the white part of the measured speed."
    return most_mps, "noise floor, at most", "What a flexible statistical model reaches on the same signals."


def _verdict(page: Page, found: Diagnosed) -> None:
    session, colors = page.session, page.colors
    tone = {"nothing": "calm", "unlisted": "open", "ambiguous": "open"}.get(found.verdict, "")
    with ui.column().classes("gap-4 w-full"):
        with ui.element("div").classes(f"verdict {tone}").props(f'data-verdict="{found.verdict}" aria-live="polite"'):
            several = found.verdict == "missing" and len(found.effects) > 1
            ui.label(WORDS["several" if several else found.verdict]).classes("strong")
            ui.label(found.sentence).style("font-size:14px").classes("quiet")
        with ui.row().classes("gap-12"):
            figure(speed(found.error_before_mps), "m/s", "error of the model, refitted")
            if found.explained:
                figure(speed(found.error_after_mps), "m/s", f"with {found.minute.label}", tone="good")
            floor_mps, *words = floor_of(*found.floor_mps)
            figure(speed(floor_mps), "m/s", *words)
    if found.verdict == "nothing":
        with card("What could have hidden"):
            ui.label(
                f"An effect that moves the speed {found.horizon_s:g} s ahead by less than "
                f"{speed(found.hidden_mps)} m/s RMS would not have been named. The candidates below came nearest; none "
                "is to be believed."
            ).classes("measure")
    if found.core:
        with card("The drive itself"):
            for said in found.core:
                ui.label(f"{said[:1].upper()}{said[1:]}.").classes("measure")
    undecided = found.verdict in ("unlisted", "ambiguous") or (found.verdict == "missing" and not found.explained)
    if undecided and found.next_experiment:
        with card("The drive that tells"):
            for sentence in found.next_experiment:
                ui.label(sentence).classes("measure")
    if found.hints:
        with card("A column that may be known"):
            for sentence in found.hints:
                ui.label(f"{sentence[:1].upper()}{sentence[1:]}.").classes("measure")
    with card("The minute in which it matters most" if found.explained else "The minute of the best of them"):
        legend(
            [
                ("measured", colors.measured, "line"),
                ("the model as it is", colors.other, "dash"),
                (f"with {found.minute.label}", colors.model, "line"),
            ]
        )
        plots.minute(found.minute, colors)
    chosen = [one for one in found.cards if one.chosen]
    rest = [one for one in found.cards if not one.chosen]
    for place, one in enumerate(chosen, 1):
        with card():
            _card(page, found, one, place)
    if rest:
        title = "What else was tried" if chosen else "What was tried"
        with card(title, "Each effect alone beside the model, judged on what its fit has not seen."):
            for place, one in enumerate(rest, len(chosen) + 1):
                _row(page, found, one, place)
            if found.others:
                with ui.expansion(f"{len(found.others)} more that explain less").props("dense").classes("w-full quiet"):
                    for name, error_mps, gain in found.others:
                        with ui.row().classes("items-center w-full gap-4 small").style("padding:2px 16px"):
                            ui.label(name).style("width:170px")
                            ui.label(f"{speed(error_mps)} m/s").classes("num").style("width:90px; text-align:right")
                            ui.label(f"explains {max(100 * gain, 0):.0f} %").classes("num")
    if found.refused:
        with card("What this recording can't speak of"), ui.element("table").classes("figures"):
            for name, reason in found.refused:
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(name)
                    with ui.element("td").classes("words"):
                        ui.label(reason).classes("quiet small").style("white-space:normal")
    with ui.row():
        again = ui.button("Search again", on_click=page.do(session.diagnose)).props("flat no-caps")
        again.set_enabled(not session.busy)


def _row(page: Page, found: Diagnosed, one: Card, place: int) -> None:
    with row_button().props("aria-expanded=false") as row, ui.element("div").classes("tried"):
        ui.label(one.effect).classes("strong").style("overflow-wrap:anywhere")
        ui.label(f"{speed(one.error_after_mps)} m/s").classes("num").style("text-align:right")
        with ui.element("div").classes("share"):
            bars(max(one.gain, 0.0), page.colors.muted, f"explains {100 * one.gain:.0f} % of the squared error")
        ui.label(f"explains {max(100 * one.gain, 0):.0f} %").classes("num quiet small")
        mark = ui.icon("expand_more").classes("quiet mark")
    inside = ui.column().classes("gap-3 w-full").style("padding:8px 10px 16px")
    inside.set_visibility(False)

    def turn() -> None:
        """Open or close it; the charts of what is closed are not there at all."""
        opened = not inside.visible
        inside.clear()
        inside.set_visibility(opened)
        row.props(f"aria-expanded={str(opened).lower()}")
        mark.set_name("expand_less" if opened else "expand_more")
        if opened:
            with inside:
                _card(page, found, one, place)

    row.on("click", turn)


def _in_step(one: Card) -> str:
    return f" in step {one.step}" if one.step else ""


def _card(page: Page, found: Diagnosed, one: Card, place: int) -> None:
    colors = page.colors
    with ui.row().classes("items-start w-full gap-6"):
        with ui.column().classes("gap-1").style("flex:1; min-width:min(260px, 100%)"):
            ui.label(f"{place}. {one.effect}").style("font-size:18px; font-weight:500").props(
                "role=heading aria-level=2"
            )
            ui.label(one.headline[:1].upper() + one.headline[1:]).classes("quiet")
        with ui.row().classes("gap-8"):
            figure(
                f"{speed(one.error_before_mps)} → {speed(one.error_after_mps)}",
                "m/s",
                f"held-out error{_in_step(one)}, without and with it",
                f"The squared error falls by {100 * one.gain:.0f} %, {one.sureness:.1f} standard errors over blocks of "
                "time.",
            )
            figure(
                one.confidence_words,
                "",
                "confidence",
                "That it is this effect and no other of the table, as often as it was in blind trials on the virtual "
                "combine.",
            )
    if one.counts < 0.995:
        ui.label(f"Only {100 * one.counts:.0f} % of what it explains counts, {found.discounted}.").classes(
            "quiet small"
        )
    ui.label(one.physics).classes("measure")
    if one.equation:
        ui.label(one.equation).classes("formula mono")
    with ui.element("div").classes("grid2 evidence"):
        with ui.column().classes("gap-1 w-full"):
            ui.label(f"Does what the model leaves follow the effect{_in_step(one)}?").classes("strong small")
            legend([("without it", colors.other, "line"), ("with it", colors.model, "line")])
            plots.signature(one.signature, one.effect, colors)
        if one.curve is not None:
            with ui.column().classes("gap-1 w-full"):
                together = " with all of them" if one.step else ""
                ui.label(f"What it does, as fitted{together}").classes("strong small")
                keys = [("without it", colors.other, "dash"), ("with it", colors.model, "line")]
                if one.curve.bands:
                    keys.append(("± 2 standard errors", theme.faint(colors.model, 0.3), "patch"))
                if one.curve.driven is not None:
                    keys.append(("how often it was driven", colors.line, "patch"))
                legend(keys)
                plots.curve(one.curve, one.effect, colors)
    if one.numbers:
        with ui.element("table").classes("figures").style("max-width:760px"):
            with ui.element("tr"):
                for words in ("parameter", "value", "±", "unit", "plausible", ""):
                    with ui.element("th").classes("words" if words in ("unit", "") else ""):
                        ui.label(words)
            for number in one.numbers:
                with ui.element("tr"):
                    cells = (number.name, number.value, number.std, number.unit, number.span, number.remark)
                    for k, text in enumerate(cells):
                        with ui.element("td").classes("words" if k in (3, 5) else ""):
                            ui.label(text)
    if one.look_alikes:
        with ui.expansion(f"{len(one.look_alikes)} that look alike").props("dense").classes("w-full"):
            for sentence in one.look_alikes:
                ui.label(sentence).classes("small").style("padding:2px 16px")
    with ui.expansion("The drive that tells it from them").props("dense").classes("w-full"):
        ui.label(one.experiment).classes("small measure").style("padding:2px 16px")
    if one.listed:
        with ui.row().classes("items-center gap-3"):
            _add(page, one.effect, "unelevated" if one.worth_adding else "outline")
            if not one.chosen and found.verdict != "ambiguous":
                ui.label("The evidence does not ask for it.").classes("quiet small")
            elif one.chosen and not one.worth_adding and found.verdict == "missing":
                ui.label("No constant delay is a model of one that changes: it brings little.").classes("quiet small")


def _add(page: Page, effect: str, look: str) -> None:
    """The button that adds an effect."""

    def add() -> None:
        page.session.add(effect)
        page.go("/add")

    button = ui.button(f"Add {effect}", on_click=add).props(f"{look} no-caps")
    button.props["data-add"] = effect
    button.set_enabled(not page.session.busy)
