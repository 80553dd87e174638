"""The picture of a drive."""

from pathlib import Path

import numpy as np

from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED
from cruise.service.demo import Result


def draw(result: Result, path: Path) -> Path:
    """Speed, error, current and what the field did, on one time axis; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    columns = result.trace.columns()
    time_s, engaged = columns["time_s"], columns["engaged"] > 0.5
    figure, axes = plt.subplots(4, 1, figsize=(12, 10), sharex=True, height_ratios=(3, 2, 2, 2), layout="constrained")
    speed, error, current, field = axes

    speed.plot(time_s, columns["setpoint_mps"], color=GREY, lw=1.2, ls="--", label="setpoint")
    speed.plot(time_s, columns["reference_mps"], color=GREEN, lw=1.0, label="reference")
    speed.plot(time_s, columns["true_speed_mps"], color=BLUE, lw=1.4, label="true ground speed")
    speed.set_ylabel("speed (m/s)")
    speed.legend(loc="lower right", ncols=3, fontsize="small")
    speed.set_title(f"cruise demo, seed {result.seed}", loc="left")

    error.plot(time_s, columns["true_speed_mps"] - columns["setpoint_mps"], color=BLUE, lw=1.0)
    error.axhspan(-0.03, 0.03, color=GREEN, alpha=0.15, lw=0, label="+- 0.03 m/s")
    error.set_ylim(-0.2, 0.2)
    error.set_ylabel("speed - setpoint (m/s)")
    error.legend(loc="lower right", fontsize="small")

    current.plot(time_s, np.where(engaged, columns["command_ma"], np.nan), color=ORANGE, lw=1.0)
    current.set_ylabel("pump current command (mA)")
    opened = columns["gate_open"] > 0.5
    current.fill_between(
        time_s,
        0,
        1,
        where=opened.tolist(),
        transform=current.get_xaxis_transform(),
        color=GREEN,
        alpha=0.12,
        lw=0,
        label="the model learns",
    )
    current.legend(loc="upper right", fontsize="small")

    field.plot(time_s, columns["grade_deg"], color=RED, lw=1.2)
    field.set_ylabel("slope (deg)", color=RED)
    field.set_xlabel("time (s)")
    engine = field.twinx()
    engine.plot(time_s, columns["engine_speed_rpm"], color=GREY, lw=1.2)
    engine.set_ylabel("engine speed (rpm)", color=GREY)
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
