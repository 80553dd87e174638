"""The tracks of the time axis: speed, error, current, and the signals that were chosen."""

import math
from collections.abc import Sequence

import numpy as np

from cruise.signals import SIGNALS
from cruise.validation.quantities import spoken
from cruise.workbench.found import Predicted
from cruise.workbench.page import Page
from cruise.workbench.timeline import Line, Mark, Timeline, Track

SPEED_PX, ERROR_PX, INPUT_PX, CONTEXT_PX = 210, 130, 96, 76


def timeline(page: Page, compact: bool = False, marks: Sequence[Mark] = ()) -> Timeline:
    """The time axis of the session's recording and model; `compact`: speed and error only."""
    session, colors = page.session, page.colors
    assert session.opened is not None
    native = session.opened.recordings[session.recording]
    step = session.step
    curves = step.curves if step else None
    time_s = native.time_s
    speeds = [Line("measured", time_s, native.output, colors.measured, 1.4)]
    errors: list[Line] = []
    band = None
    if curves is not None:
        at_s, ahead = _one(curves, session.recording)
        horizon = f"{curves.horizon_s:g} s ahead"
        if session.free_run:
            speeds.append(
                Line("model, free run", at_s, curves.free_run_mps[session.recording], colors.free, 1.2, "dot")
            )
        errors.append(Line("error", at_s, curves.errors_mps[session.recording], colors.model, 1.2))
        other = session.steps[session.other] if session.other is not None else None
        if other is not None and other.curves is not None and other is not step:
            before_s, before = _one(other.curves, session.recording)
            speeds.append(
                Line(f"{other.name}, {other.curves.horizon_s:g} s ahead", before_s, before, colors.other, 1.3, "dash")
            )
            errors.insert(
                0,
                Line(f"error of {other.name}", before_s, other.curves.errors_mps[session.recording], colors.other, 1.2),
            )
        name = step.name if step and len(session.steps) > 1 else "model"
        speeds.append(Line(f"{name}, {horizon}", at_s, ahead, colors.model, 1.5))
        if step and step.compared:
            floor = max((one for one in step.compared.floor_mps if math.isfinite(one)), default=math.nan)
            band = (-2 * floor, 2 * floor) if math.isfinite(floor) else None
    tracks = [Track("speed", "m/s", speeds, SPEED_PX)]
    if errors:
        tracks.append(Track("error: measured minus predicted", "m/s", errors, ERROR_PX, band))
    if not compact:
        tracks.append(
            Track("pump current", "mA", [Line("current", time_s, native.input, colors.measured, 1.1)], INPUT_PX)
        )
        for name in session.context:
            if name in native.columns and np.isfinite(native.columns[name]).any():
                words, unit = spoken(name)
                line = Line(words, time_s, native.columns[name], colors.measured, 1.1)
                tracks.append(Track(words, unit if name in SIGNALS else "", [line], CONTEXT_PX))

    def moved(shown: tuple[float, float] | None) -> None:
        session.window = shown

    return Timeline(tracks, colors, session.window, moved, marks)


def _one(curves: Predicted, number: int) -> tuple[np.ndarray, np.ndarray]:
    return curves.recordings[number].time_s, curves.ahead_mps[number]
