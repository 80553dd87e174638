"""Where it fails: the error by regime as a map, in words, and on the time axis."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from nicegui import events, ui

from cruise.workbench import theme
from cruise.workbench.found import Cells, Compared
from cruise.workbench.page import Page
from cruise.workbench.parts import bars, card, heading, legend, not_compared, nothing_open, row_button
from cruise.workbench.timeline import Mark, Timeline
from cruise.workbench.views.tracks import timeline

LISTED = 6  # cells and regimes in words
LEAST_WRITTEN = 0.01  # share of time and error from which a cell's figures stand in it
HALF_LIGHT = 0.47  # of Cividis, where black and white are read alike: either is 4.6 times as light or dark
JOINED_S = 2.0  # stretches closer than that are one


def show(page: Page) -> None:
    """The whole view."""
    heading(
        "Where it fails",
        "The error sorted by what the machine was doing. More error than time in a regime says where to look.",
    )
    if nothing_open(page):
        return
    step = page.session.step
    compared = step.compared if step else None
    if compared is None:
        not_compared(page, "The errors are being sorted.")
        return
    with ui.element("div").classes("grid2 wide-left"):
        with card("RMS error by regime"):
            chart = _Map(page, compared)
        with card("In words"):
            _words(page, compared)
            chart.choices()
    with card("On the time axis"):
        chart.curve = timeline(page, compact=True, marks=chart.marks()[0])
        _stretches(page, compared, chart.curve)


class _Map:
    """The heat map, its list for the keyboard, and what a choice does."""

    def __init__(self, page: Page, compared: Compared) -> None:
        self.page, self.compared = page, compared
        self.curve: Timeline | None = None
        self.cells = compared.cells
        if self.cells is None:
            ui.label("Fewer than two quantities move in this recording: there is no map of regimes.").classes("quiet")
            return
        plot = ui.plotly(_figure(self.cells, page)).classes("w-full")
        plot.props('role="img" aria-label="heat map of the error; the list below holds the same"')
        plot.on("plotly_click", self._clicked, args=None)
        ui.label("Share of the squared error, in share of the time. A click shows it on the time axis.").classes(
            "quiet small"
        )

    def choices(self) -> None:
        """The cells with most error, as words that can be chosen."""
        if self.cells is not None:
            ui.label("Cells of the map").classes("subtitle").props("role=heading aria-level=2")
            self.listing = ui.column().classes("gap-0 w-full")
            self._list()

    def _clicked(self, event: events.GenericEventArguments) -> None:
        points = event.args.get("points") or []
        if points and self.cells is not None:
            row, column = self.cells.row_labels.index(points[0]["y"]), self.cells.column_labels.index(points[0]["x"])
            self.choose(row, column)

    def choose(self, row: int, column: int) -> None:
        """Mark the stretches of a cell and jump to the worst; once more lets go."""
        session = self.page.session
        session.cell = None if session.cell == (row, column) else (row, column)
        self._list()
        marks, worst = self.marks()
        if self.curve is not None:
            self.curve.mark(marks)
            if worst is not None:
                self.curve.jump(worst.low_s, worst.high_s)

    def marks(self) -> tuple[Sequence[Mark], Mark | None]:
        """The stretches of the cell that is chosen, and the worst of them."""
        session = self.page.session
        if self.cells is None or session.cell is None:
            return [], None
        return stretches_of(self.cells, self.compared, session.cell, session.recording)

    def _list(self) -> None:
        cells, session = self.cells, self.page.session
        if cells is None:
            return
        order = np.argsort(-(cells.error_share - cells.time_share), axis=None)[:LISTED]
        self.listing.clear()
        with self.listing:
            for row, column in zip(*np.unravel_index(order, cells.error_share.shape), strict=True):
                error, time = cells.error_share[row, column], cells.time_share[row, column]
                if error <= time:
                    continue
                place = int(row), int(column)
                with row_button(session.cell == place).on("click", partial(self.choose, *place)):
                    ui.label(f"{100 * error:.0f} % of the error in {100 * time:.0f} % of the time").classes(
                        "num strong"
                    )
                    ui.label(cells.words(*place)).classes("quiet small")


def stretches_of(
    cells: Cells, compared: Compared, cell: tuple[int, int], recording: int
) -> tuple[Sequence[Mark], Mark | None]:
    """The stretches of one recording that lie in a cell, and the one with the greatest squared error."""
    curves = compared.predicted
    time_s, error = curves.recordings[recording].time_s, np.nan_to_num(curves.errors_mps[recording])
    number = cell[0] * len(cells.column_labels) + cell[1]
    inside = np.flatnonzero(cells.number[recording] == number)
    if not len(inside):
        return [], None
    period_s = curves.recordings[recording].dt_s
    parts = np.split(inside, np.flatnonzero(np.diff(time_s[inside]) > JOINED_S) + 1)
    energy = [float(np.sum(error[part] ** 2)) for part in parts]
    worst = int(np.argmax(energy))
    marks = [
        Mark(float(time_s[part[0]]) - period_s, float(time_s[part[-1]]), strong=place == worst)
        for place, part in enumerate(parts)
    ]
    return marks, marks[worst]


def _words(page: Page, compared: Compared) -> None:
    colors = page.colors
    named = [one for one in compared.regimes if one.named]
    if named:
        legend([("of the squared error", colors.error, "patch"), ("of the time", colors.muted, "patch")])
    if not named and not compared.leaves:
        ui.label("No regime holds more of the error than noise would give it: it fails everywhere alike.")
    for one in named[:LISTED]:
        with ui.column().classes("gap-1 w-full"):
            ui.label(one.sentence)
            bars(one.error_share, colors.error, f"{100 * one.error_share:.0f} % of the squared error")
            bars(one.time_share, colors.muted, f"{100 * one.time_share:.0f} % of the time")
    for sentence in compared.leaves[:3]:
        with ui.column().classes("gap-0"):
            ui.label(sentence)
            ui.label("found by a tree over all signals, confirmed on data that did not grow it").classes("quiet small")
    rest = [one for one in compared.regimes if not one.named]
    if rest:
        with ui.expansion(f"{len(rest)} more that noise could explain").props("dense").classes("w-full"):
            for one in rest:
                ui.label(one.sentence).classes("quiet small")


def _stretches(page: Page, compared: Compared, curve: Timeline) -> None:
    mine = [one for one in compared.stretches if one.recording == page.session.recording]
    if not mine:
        return
    ui.label("Worst stretches").classes("subtitle").props("role=heading aria-level=2")
    with ui.column().classes("gap-0 w-full"):
        for one in mine:

            def jump(one: Any = one) -> None:
                curve.mark([Mark(one.start_s, one.end_s, strong=True)])
                curve.jump(one.start_s, one.end_s)

            with row_button().on("click", jump):
                ui.label(
                    f"{one.start_s:.0f} to {one.end_s:.0f} s, {100 * one.error_share:.0f} % of the squared error"
                ).classes("num strong")
                ui.label(one.sentence).classes("quiet small")


def _figure(cells: Cells, page: Page) -> dict[str, Any]:
    colors = page.colors
    shown = np.where(cells.time_share > 0.0, cells.rmse_mps, np.nan)
    written = np.maximum(cells.time_share, cells.error_share) >= LEAST_WRITTEN
    text = [
        [
            f"{100 * cells.error_share[i, j]:.0f} %<br>in {100 * cells.time_share[i, j]:.0f} %" if written[i, j] else ""
            for j in range(shown.shape[1])
        ]
        for i in range(shown.shape[0])
    ]
    top = float(np.nanmax(shown))
    height = 120 + 58 * shown.shape[0]
    layout = theme.layout(
        colors,
        max(height, 300),
        margin={"l": 110, "r": 8, "t": 8, "b": 56},
        xaxis=theme.axis(
            colors,
            title=_title(cells.columns, colors),
            type="category",
            fixedrange=True,
            showgrid=False,
        ),
        yaxis=theme.axis(colors, title=_title(cells.rows, colors), type="category", fixedrange=True, showgrid=False),
    )
    bar = {
        "thickness": 10, "outlinewidth": 0, "tickfont": {"size": 11, "color": colors.muted},
        "title": {"text": "m/s", "font": {"size": 11, "color": colors.muted}, "side": "top"}, "nticks": 5,
    }  # fmt: skip
    heat: dict[str, Any] = {
        "type": "heatmap", "x": list(cells.column_labels), "y": list(cells.row_labels), "z": shown, "text": text,
        "colorscale": "Cividis", "xgap": 2, "ygap": 2, "zmin": 0.0, "zmax": top, "colorbar": bar,
        "hovertemplate": "%{y}, %{x}<br>RMS error %{z:.3f} m/s<br>%{text}<extra></extra>",
        "hoverongaps": False,
    }  # fmt: skip
    places = [(i, j) for i, j in np.ndindex(shown.shape) if text[i][j]]
    inks = ["#000000" if shown[place] > HALF_LIGHT * top else "#ffffff" for place in places]
    words = {
        "type": "scatter", "mode": "text", "hoverinfo": "skip", "textfont": {"size": 12, "color": inks},
        "x": [cells.column_labels[j] for _, j in places], "y": [cells.row_labels[i] for i, _ in places],
        "text": [text[i][j] for i, j in places],
    }  # fmt: skip
    return {"data": [heat, words], "layout": layout, "config": theme.STILL_CONFIG}


def _title(quantity: tuple[str, str], colors: theme.Theme) -> dict[str, Any]:
    words, unit = quantity
    return {
        "text": f"{words} ({unit or 'state'})", "font": {"size": 12, "color": colors.muted}, "standoff": 14,
    }  # fmt: skip
