"""Recordings with every kind of signal, and the scenes that they make."""

import numpy as np

from cruise.model.core import Core
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.simulation import JUDGED_S, WARM_UP_S, Scene
from tests.validation.driving import drive, wander

PERIOD_S = 0.2
AHEAD, EACH = round(WARM_UP_S / PERIOD_S), round(JUDGED_S / PERIOD_S)
CORE = Core(2.5e-3, 0.33, 0.15, 0.6, second_lag_s=0.05)


def context(samples: int, dt_s: float, seed: int) -> dict[str, np.ndarray]:
    """Signals of every kind that effects ask for."""
    gear = np.where(np.arange(samples) * dt_s // 37.0 % 2 == 0, 2.0, 3.0)
    return {
        "pitch_deg": wander(samples, dt_s, seed + 1, 2.5, 4.0),
        "engine_speed_rpm": 2050.0 + wander(samples, dt_s, seed + 2, 60.0, 3.0),
        "gear": gear,
        "engine_load_pct": 60.0 + wander(samples, dt_s, seed + 3, 15.0, 3.0),
        "wheel_speed_mps": 1.5 + wander(samples, dt_s, seed + 4, 0.4, 3.0),
        "machine_mass_kg": 15000.0 + 20.0 * dt_s * np.arange(samples),
    }


def recording(seconds: float = 40.0, seed: int = 0, dt_s: float = PERIOD_S) -> Recording:
    samples = round(seconds / dt_s)
    return drive(seconds, seed, dt_s, columns=context(samples, dt_s, 10 * seed), source=f"drive{seed}.csv")


def scene_of(*recordings: Recording, raw: tuple[Recording, ...] | None = None, horizon_s: float = WARM_UP_S) -> Scene:
    return Scene(recordings, sorted({*recordings[0].columns, OUTPUT}), raw, horizon_s)
