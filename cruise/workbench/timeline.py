"""Curves over one time axis, one track below the other: zoom and pan load the extremes of what is seen.

The browser never holds more than a few thousand points a curve; with every zoom it gets those of the new window, and
half a window more on both sides, so that a pan shows something before the server has answered.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from nicegui import events, ui

from cruise.workbench import theme
from cruise.workbench.downsample import extremes, window
from cruise.workbench.parts import labelled
from cruise.workbench.theme import Theme

BUCKETS: Final = 1100  # over twice the window: about one for two pixels
TITLE_PX: Final = 24  # between two tracks, for the title of the lower one
BOTTOM_PX: Final = 40
LEAST_S: Final = 0.5  # nothing moves in less
STEP: Final = 0.5  # of the window, by which buttons move it

Window = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Line:
    """One curve."""

    name: str
    time_s: np.ndarray
    values: np.ndarray
    color: str
    width: float = 1.3
    dash: str = "solid"


@dataclass(frozen=True, eq=False)
class Track:
    """Curves with one vertical axis; `band` is shaded between two values."""

    title: str
    unit: str
    lines: Sequence[Line]
    height_px: int
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Mark:
    """A stretch of time that is shaded."""

    low_s: float
    high_s: float
    strong: bool = False


class Timeline:
    """The chart and its buttons. `moved` is told every new window, None for the whole recording."""

    def __init__(
        self,
        tracks: Sequence[Track],
        colors: Theme,
        shown: Window | None,
        moved: Callable[[Window | None], None],
        marks: Sequence[Mark] = (),
    ) -> None:
        self.tracks, self.colors, self.moved = tracks, colors, moved
        self.lines = [line for track in tracks for line in track.lines]
        self.whole = min(float(line.time_s[0]) for line in self.lines), max(float(one.time_s[-1]) for one in self.lines)
        self.shown = shown
        self.marks = list(marks)
        with ui.column().classes("w-full gap-1"):
            self._buttons()
            self.plot = ui.plotly(self._figure()).classes("w-full").props('role="img" aria-label="curves over time"')
            self.plot.on("plotly_relayout", self._relaid, args=None)

    def jump(self, low_s: float, high_s: float, room: float = 0.6) -> None:
        """Show a stretch, with some room on both sides."""
        spare_s = max(room * (high_s - low_s), 4.0)
        self._go((low_s - spare_s, high_s + spare_s))

    def mark(self, marks: Sequence[Mark]) -> None:
        """Shade other stretches."""
        self.marks = list(marks)
        self.plot.run_plot_method("relayout", {"shapes": self._shapes()})

    def _buttons(self) -> None:
        with ui.row().classes("items-center gap-1 w-full"):
            with ui.element("div").classes("legend").style("flex:1; min-width:120px"):
                for name, color, dash in dict.fromkeys((one.name, one.color, one.dash) for one in self.tracks[0].lines):
                    with ui.element("span"):
                        ui.element("span").classes("key").style(
                            f"border-color:{color};border-top-style:{'dashed' if dash != 'solid' else 'solid'}"
                        )
                        ui.label(name).style("display:inline")
            for icon, words, act in (
                ("chevron_left", "earlier", lambda: self._shift(-STEP)),
                ("chevron_right", "later", lambda: self._shift(STEP)),
                ("zoom_in", "zoom in", lambda: self._zoom(0.5)),
                ("zoom_out", "zoom out", lambda: self._zoom(2.0)),
                ("fit_screen", "the whole recording", lambda: self._go(None)),
            ):
                button = ui.button(icon=icon, on_click=act).props("flat dense round size=sm").tooltip(words)
                labelled(button, words)

    def _shift(self, share: float) -> None:
        low_s, high_s = self.shown or self.whole
        by_s = share * (high_s - low_s)
        by_s = min(max(by_s, self.whole[0] - low_s), self.whole[1] - high_s)
        self._go((low_s + by_s, high_s + by_s))

    def _zoom(self, factor: float) -> None:
        low_s, high_s = self.shown or self.whole
        half_s = max(0.5 * factor * (high_s - low_s), LEAST_S)
        middle_s = 0.5 * (low_s + high_s)
        whole = 2.0 * half_s >= self.whole[1] - self.whole[0]
        self._go(None if whole else (middle_s - half_s, middle_s + half_s))

    def _go(self, shown: Window | None) -> None:
        self._show(shown, {"xaxis.range": list(shown or self.whole)})

    def _relaid(self, event: events.GenericEventArguments) -> None:
        told: dict[str, Any] = event.args
        if "xaxis.range[0]" in told:
            low_s, high_s = float(told["xaxis.range[0]"]), float(told["xaxis.range[1]"])
        elif "xaxis.range" in told:
            low_s, high_s = (float(one) for one in told["xaxis.range"])
        elif told.get("xaxis.autorange"):
            low_s, high_s = self.whole
        else:
            return
        shown = None if (low_s, high_s) == self.whole else (low_s, high_s)
        if shown != self.shown:
            self._show(shown, {})

    def _show(self, shown: Window | None, layout: dict[str, Any]) -> None:
        """The curves of another window, and the axes with them where they have not moved yet."""
        self.shown = shown
        self.moved(shown)
        curves = self._curves()
        self.plot.run_plot_method(
            "update", {"x": [x for x, _ in curves], "y": [y for _, y in curves]}, layout, list(range(len(curves)))
        )

    def _curves(self) -> list[tuple[np.ndarray, np.ndarray]]:
        low_s, high_s = self.shown or self.whole
        spare_s = 0.5 * (high_s - low_s)
        found = []
        for line in self.lines:
            part = window(line.time_s, low_s - spare_s, high_s + spare_s)
            x, y = extremes(line.time_s[part], line.values[part], BUCKETS)
            found.append((np.round(x, 3), np.asarray(y, np.float32)))
        return found

    def _shapes(self) -> list[dict[str, Any]]:
        shaded = [
            {
                "type": "rect", "xref": "x", "yref": "paper", "x0": one.low_s, "x1": one.high_s, "y0": 0, "y1": 1,
                "line": {"width": 0}, "fillcolor": theme.faint(self.colors.mark, 0.3 if one.strong else 0.13),
                "layer": "below",
            }
            for one in self.marks
        ]  # fmt: skip
        for number, track in enumerate(self.tracks, 1):
            if track.band is not None:
                shaded.append(
                    {
                        "type": "rect", "xref": "paper", "yref": f"y{number}", "x0": 0, "x1": 1, "y0": track.band[0],
                        "y1": track.band[1], "line": {"width": 0}, "layer": "below",
                        "fillcolor": theme.faint(self.colors.good, 0.16),
                    }
                )  # fmt: skip
        return shaded

    def _figure(self) -> dict[str, Any]:
        height = sum(track.height_px + TITLE_PX for track in self.tracks)
        curves = iter(self._curves())
        data, axes, titles, top = [], {}, [], 1.0
        for number, track in enumerate(self.tracks, 1):
            upper = top - TITLE_PX / height
            lower = upper - track.height_px / height
            axes[f"yaxis{number}"] = theme.axis(
                self.colors, domain=[max(lower, 0.0), upper], anchor="x", fixedrange=True, nticks=5, zeroline=False
            )
            titles.append(
                {
                    "text": f"{track.title} ({track.unit})" if track.unit else track.title, "xref": "paper",
                    "yref": "paper", "x": 0, "y": upper, "xanchor": "left", "yanchor": "bottom", "showarrow": False,
                    "font": {"size": 12, "color": self.colors.muted},
                }
            )  # fmt: skip
            for line in track.lines:
                x, y = next(curves)
                unit = f" {track.unit}" if track.unit else ""
                data.append(
                    {
                        "type": "scatter", "mode": "lines", "name": line.name, "x": x, "y": y, "yaxis": f"y{number}",
                        "line": {"color": line.color, "width": line.width, "dash": line.dash},
                        "hovertemplate": f"%{{y:.4~g}}{unit}",
                    }
                )  # fmt: skip
            top = lower
        low_s, high_s = self.shown or self.whole
        layout = theme.layout(
            self.colors,
            height + BOTTOM_PX,
            margin={"l": 56, "r": 10, "t": 0, "b": BOTTOM_PX},
            xaxis=theme.axis(
                self.colors,
                anchor=f"y{len(self.tracks)}",
                range=[low_s, high_s],
                title={"text": "time (s)", "font": {"size": 12, "color": self.colors.muted}, "standoff": 6},
                zeroline=False,
                showspikes=True,
                spikemode="across",
                spikethickness=1,
                spikecolor=self.colors.muted,
                spikedash="dot",
            ),
            annotations=titles,
            shapes=self._shapes(),
            hovermode="x unified",
            hoversubplots="axis",
            dragmode="pan",
            **axes,
        )
        return {"data": data, "layout": layout, "config": theme.CHART_CONFIG}
