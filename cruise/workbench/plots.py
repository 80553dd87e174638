"""Small charts: what an effect's evidence looks like, and how the error fell."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from nicegui import ui

from cruise.workbench import theme
from cruise.workbench.found import Curve, Minute, Signature
from cruise.workbench.parts import labelled
from cruise.workbench.theme import Theme

SMALL_PX = 250


def chart(data: list[dict[str, Any]], layout: dict[str, Any], words: str) -> None:
    """A chart that stands still; `words` is what it is for those who don't see it."""
    plot = ui.plotly({"data": data, "layout": layout, "config": theme.STILL_CONFIG}).classes("w-full")
    labelled(plot.props("role=img"), words)


def signature(found: Signature, name: str, colors: Theme) -> None:
    """What the model leaves over what the effect changes: a slope before, flat after, where the effect is there."""
    data: list[dict[str, Any]] = []
    for parts, color, label, symbol in (
        (found.before, colors.other, "without", "square"),
        (found.after, colors.model, "with", "circle"),
    ):
        x, low, middle, high = parts
        data.append(_band(x, low, high, color))
        data.append(
            {
                "type": "scatter", "mode": "lines+markers", "x": x, "y": middle, "name": label,
                "line": {"color": color, "width": 1.5}, "marker": {"size": 5, "symbol": symbol},
                "hovertemplate": f"{label}: %{{y:.3f}} m/s<extra></extra>",
            }
        )  # fmt: skip
    _still(data, colors, f"change by {name} (m/s)", "left over (m/s)", f"residuals and {name}")


def curve(found: Curve, name: str, colors: Theme) -> None:
    """What the effect does as fitted, with twice its standard error, over how often each value was driven."""
    data: list[dict[str, Any]] = []
    if found.driven is not None:
        data.append(
            {
                "type": "bar", "x": found.driven[0], "y": found.driven[1], "yaxis": "y2", "hoverinfo": "skip",
                "marker": {"color": theme.faint(colors.muted, 0.22)}, "name": "driven",
            }
        )  # fmt: skip
    data += [_band(x, low, high, colors.model) for x, low, high in found.bands]
    data.append(_line(found.x, found.without, colors.other, "without", "dash"))
    mode = "lines+markers" if len(found.x) <= 6 else "lines"
    data.append(_line(found.x, found.y, colors.model, "with", mode=mode))
    extra = {}
    if found.driven is not None:
        top = 3.0 * float(max(found.driven[1].max(), 1))
        extra["yaxis2"] = {"overlaying": "y", "range": [0, top], "visible": False, "fixedrange": True}
    _still(data, colors, found.x_words, found.y_words, f"{name} as fitted", y_range=found.limits, **extra)


def minute(found: Minute, colors: Theme) -> None:
    """The minute that tells most."""
    data = [
        _line(found.time_s, found.measured_mps, theme.faint(colors.measured, 0.35), "measured", width=4.5),
        _line(found.time_s, found.before_mps, colors.other, "the model as it is", "dash"),
        _line(found.time_s, found.after_mps, colors.model, f"with {found.label}"),
    ]
    _still(data, colors, "time (s)", "speed (m/s)", "the minute that tells most", height=270)


class Level(NamedTuple):
    """One stair: the place of its step, and its held-out error."""

    place: int
    name: str
    error_mps: float


def stairs(levels: Sequence[Level], floor: tuple[float, float], at: int, colors: Theme) -> None:
    """The error as stairs down to the noise floor, one level a model; `at` is the place of the present one."""
    errors = [level.error_mps for level in levels]
    bounds = [one for one in floor if math.isfinite(one) and one > 0.0]
    low, high = min([*errors, *bounds]), max(errors)
    data: list[dict[str, Any]] = []
    for k, (place, name, error) in enumerate(levels):
        color = colors.model if place <= at else theme.faint(colors.muted, 0.5)
        data.append(
            {
                "type": "scatter", "mode": "lines", "x": [k - 0.42, k + 0.42], "y": [error, error], "name": name,
                "line": {"color": color, "width": 4 if place == at else 2.5},
                "hovertemplate": f"{name}: {error:.4f} m/s<extra></extra>",
            }
        )  # fmt: skip
    layout = theme.layout(
        colors,
        300,
        margin={"l": 60, "r": 14, "t": 22, "b": 36},
        xaxis=theme.axis(
            colors, tickvals=list(range(len(levels))), ticktext=[level.name for level in levels], showgrid=False,
            range=[-0.6, max(len(levels) - 0.4, 1.6)], fixedrange=True, zeroline=False,
        ),
        yaxis=theme.axis(
            colors, type="log", range=[math.log10(0.6 * low), math.log10(1.7 * high)], fixedrange=True,
            tickvals=_round(0.6 * low, 1.7 * high),
            ticktext=[f"{one:g}" for one in _round(0.6 * low, 1.7 * high)],
            title={"text": "held-out error (m/s RMS)", "font": {"size": 12, "color": colors.muted}},
        ),
        annotations=[
            {
                "x": k, "y": math.log10(error), "text": f"{error:.4f}", "showarrow": False, "yshift": 12,
                "font": {"size": 12, "color": colors.ink},
            }
            for k, error in enumerate(errors)
        ],
        shapes=_floor(bounds, colors),
    )  # fmt: skip
    chart(data, layout, "error of each step, down to the noise floor")


def _round(low: float, high: float) -> list[float]:
    """Round numbers of the series 1, 2, 5 between two values."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [one for power in powers for one in (10.0**power, 2 * 10.0**power, 5 * 10.0**power) if low <= one <= high]


def _floor(bounds: Sequence[float], colors: Theme) -> list[dict[str, Any]]:
    if not bounds:
        return []
    low, high = min(bounds), max(bounds)
    return [
        {
            "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": "y", "y0": low, "y1": high, "layer": "below",
            "fillcolor": theme.faint(colors.good, 0.18), "line": {"width": 1, "color": theme.faint(colors.good, 0.5)},
        }
    ]  # fmt: skip


def _line(
    x: np.ndarray,
    y: np.ndarray,
    color: str,
    name: str,
    dash: str = "solid",
    mode: str = "lines",
    width: float = 1.6,
) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": mode, "x": x, "y": y, "name": name,
        "line": {"color": color, "width": width, "dash": dash},
        "hovertemplate": f"{name}: %{{y:.3~g}}<extra></extra>",
    }  # fmt: skip


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray, color: str) -> dict[str, Any]:
    return {
        "type": "scatter", "x": np.concatenate([x, x[::-1]]), "y": np.concatenate([low, high[::-1]]), "fill": "toself",
        "fillcolor": theme.faint(color, 0.16), "line": {"width": 0}, "mode": "lines", "hoverinfo": "skip",
    }  # fmt: skip


def _still(
    data: list[dict[str, Any]],
    colors: Theme,
    x: str,
    y: str,
    words: str,
    height: int = SMALL_PX,
    y_range: tuple[float, float] | None = None,
    **extra: Any,
) -> None:
    def title(text: str) -> dict[str, Any]:
        return {"text": text, "font": {"size": 12, "color": colors.muted}, "standoff": 8}

    layout = theme.layout(
        colors,
        height,
        xaxis=theme.axis(colors, title=title(x), fixedrange=True, zeroline=False),
        yaxis=theme.axis(colors, title=title(y), fixedrange=True, nticks=6, range=y_range),
        hovermode="closest",
        bargap=0,
        **extra,
    )
    chart(data, layout, words)
