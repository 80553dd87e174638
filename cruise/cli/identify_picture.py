"""The picture of a fitted model."""

from pathlib import Path

import numpy as np

from cruise.identification.identify import Identification
from cruise.model.model import DriveResponse
from cruise.recording import Recording
from cruise.report.colours import BLUE, GREY, ORANGE, RED

STEP_MA, STEP_SHOWN_S = 100.0, 6.0  # mA and s, of the step response
SHOWN_S = 120.0  # s of the recording with the greatest error: more can't be told apart in a picture


def draw(found: Identification, path: Path) -> Path:
    """Measured against predicted speed, the error below, residuals and step response; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure = plt.figure(figsize=(12, 9), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(3, 1.6, 2.4))
    speed = figure.add_subplot(grid[0, :])
    error = figure.add_subplot(grid[1, :], sharex=speed)
    correlation, step = figure.add_subplot(grid[2, 0]), figure.add_subplot(grid[2, 1])

    recording, predicted, part = _worst(found)
    time_s, measured = recording.time_s[part], recording.output[part]
    shown = predicted[part] if not found.fitted.unstable else np.full(len(time_s), np.nan)
    speed.plot(time_s, measured, color=GREY, lw=1.6, label="measured")
    speed.plot(time_s, shown, color=BLUE, lw=1.3, label=f"predicted {found.horizon_s:g} s ahead, training data")
    speed.set_ylabel("ground speed (m/s)")
    name = found.structure.name or str(found.structure)
    where = f"{Path(recording.source).name}: the {time_s[-1] - time_s[0]:.0f} s with the greatest error"
    title = f"{name} - {where}" + (" - unstable predictor" if found.fitted.unstable else "")
    speed.set_title(title, loc="left", parse_math=False)
    speed.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize="small", frameon=False)
    error.plot(time_s, measured - shown, color=RED, lw=1.0)
    error.axhline(0.0, color=GREY, lw=0.8)
    error.set_ylabel("error (m/s)")
    error.set_xlabel("time (s)")

    white = found.whiteness
    lags_s = found.fitted.period_s * np.arange(1, len(white.autocorrelation) + 1)
    correlation.stem(lags_s, white.autocorrelation, linefmt=BLUE, markerfmt=" ", basefmt=GREY)
    correlation.axhspan(-white.bound, white.bound, color=ORANGE, alpha=0.3, lw=0, label="95 % of white residuals")
    correlation.set_ylim(-1.0, 1.0)
    correlation.set_xlabel("lag (s)")
    correlation.set_ylabel("autocorrelation (-)")
    correlation.set_title("residuals one step ahead", loc="left")
    correlation.legend(loc="lower right", fontsize="small")

    model = found.model
    if model is not None and model.nb and not found.fitted.unstable:
        a, b, *_ = model.split(model.theta)
        core = DriveResponse(tuple(a), tuple(b), model.delay, offset_mps=0.0)
        response_mps = STEP_MA * core.forced(max(round(STEP_SHOWN_S / model.period_s), 10)).sum(axis=1)
        step.step(model.period_s * np.arange(len(response_mps)), response_mps, where="post", color=BLUE)
    else:
        step.text(0.5, 0.5, "no step response", transform=step.transAxes, ha="center", color=GREY)
    step.set_xlabel("time after the step (s)")
    step.set_ylabel("speed (m/s)")
    step.set_title(f"answer to {STEP_MA:g} mA more drive signal", loc="left")
    for axis in (speed, error, correlation, step):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _worst(found: Identification) -> tuple[Recording, np.ndarray, slice]:
    """The recording and the stretch of it in which the prediction errs most."""
    greatest, worst = -1.0, (found.recordings[0], found.predicted_mps[0], slice(0, 1))
    for recording, predicted in zip(found.recordings, found.predicted_mps, strict=True):
        length = min(round(SHOWN_S / recording.dt_s), len(recording))
        squared = np.nan_to_num((recording.output - predicted) ** 2, posinf=0.0)
        sums = np.concatenate([[0.0], np.cumsum(squared)])
        windows = sums[length:] - sums[:-length]
        at = int(np.argmax(windows))
        if windows[at] / length > greatest:
            greatest, worst = windows[at] / length, (recording, predicted, slice(at, at + length))
    return worst
