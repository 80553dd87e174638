"""What all dry resistances have in common: they build up, hold a machine at rest, and are of one size beyond that."""

import math

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.crop_load import CropLoad
from cruise.effects.rolling_resistance import RollingResistance

DT_S = 0.2
H = math.exp(-DT_S / 0.9)
NOW = {"machine_mass_kg": 15000.0, "engine_load_pct": 50.0}
DRY = [
    (CoulombFriction(0.2), 1.0),
    (RollingResistance(0.2), 9.81),
    (CropLoad(crossover_mps=0.2), 0.5),
]


@pytest.mark.parametrize(("effect", "greatest"), DRY)
def test_it_builds_up_over_samples_is_bounded_and_holds_on_at_rest(effect, greatest):
    speeds = np.array([0.1, 0.1, 0.1, 2.0, 0.0, 0.0, -0.1, -2.0])
    shares = [0.5, 0.5 * H + 0.5, 1.0, 1.0, H, H**2, H**3 - 0.5, -1.0]
    signals = {name: np.full(len(speeds), NOW[name]) for name in effect.needs}
    np.testing.assert_allclose(effect.over(0.0, speeds, signals, DT_S)[0], -greatest * np.array(shares), rtol=1e-12)
