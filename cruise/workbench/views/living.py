"""Live: a running service, read only, and from there to what its model lacks."""

import math
from typing import Any, Final

import numpy as np
from nicegui import run, ui

from cruise.workbench import theme
from cruise.workbench.downsample import extremes
from cruise.workbench.live import KEPT_S, Live, watch_bus, watch_combine
from cruise.workbench.page import Page
from cruise.workbench.parts import NO_FIGURE, card, figure, heading, labelled, legend, speed
from cruise.workbench.verbs import EXPECTED

REFRESH_S: Final = 1.0
POINTS: Final = 500
PACE: Final = 5.0  # of the virtual combine: a quarter of an hour in three minutes
LEAST_S: Final = 90.0  # of driving, before a diagnosis has anything to go by


def show(page: Page) -> None:
    """The whole view."""
    live = page.live
    heading(
        "Live",
        "A running service, listened to. Nothing is sent: the page hears the bus and lets a twin of the service learn "
        "along.",
    )
    if live.fault:
        with card():
            ui.label(live.fault).classes("bad")
    if not live.running and not live.rows:
        _begin(page)
        return
    _watched(page)


def _begin(page: Page) -> None:
    live, setup = page.live, page.setup
    folder = page.session.folder / "live"
    with ui.element("div").classes("grid2"):
        with card("The virtual combine"):
            ui.label(f"Combine, service and operator in this process, {PACE:g} times as fast as the clock.").classes(
                "quiet"
            )
            _button("Watch the combine", lambda: watch_combine(live, setup.config, folder, PACE), page)
        with card("A bus"):
            if setup.live is None:
                ui.label(
                    "Start with cruise workbench --live config/cruise.yaml to listen to the SocketCAN bus on which "
                    "cruise run drives."
                ).classes("quiet")
            else:
                config = setup.live
                ui.label(f"The bus of {config}.").classes("quiet")
                _button("Listen to the bus", lambda: watch_bus(live, config, folder), page)


def _button(words: str, watch: Any, page: Page) -> None:
    live = page.live

    async def begin() -> None:
        if live.running:
            return
        live.running = True
        page.refresh()
        try:
            await run.io_bound(watch)
        except EXPECTED as error:
            live.running, live.fault = False, str(error)
            page.refresh()

    ui.button(words, on_click=begin).props("unelevated no-caps").style("align-self:flex-start")


def _watched(page: Page) -> None:
    live, colors = page.live, page.colors
    with ui.row().classes("items-center w-full gap-4"):
        title = ui.label().classes("strong").style("margin-right:auto")
        title.bind_text_from(live, "title", lambda text: f"Watching {text}" if live.running else f"{text}: ended")
        if live.running:
            ui.button("Stop watching", on_click=page.do(live.stop)).props("flat no-caps")
        else:
            ui.button("Forget it", on_click=page.do(live.rows.clear)).props("flat no-caps")
    with ui.row().classes("items-center w-full gap-4"):
        alarm = ui.label().classes("verdict").style("font-size:15px").props("role=status")
        diagnose = _diagnose(page)
    figures = ui.row().classes("gap-12")
    with card("Speed"):
        legend([("setpoint", colors.muted, "dash"), ("speed", colors.model, "line")])
        drive = _plot(_drive(live, colors), "setpoint and speed")
    with card("Running error 3 s ahead", "Of the model that drives, of the one that learns, and of persistence."):
        legend(
            [
                ("the model that drives", colors.model, "line"),
                ("the model that learns", colors.free, "line"),
                ("persistence", colors.muted, "dash"),
            ]
        )
        errors = _plot(_errors(live, colors), "running errors")
    with card("Parameters that are learned"):
        table = ui.element("table").classes("figures").style("max-width:560px")

    def update() -> None:
        drive.update_figure(_drive(live, colors))
        errors.update_figure(_errors(live, colors))
        figures.clear()
        with figures:
            _figures(live)
        table.clear()
        with table:
            _parameters(live)
        words, bad = live.doing()
        alarm.set_text(words)
        alarm.classes(add="open" if bad else "calm", remove="calm" if bad else "open")
        driven_s = live.rows[-1].time_s - live.rows[0].time_s if len(live.rows) > 1 else 0.0
        minutes = min(driven_s, KEPT_S) / 60.0
        diagnose.set_text(f"Diagnose the last {minutes:.0f} minutes" if minutes >= 1.5 else "Diagnose")
        diagnose.set_enabled(driven_s >= LEAST_S and not page.session.busy)

    update()
    ui.timer(REFRESH_S, update)


