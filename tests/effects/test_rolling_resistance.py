"""Rolling resistance, by hand."""

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.rolling_resistance import RollingResistance


def phi(mass_kg, speed_mps):
    return RollingResistance(0.2).step(0.0, speed_mps, {"machine_mass_kg": mass_kg}, 0.0, 0.2)[0]


def test_far_from_standstill_it_is_the_weight_against_the_motion():
    assert phi(15000.0, 3.0) == pytest.approx(-9.81)
    assert phi(20000.0, 3.0) == pytest.approx(-9.81 * 4 / 3)
    assert phi(15000.0, -3.0) == pytest.approx(9.81)
    assert phi(15000.0, 0.0) == 0.0


def test_all_of_it_is_there_at_the_crossover():
    assert phi(15000.0, 0.15) / phi(15000.0, 3.0) == pytest.approx(0.75)
    assert phi(15000.0, 0.2) == phi(15000.0, 3.0)


def test_only_a_change_of_mass_tells_it_from_coulomb_friction():
    speeds = np.linspace(-2.0, 2.0, 40)
    friction, _ = CoulombFriction(0.2).step(0.0, speeds, {}, 0.0, 0.2)
    for mass_kg, ratio in ((np.full(40, 17000.0), 1.0), (np.linspace(15e3, 20e3, 40), 4.0 / 3.0)):
        resistance, _ = RollingResistance(0.2).step(0.0, speeds, {"machine_mass_kg": mass_kg}, 0.0, 0.2)
        share = resistance / friction
        assert share.max() / share.min() == pytest.approx(ratio)
