"""The picture of a diagnosis: where it matters, the residual against the effect's own signature, curve and ranking.

    signature_k = e_k without - e_k with,   e measured minus predicted speed, held out

What the effect changes in the prediction is its signature. If the effect is there, what the model without it leaves
rises with the signature, and what the model with it leaves does not.
"""

import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cruise.report import evidence
from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED
from cruise.report.curve import curve
from cruise.report.diagnosis import figure, sentence
from cruise.report.evidence import Rung
from cruise.validation.candidates import UNNAMED
from cruise.validation.diagnose import Diagnosis, Verdict
from cruise.validation.judged import Judged
from cruise.validation.noise_floor import NoiseFloor

DPI: Final = 110  # 13 inches are 1430 pixels
STRETCH_S: Final = 60.0
BINS: Final = 12  # of the signature, equally many samples in each
FEWEST: Final = 5  # samples in a bin
HEADROOM: Final = 0.25  # of the axis, for the legend
BARS: Final = 10  # effects in the ranking
UNIT: Final = re.compile(r" (%|s ahead|m/s)")  # not on another line than its number
TITLE: Final = 120  # characters in a line of the title


def draw(found: Diagnosis, floor: NoiseFloor, path: Path) -> Path:
    """Speeds and errors over the telling minute, signature and curve of each effect, the ranking; returns the path."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    shown = _shown(found)
    bars = min(len(found.ranking), BARS) + (evidence.best_unnamed(found) is not None)
    heights = [5.6, *([3.9] * len(shown)), 1.6 + 0.3 * bars]
    figure_ = plt.figure(figsize=(13, sum(heights) + 0.7), layout="constrained")
    title = textwrap.fill(UNIT.sub("\u00a0\\1", sentence(found).replace("`", "")), TITLE)
    figure_.suptitle(title, x=0.01, ha="left", fontsize="large", fontweight="bold", parse_math=False)
    parts: Any = figure_.subfigures(len(heights), 1, height_ratios=heights)
    _minute(parts[0], found, floor, shown)
    several = len(shown) > 1 and found.verdict is not Verdict.AMBIGUOUS
    for place, (part, one) in enumerate(zip(parts[1:-1], shown, strict=True), 1):
        left, right = part.subplots(1, 2)
        _signature(left, found, one, f"step {place}: " if several else "")
        _curve(right, found, one)
    _ranking(parts[-1], found, floor)
    figure_.savefig(path, dpi=DPI)
    plt.close(figure_)
    return path


def _shown(found: Diagnosis) -> list[Rung]:
    """The steps that are drawn: those taken and not taken back; of look-alikes each; else the best that was tried."""
    if found.verdict is Verdict.AMBIGUOUS:
        tried = [evidence.first_tried(found, name) for name in found.effects]
    elif not found.explained:
        tried = [evidence.best_named(found)]
    else:
        stayed = evidence.members(found.final.explanation)
        return [one for one in evidence.rungs(found) if any(name in stayed for name in one.added)]
    return [evidence.rung(found, found.base, one.judged) for one in tried if one is not None]


def _added(found: Diagnosis, names: Sequence[str]) -> str:
    """What was added, in words; a force that nobody recorded is no effect of the table, though one shows it."""
    return f"what {' and '.join(found.signals)} shows" if found.unrecorded else _called(names)


def _called(names: Sequence[str]) -> str:
    """Names of effects as they are written in the picture."""
    return " and ".join(
        f"a curve of {evidence.signal_of(name)}" if name.startswith(UNNAMED) else name for name in names
    )


def _models(found: Diagnosis, shown: Sequence[Rung]) -> list[tuple[str, Judged, dict[str, Any]]]:
    """The fits whose predictions are drawn, with label and style."""
    models: list[tuple[str, Judged, dict[str, Any]]] = [
        ("the model as it is", found.base, {"color": ORANGE, "lw": 1.2, "ls": "--"})
    ]
    if found.explained and found.verdict is not Verdict.AMBIGUOUS:
        added = [name for one in shown for name in one.added]
        models.append((f"with {_added(found, added)}", found.final, {"color": BLUE, "lw": 1.4}))
        return models
    styles = ({"color": BLUE, "lw": 1.4}, {"color": GREEN, "lw": 1.2, "ls": "-."}, {"color": RED, "lw": 1.0, "ls": ":"})
    for one, style in zip(shown, styles, strict=False):
        believed = "" if found.explained else ", not believed"
        models.append((f"with {_added(found, one.added)}{believed}", one.after, style))
    return models


def _minute(figure_: Any, found: Diagnosis, floor: NoiseFloor, shown: Sequence[Rung]) -> None:
    """Measured and predicted speeds, the errors below."""
    models = _models(found, shown)
    scene = found.study.search.scene
    number, stretch = telling_stretch(found, models[-1 if len(models) < 3 else 1][1])
    recording = scene.recordings[number]
    time_s = recording.time_s[stretch.start - scene.parts[number].start : stretch.stop - scene.parts[number].start]
    measured = scene.speed_mps[stretch]
    speed, error = figure_.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    speed.plot(time_s, measured, color=GREY, lw=3.0, alpha=0.6, label="measured")
    for label, judged, style in models:
        speed.plot(time_s, measured - judged.error_mps[stretch], label=label, **style)
        error.plot(time_s, judged.error_mps[stretch], label=label, **style)
    horizon_s = found.study.horizon_s
    of = f" of {Path(recording.source).name}" if len(scene.recordings) > 1 else ""
    speed.set_title(
        f"the minute{of} in which it matters most; predicted {horizon_s:g} s ahead and more, held out", loc="left",
        fontsize="medium", parse_math=False,
    )  # fmt: skip
    bound, what = (floor.white, "white noise") if floor.white is not None else (floor.reached, "boosting")
    if bound is not None:
        label = f"{what}: ±2 · {figure(bound.value_mps)} m/s"
        error.axhspan(-2 * bound.value_mps, 2 * bound.value_mps, color=GREEN, alpha=0.15, lw=0, label=label)
    error.axhline(0.0, color=GREY, lw=0.8)
    speed.set_ylabel("speed (m/s)")
    error.set_ylabel("error (m/s)")
    error.set_xlabel("time (s)")
    error.set_xlim(time_s[0], time_s[-1])
    for axis in (speed, error):
        axis.grid(alpha=0.3)
    handles = dict(zip(*reversed(error.get_legend_handles_labels()), strict=True))
    handles = dict(zip(*reversed(speed.get_legend_handles_labels()), strict=True)) | handles
    figure_.legend(
        handles=list(handles.values()), labels=list(handles), loc="outside upper right", ncols=5, fontsize="small"
    )


def telling_stretch(found: Diagnosis, after: Judged) -> tuple[int, slice]:
    """The recording and the minute of it, as samples of all, in which the squared error falls most."""
    scene = found.study.search.scene
    fallen = np.nan_to_num(found.base.error_mps**2 - after.error_mps**2)
    width = round(STRETCH_S / scene.period_s)
    best = (-np.inf, 0, scene.parts[0])
    for number, part in enumerate(scene.parts):
        length = min(width, part.stop - part.start)
        total = np.cumsum(np.concatenate([[0.0], fallen[part]]))
        sums = total[length:] - total[:-length]
        start = int(np.argmax(sums))
        if sums[start] > best[0]:
            best = (float(sums[start]), number, slice(part.start + start, part.start + start + length))
    return best[1], best[2]


def _signature(axis: Any, found: Diagnosis, one: Rung, step: str) -> None:
    """The residual before and after over what the effect changes in the prediction."""
    before, after = one.before.error_mps, one.after.error_mps
    signature = before - after
    known = np.isfinite(signature)
    x = signature[known]
    ends = binned(x, x)[0][[0, -1]]
    axis.plot(ends, ends, color=GREY, lw=1.2, ls=":", label="all of it explained")
    axis.axhline(0.0, color=GREY, lw=0.8)
    for error, color, marker, label in ((before, ORANGE, "s", "before"), (after, BLUE, "o", "after")):
        middles, ten, median, ninety = binned(x, error[known])
        axis.fill_between(middles, ten, ninety, color=color, alpha=0.2, lw=0)
        axis.plot(middles, median, color=color, marker=marker, ms=4, lw=1.4, label=f"{label}: median, 10 to 90 %")
    name = _added(found, one.added)
    axis.set_title(f"{step}what the model leaves, against the signature of {name}", loc="left", fontsize="medium")
    axis.set_xlabel(f"change of the predicted speed by {name} (m/s)")
    axis.set_ylabel("measured - predicted (m/s)")
    bottom, top = axis.get_ylim()
    axis.set_ylim(bottom, top + HEADROOM * (top - bottom))
    axis.grid(alpha=0.3)
    axis.legend(loc="upper left", fontsize="small")


def binned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Median of x, and 10 %, 50 % and 90 % of y (bins,), in bins of equally many samples."""
    order = np.argsort(x, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if len(part) >= FEWEST]
    quantiles = np.array([np.quantile(y[part], (0.1, 0.5, 0.9)) for part in parts]).reshape(-1, 3)
    middles = np.array([np.median(x[part]) for part in parts])
    return middles, quantiles[:, 0], quantiles[:, 1], quantiles[:, 2]


