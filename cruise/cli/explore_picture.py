"""The picture of an exploration."""

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cruise.identification.explore import (
    CrossCorrelation,
    Excitation,
    Exploration,
    FrequencyResponse,
    NotPossible,
    StaticCurve,
)
from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED

LOWEST_DB = -50.0


def draw(found: Exploration, path: Path) -> Path:
    """Gain and coherence, correlation, static curve, spectrum and amplitudes; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(13, 12), layout="constrained")
    panels: list[tuple[Any, Callable[..., None], Any, str]] = [
        (axes[0, 0], _gain, found.frequency_response, "frequency response"),
        (axes[1, 0], _coherence, found.frequency_response, "coherence"),
        (axes[2, 0], _spectrum, found.excitation, "spectrum of the input"),
        (axes[0, 1], _correlation, found.cross_correlation, "cross-correlation"),
        (axes[1, 1], _curve, found.static_curve, "static curve"),
        (axes[2, 1], _amplitudes, found.excitation, "amplitudes of the input"),
    ]
    for axis, panel, result, title in panels:
        axis.set_title(title, loc="left")
        if isinstance(result, NotPossible):
            axis.text(0.5, 0.5, textwrap.fill(result.reason, 45), ha="center", va="center", transform=axis.transAxes)
            axis.set_axis_off()
            continue
        panel(axis, result)
        axis.grid(alpha=0.3)
    axes[1, 0].sharex(axes[0, 0])
    first, more = Path(found.recordings[0]).name, len(found.recordings) - 1
    title = f"cruise explore {first}{f' and {more} more' if more else ''}"
    figure.suptitle(title, x=0.01, ha="left", parse_math=False)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def _gain(axis: Any, response: FrequencyResponse) -> None:
    f = response.frequency_hz
    axis.fill_between(
        f, np.maximum(response.gain_low_db, LOWEST_DB), response.gain_high_db, color=BLUE, alpha=0.2, lw=0, label="95 %"
    )
    axis.plot(f, response.gain_db, color=BLUE, lw=1.3, label="gain")
    axis.axhline(-3.0, color=GREY, lw=0.8, ls="--", label="-3 dB")
    if response.cutoff is not None:
        at = response.cutoff
        axis.axvspan(at.low_hz, at.high_hz, color=GREEN, alpha=0.25, lw=0)
        axis.axvline(at.frequency_hz, color=GREEN, lw=1.2, label=f"cut-off {at.frequency_hz:.2f} Hz")
    if response.bump is not None:
        nearest = int(np.argmin(np.abs(f - response.bump.frequency_hz)))
        label = f"bump {response.bump.height_db:.1f} dB at {response.bump.frequency_hz:.2f} Hz"
        axis.plot(f[nearest], response.gain_db[nearest], "v", color=RED, ms=9, label=label)
    trusted = response.gain_db[f <= response.reliable_to_hz]
    axis.set_ylim(max(float(np.min(trusted)) - 10.0, LOWEST_DB), max(float(np.max(trusted)) + 5.0, 5.0))
    axis.set_xscale("log")
    axis.set_ylabel("gain (dB relative to low frequency)")
    axis.set_xlabel("frequency (Hz)")
    axis.legend(loc="lower left", fontsize="small")


def _coherence(axis: Any, response: FrequencyResponse) -> None:
    axis.plot(response.frequency_hz, response.coherence, color=BLUE, lw=1.3)
    axis.axvspan(response.reliable_to_hz, response.frequency_hz[-1], color=GREY, alpha=0.15, lw=0, label="not known")
    axis.set_ylim(0.0, 1.05)
    axis.set_xscale("log")
    axis.set_ylabel("coherence (-)")
    axis.set_xlabel("frequency (Hz)")
    axis.legend(loc="lower left", fontsize="small")


def _correlation(axis: Any, found: CrossCorrelation) -> None:
    axis.axhspan(-found.bound, found.bound, color=GREY, alpha=0.25, lw=0, label="95 % bound")
    axis.vlines(found.lag_s, 0.0, found.correlation, color=BLUE, lw=1.0)
    axis.plot(found.lag_s, found.correlation, ".", color=BLUE, ms=4)
    if found.delay_s is not None:
        axis.axvline(found.delay_s, color=GREEN, lw=1.2, label=f"begins after {found.delay_s:.2f} s")
        axis.axvline(found.peak_lag_s, color=ORANGE, lw=1.2, ls="--", label=f"peak at {found.peak_lag_s:.2f} s")
    axis.set_ylabel("correlation of speed with current (-)")
    axis.set_xlabel(f"lag (s){', whitened' if found.whitening_order else ''}")
    axis.legend(loc="upper left", fontsize="small")


def _curve(axis: Any, curve: StaticCurve) -> None:
    axis.plot(curve.current_ma, curve.rising_speed_mps, "^", color=BLUE, ms=5, label="rising")
    axis.plot(curve.current_ma, curve.falling_speed_mps, "v", color=ORANGE, ms=5, label="falling")
    end_ma = curve.saturation_ma.value if curve.saturation_ma else curve.current_ma[-1]
    acting_ma = np.linspace(curve.origin_ma, end_ma, 100)
    x = acting_ma - curve.origin_ma
    speed = curve.offset_mps.value + curve.slope_mps_per_ma.value * x + curve.quadratic_mps_per_ma2.value * x**2
    axis.plot(acting_ma, speed, color=GREY, lw=1.3, label="middle of the loop, fitted")
    for place, name in ((curve.threshold_ma, "threshold"), (curve.saturation_ma, "saturation")):
        if place is not None:
            axis.axvline(place.value, color=GREEN, lw=1.0, ls="--", label=f"{name} {place.value:.0f} mA")
    axis.set_ylabel("speed (m/s)")
    axis.set_xlabel("current (mA)")
    axis.legend(loc="upper left", fontsize="small")


def _spectrum(axis: Any, found: Excitation) -> None:
    density = np.maximum(found.spectrum_ma2_per_hz, 1e-9 * np.max(found.spectrum_ma2_per_hz))
    axis.loglog(found.frequency_hz, density, color=BLUE, lw=1.2)
    axis.axvline(1.0, color=GREY, lw=0.8, ls="--", label=f"{100.0 * found.share_below_1hz:.0f} % below 1 Hz")
    axis.set_ylabel("density of the current (mA²/Hz)")
    axis.set_xlabel("frequency (Hz)")
    axis.legend(loc="lower left", fontsize="small")


def _amplitudes(axis: Any, found: Excitation) -> None:
    axis.stairs(found.counts, found.edges_ma, fill=True, color=BLUE, alpha=0.6)
    axis.set_ylabel("samples (-)")
    axis.set_xlabel("current (mA)")
