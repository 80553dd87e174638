"""Short drives with a slope hidden in them or with nothing, and what is found there."""

from dataclasses import replace

import numpy as np

from cruise.identification.structures import parse
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose
from cruise.validation.noise_floor import Bound, NoiseFloor
from cruise.validation.study import study

MODEL = "arx:na=1,nb=3,delay_s=0.5"
DT_S, SECONDS = 0.1, 240.0
DELAY_S, LAG_S, DRIVE_S, GAIN = 0.3, 0.2, 0.6, 2.5e-3
PULL = 0.03  # m/s of steady speed per m/s2 of slope
TRIED = ("coulomb_friction", "transport_delay")  # and grade, of those that could be
FLOOR = NoiseFloor(Bound(0.01, 0.009, 0.011), 0.01, 1.0, 2.5, Bound(0.012, 0.011, 0.013), 1000)


def drive(seed: int, pull: float, seconds: float = SECONDS) -> Recording:
    """Random steps of current on slopes that rise and fall; one Euler step of 10 ms, by hand.

    0.6 s dv/dt = 2.5e-3 w - pull 9.81 sin(pitch) - v,   0.2 s dw/dt = u(t - 0.3 s) - w
    """
    rng = np.random.default_rng(seed)
    fine_s, count = 0.01, round(seconds / DT_S)
    time_s = DT_S * np.arange(1, count + 1)
    levels = np.repeat(rng.uniform(300.0, 900.0, count), rng.integers(15, 60, count))[:count]
    pitch = 5.0 * np.sin(2.0 * np.pi * time_s / 47.0) * np.sin(2.0 * np.pi * time_s / 31.0 + seed)
    u, slope = (np.repeat(one, round(DT_S / fine_s)) for one in (levels, 9.81 * np.sin(np.radians(pitch))))
    late = np.concatenate([np.full(round(DELAY_S / fine_s), u[0]), u])[: len(u)]
    speed, w, v = np.empty(len(u)), u[0], GAIN * u[0]
    for k in range(len(u)):
        w += fine_s / LAG_S * (late[k] - w)
        v += fine_s / DRIVE_S * (GAIN * w - pull * slope[k] - v)
        speed[k] = v
    columns = {
        INPUT: levels,
        OUTPUT: speed[round(DT_S / fine_s) - 1 :: round(DT_S / fine_s)] + 0.01 * rng.standard_normal(count),
        "pitch_deg": pitch + 0.1 * rng.standard_normal(count),
        "engine_speed_rpm": np.full(count, 2100.0),
    }
    return Recording(time_s, columns, DT_S, "drive.csv")


def found_in(recording: Recording, model: str = MODEL) -> Diagnosis:
    return diagnose(study([recording], parse(model), None, 0.2))


def unlisted(found: Diagnosis) -> Diagnosis:
    curve_fit = next(one.judged for one in found.steps[0].tried if one.name == "unnamed:pitch_deg")
    return replace(
        found, verdict=Verdict.UNLISTED, effects=(), signals=("pitch_deg",), final=curve_fit, steps=found.steps[:1]
    )


def ambiguous(found: Diagnosis) -> Diagnosis:
    pair = ("grade", "coulomb_friction")
    return replace(found, verdict=Verdict.AMBIGUOUS, effects=pair, look_alikes=(pair,))