def _curve(axis: Any, found: Diagnosis, one: Rung) -> None:
    """What the effect does, as fitted, over what was driven."""
    name = one.added[0]
    fit = evidence.fit_of(found, name, one.after)
    drawn = curve(found.study, one.before, fit, name)
    few = drawn.driven is not None and len(drawn.x) <= 6
    style = {"marker": "o", "lw": 0.8} if few else {"lw": 1.6}
    if drawn.driven is not None:
        behind = axis.twinx()
        behind.hist(
            drawn.driven[np.isfinite(drawn.driven)],
            bins=60,
            range=(drawn.x.min(), drawn.x.max()),
            color=GREY,
            alpha=0.2,
        )
        behind.set_yticks([])
        behind.set_ylim(0, 3.0 * behind.get_ylim()[1])
        axis.set_zorder(behind.get_zorder() + 1)
        axis.patch.set_visible(False)
    axis.plot(drawn.x, drawn.without, color=ORANGE, lw=1.2, ls="--", label="without")
    axis.plot(drawn.x, drawn.y, color=BLUE, label="with", **style)
    for place, (x, low, high) in enumerate(drawn.bands):
        label = {"label": "± 2 standard errors"} if place == 0 else {}
        axis.fill_between(x, low, high, color=BLUE, alpha=0.2, lw=0, **label)
    axis.set_ylim(drawn.limits)
    last = " with all of them" if len(found.effects) > 1 and fit is found.final else ""
    beside = "; grey: how often it was driven" if drawn.driven is not None else ""
    axis.set_title(f"{_added(found, [name])}, as fitted{last}{beside}", loc="left", fontsize="medium")
    axis.set_xlabel(f"{drawn.x_name} ({drawn.x_unit})" if drawn.x_unit else drawn.x_name)
    axis.set_ylabel(drawn.y_words)
    axis.grid(alpha=0.3)
    axis.legend(loc="best", fontsize="small")


