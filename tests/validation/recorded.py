"""Short recordings for tests of candidates, and the explanation that they begin with."""

import numpy as np

from cruise.model.core import Core
from cruise.recording import Recording
from cruise.validation.explanation import Explanation
from tests.validation.driving import drive, wander

BARE = Explanation(Core(2.5e-3, 0.3, 0.15, 0.6, 0.05), (), (), 0.1)
SAMPLES = 400


def recorded(seed: int = 1, **columns: np.ndarray) -> Recording:
    return drive(80.0, seed, 0.2, 0.02, columns=columns)


def everything(seed: int = 1) -> Recording:
    """All signals that any effect needs, all of them moving."""
    spread = {
        "pitch_deg": (0.0, 2.0),
        "engine_speed_rpm": (2050.0, 60.0),
        "engine_load_pct": (60.0, 15.0),
        "wheel_speed_mps": (1.5, 0.4),
        "machine_mass_kg": (17000.0, 900.0),
        "oil_temperature_c": (60.0, 8.0),
        "line_pressure_bar": (120.0, 40.0),
    }
    columns = {
        name: centre + wander(SAMPLES, 0.2, 20 * seed + i, width, 4.0)
        for i, (name, (centre, width)) in enumerate(spread.items())
    }
    return recorded(seed, **columns, gear=np.where(np.arange(SAMPLES) < 200, 2.0, 3.0))
