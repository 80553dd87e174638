"""Small pieces that several views are made of."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from nicegui import ui

from cruise.workbench.page import Page

NO_FIGURE: Final = "\u2013"


def heading(title: str, lead: str = "") -> None:
    """The title of a view, and what it is for."""
    with ui.column().classes("gap-1 w-full"):
        ui.label(title).props("role=heading aria-level=1").classes("title")
        if lead:
            ui.label(lead).classes("lead")


@contextmanager
def card(title: str = "", hint: str = "") -> Iterator[None]:
    """A framed part of a view."""
    with ui.element("section").classes("card"):
        if title:
            label = ui.label(title).props("role=heading aria-level=2").classes("subtitle")
            if hint:
                label.classes("hint").style("align-self:flex-start").props("tabindex=0")
                with label:
                    ui.tooltip(hint)
        yield


def number(value: float, digits: int = 4) -> str:
    """A figure with so many decimals; a dash where there is none."""
    return f"{value:.{digits}f}".replace("-", "\u2212") if math.isfinite(value) else NO_FIGURE


def speed(value_mps: float) -> str:
    """An error in m/s with three digits that count."""
    if not math.isfinite(value_mps):
        return NO_FIGURE
    decimals = min(max(2 - math.floor(math.log10(abs(value_mps))), 2), 6) if value_mps else 3
    return f"{value_mps:.{decimals}f}"


def figure(value: str, unit: str, words: str, hint: str = "", tone: str = "") -> None:
    """One large figure with what it is below."""
    with ui.column().classes("gap-0"):
        with ui.element("div").classes(f"figure {tone}"):
            ui.label(value).style("display:inline")
            ui.label(unit).style("display:inline; font-size:13px; color:var(--muted); margin-left:5px")
        label = ui.label(words).classes("quiet small")
        if hint:
            label.classes("hint").props("tabindex=0").style("align-self:flex-start")
            with label:
                ui.tooltip(hint)


def busy() -> None:
    """Something is under way: a dot that comes and goes, which costs the browser next to nothing."""
    ui.element("span").classes("busy").props("aria-hidden=true")


def labelled(element: ui.element, words: str) -> None:
    """Say what an element is; the words may come from a file, so that nothing in them is read as a property."""
    element.props["aria-label"] = words


def bars(share: float, color: str, words: str) -> None:
    """A share as a bar."""
    bar = ui.element("div").classes("bar").props("role=img")
    labelled(bar, words)
    with bar:
        ui.element("div").style(f"width:{100 * min(max(share, 0.0), 1.0):.1f}%; background:{color}")


def legend(entries: Sequence[tuple[str, str, str]]) -> None:
    """Names with their colours; kind is line, dash or patch."""
    with ui.element("div").classes("legend"):
        for name, color, kind in entries:
            with ui.element("span"):
                key = ui.element("span").classes("key patch" if kind == "patch" else "key")
                if kind == "patch":
                    key.style(f"background:{color}")
                else:
                    key.style(f"border-color:{color}; border-top-style:{'dashed' if kind == 'dash' else 'solid'}")
                ui.label(name).style("display:inline")


def row_button(here: bool = False) -> ui.element:
    """A line of a list that can be chosen, by keyboard too."""
    return ui.element("button").props("type=button").classes("row-button here" if here else "row-button")


def nothing_open(page: Page) -> bool:
    """Says so where no recording is open, or no model is judged yet; whether that is so."""
    session = page.session
    if session.opened is None:
        with card():
            ui.label("No recording is open." if not session.busy else "The recording is being read.")
            if not session.busy:
                ui.button("Open a recording", on_click=lambda: page.go("/")).props("unelevated no-caps").style(
                    "align-self:flex-start"
                )
        return True
    if session.step is None or session.step.curves is None:
        not_compared(page, "The model is being judged.")
        return True
    return False


def not_compared(page: Page, meanwhile: str) -> None:
    """Stands where the comparison is not there, or not all of it; `meanwhile` is said as long as something runs."""
    with card():
        if page.session.busy:
            with ui.row().classes("items-center gap-3"):
                busy()
                ui.label(meanwhile)
        else:
            ui.label("There is no comparison of this model yet.")
            ui.button("Compare", on_click=page.do(page.session.compare)).props("unelevated no-caps").style(
                "align-self:flex-start"
            )