def _ranking(figure_: Any, found: Diagnosis, floor: NoiseFloor) -> None:
    """The error that each effect leaves when it is added alone."""
    axis = figure_.subplots()
    rows = [(one.effect, one.error_after_mps, one.effect in found.effects) for one in found.ranking[:BARS]]
    unnamed = evidence.best_unnamed(found)
    horizon_s, before = found.study.horizon_s, evidence.error_mps(found.base)
    if unnamed is not None:
        rows.append((_called([unnamed.name]), evidence.error_mps(unnamed.judged), bool(found.signals)))
    top = 1.25 * max(before, np.nanquantile([error for _, error, _ in rows], 0.5)) if rows else 1.25 * before
    for place, (_, error, chosen) in enumerate(rows):
        free = unnamed is not None and place == len(rows) - 1
        color = BLUE if chosen else GREY
        axis.barh(place, min(error, top), color=color, alpha=0.9 if chosen else 0.5, hatch="//" if free else None)
        axis.text(1.005, place, figure(error), va="center", fontsize="small", transform=axis.get_yaxis_transform())
    axis.set_yticks(range(len(rows)), [name for name, _, _ in rows], fontsize="small")
    axis.invert_yaxis()
    axis.axvline(before, color=ORANGE, lw=1.6, ls="--", label=f"the model as it is: {figure(before)}")
    if len(found.effects) > 1 and found.verdict is Verdict.MISSING:
        after = evidence.error_mps(found.final)
        axis.axvline(after, color=BLUE, lw=1.6, label=f"all of them: {figure(after)}")
    if floor.white is not None:
        value = floor.white.value_mps
        axis.axvline(value, color=GREEN, lw=1.6, ls=":", label=f"white noise, the floor: {figure(value)}")
    if floor.reached is not None:
        value = floor.reached.value_mps
        axis.axvline(value, color=GREEN, lw=1.6, ls="-.", label=f"what boosting reaches: {figure(value)}")
    axis.set_xlim(0.0, top)
    axis.set_xlabel(f"error {horizon_s:g} s ahead, held out, each effect alone beside the model (m/s RMS)")
    axis.grid(alpha=0.3, axis="x")
    figure_.legend(loc="outside upper right", ncols=4, fontsize="small")
