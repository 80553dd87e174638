"""The drive that a verdict asks for: the experiments of effects that can't be told apart, by the trial's machine."""

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import numpy as np

from cruise import settings

from . import course as courses
from .course import FULL_MA, GRAIN_KG, RATED_RPM, Course, FloatArray, wander
from .trial import PERIOD_S, Trial

EXPERIMENTS: Final = Path(__file__).with_name("experiments.yaml")
STREAM: Final = 6
LEVER_S: Final = 0.4  # s that a hand takes to move the lever, or to change whatever else
SWEEP_HZ: Final = (0.1, 3.0)

Seconds = Annotated[float, msgspec.Meta(ge=0.0)]


class Leg(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """To the values named within `over_s`, then everything held for `hold_s`; what is None stays as it is."""

    over_s: Seconds = LEVER_S
    hold_s: Seconds = 0.0
    current_ma: float | None = None
    gear: int | None = None
    grade_deg: float | None = None
    rpm: float | None = None
    crop_kw: float | None = None
    grain_share: float | None = None  # of a full bin
    oil_c: float | None = None
    soil: float | None = None
    brake_n: float | None = None
    sweep_ma: float = 0.0  # amplitude of a sine that rises through SWEEP_HZ while the leg is held


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Legs, as often as it says."""

    legs: tuple[Leg, ...]
    times: Annotated[int, msgspec.Meta(ge=1)] = 1


class Experiments(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file: the experiment of every effect, by its name."""

    experiments: dict[str, tuple[Part, ...]]


MOVED: Final = ("current_ma", "grade_deg", "rpm", "crop_kw", "grain_share", "oil_c", "soil", "brake_n")


@cache
def experiments() -> dict[str, tuple[Part, ...]]:
    """The experiment of every effect, by its name."""
    return settings.load(EXPERIMENTS, Experiments).experiments


def course_of(effect: str, trial: Trial) -> Course:
    """The experiment of an effect as a course of a trial's machine, after its recording."""
    legs = [leg for part in experiments()[effect] for _ in range(part.times) for leg in part.legs]
    last = courses.draw(trial)
    now: dict[str, Any] = dict.fromkeys(MOVED, 0.0) | {
        "rpm": RATED_RPM,
        "grain_share": float(last.grain_kg[-1]) / GRAIN_KG,
        "oil_c": float(last.oil_c[-1]),
        "gear": 2,
    }
    corners_s, rows, gears, sweeps = [0.0], [dict(now)], [2], []
    for leg in legs:
        now |= {name: value for name in (*MOVED, "gear") if (value := getattr(leg, name)) is not None}
        if leg.sweep_ma:
            sweeps.append((corners_s[-1] + leg.over_s, leg.hold_s, leg.sweep_ma))
        for span_s in (leg.over_s, leg.hold_s):
            corners_s.append(corners_s[-1] + max(span_s, 1e-6))
            rows.append(dict(now))
            gears.append(now["gear"])
    time_s = PERIOD_S * np.arange(1, round(corners_s[-1] / PERIOD_S) + 1)
    moved = {name: np.interp(time_s, corners_s, [row[name] for row in rows]) for name in MOVED}
    for begin_s, seconds, size_ma in sweeps:
        moved["current_ma"] += size_ma * _sweep(time_s - begin_s, seconds)
    rng, still = trial.rng(STREAM), np.zeros(len(time_s))
    # Soil and wind are not asked whether anybody makes an experiment; where it is about the soil, the way was chosen.
    soil = moved["soil"] if moved["soil"].any() else wander(rng, time_s, -1.0, 1.0, (15.0, 60.0))
    places = np.searchsorted(corners_s, time_s, side="left").clip(max=len(gears) - 1)
    return Course(
        time_s=time_s,
        current_ma=moved["current_ma"].clip(-FULL_MA, FULL_MA),
        gear=np.array(gears, dtype=np.int64)[places],
        grade_deg=moved["grade_deg"],
        rpm=moved["rpm"],
        crop_kw=moved["crop_kw"],
        grain_kg=GRAIN_KG * moved["grain_share"],
        oil_c=moved["oil_c"],
        soil=soil,
        header_mm=still + 700.0,
        wind=wander(rng, time_s, -1.0, 1.0, (4.0, 20.0)),
        tyre_bar=still + float(last.tyre_bar[-1]),
        brake_n=moved["brake_n"],
    )


def _sweep(time_s: FloatArray, seconds: float) -> FloatArray:
    """A sine whose frequency rises evenly in ratio, zero outside its time."""
    low, high = SWEEP_HZ
    rise = np.log(high / low) / seconds
    phase = 2.0 * np.pi * low / rise * np.expm1(rise * time_s.clip(0.0, seconds))
    return np.where((time_s >= 0.0) & (time_s <= seconds), np.sin(phase), 0.0)