def _diagnose(page: Page) -> ui.button:
    live = page.live

    def diagnose() -> None:
        assert live.settings is not None
        path = live.taken(page.session.folder / "taken")
        page.session.open_live(path, live.settings, KEPT_S)
        page.go("/missing")

    return ui.button("Diagnose", on_click=diagnose).props("outline no-caps")


def _figures(live: Live) -> None:
    status = live.status
    if status is None:
        ui.label("waiting for the first frames").classes("quiet")
        return
    engaged = str(status.state) == "engaged"
    figure(str(status.state), "", "state", tone="good" if engaged else "")
    figure(speed(status.setpoint_mps) if engaged else NO_FIGURE, "m/s", "setpoint")
    figure(f"{status.speed_mps:.2f}" if math.isfinite(status.speed_mps) else NO_FIGURE, "m/s", "speed")
    figure(f"{status.current_ma:.0f}" if math.isfinite(status.current_ma) else NO_FIGURE, "mA", "pump current")
    gate = str(status.gate).replace("_", " ")
    figure("open" if gate == "open" else "closed", "", "the gate" if gate == "open" else f"the gate: {gate}",
           "Whether this sample may teach the model, and why not.")  # fmt: skip
    figure(f"{status.time_s:.0f}", "s", "time")


def _parameters(live: Live) -> None:
    with ui.element("tr"):
        for words in ("parameter", "value", "± standard error"):
            with ui.element("th"):
                ui.label(words)
    if live.status is None:
        return
    model = live.status.learned
    for name, value, std in zip(model.parameter_names, model.theta, model.theta_std, strict=True):
        with ui.element("tr"):
            for text in (name, f"{value:.5g}", f"{std:.2g}"):
                with ui.element("td"):
                    ui.label(text)


def _drive(live: Live, colors: theme.Theme) -> dict[str, Any]:
    columns = live.columns()
    return _figure(
        [
            ("setpoint", columns["time_s"], columns["setpoint_mps"], colors.muted, "dash"),
            ("speed", columns["time_s"], columns["speed_mps"], colors.model, "solid"),
        ],
        "speed (m/s)",
        colors,
    )


def _errors(live: Live, colors: theme.Theme) -> dict[str, Any]:
    columns = live.columns()
    return _figure(
        [
            ("persistence", columns["time_s"], columns["persistence_mps"], colors.muted, "dash"),
            ("learns", columns["time_s"], columns["learned_mps"], colors.free, "solid"),
            ("drives", columns["time_s"], columns["driving_mps"], colors.model, "solid"),
        ],
        "RMS error (m/s)",
        colors,
    )


def _figure(
    lines: list[tuple[str, np.ndarray, np.ndarray, str, str]], title: str, colors: theme.Theme
) -> dict[str, Any]:
    data = []
    for name, time_s, values, color, dash in lines:
        x, y = extremes(time_s, values, POINTS)
        data.append(
            {
                "type": "scatter", "mode": "lines", "x": np.round(x, 2), "y": y, "name": name,
                "line": {"color": color, "width": 1.6, "dash": dash}, "hovertemplate": "%{y:.3f} m/s",
            }
        )  # fmt: skip
    layout = theme.layout(
        colors,
        220,
        xaxis=theme.axis(colors, title={"text": "time (s)", "font": {"size": 12}}, fixedrange=True, zeroline=False),
        yaxis=theme.axis(colors, title={"text": title, "font": {"size": 12}}, fixedrange=True, rangemode="tozero"),
        hovermode="x unified",
    )
    return {"data": data, "layout": layout, "config": theme.STILL_CONFIG}


def _plot(found: dict[str, Any], words: str) -> ui.plotly:
    plot = ui.plotly(found).classes("w-full").props("role=img")
    labelled(plot, f"{words} over time")
    return plot
