"""Rolling resistance, by hand."""

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.rolling_resistance import RollingResistance


def phi(mass_kg, speed_mps, **shape):
    return RollingResistance(0.2, **shape).step(0.0, speed_mps, {"machine_mass_kg": mass_kg}, 0.0, 0.2)[0]


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


def test_it_rises_with_the_speed_alike_in_both_directions():
    assert phi(15000.0, 3.0, rise_per_mps=0.5) == pytest.approx(-9.81 * 2.5)
    assert phi(15000.0, -1.0, rise_per_mps=0.5) == pytest.approx(9.81 * 1.5)


def test_what_the_model_holds_already_is_not_there_twice():
    assert phi(15000.0, 3.0, held_share=1.0) == pytest.approx(0.0)
    assert phi(18000.0, 3.0, held_share=1.0) == pytest.approx(-9.81 * 0.2)
    assert phi(18000.0, -3.0, held_share=0.5) == pytest.approx(9.81 * 0.7)


def test_over_a_recording_it_is_the_same_as_step_by_step():
    effect = RollingResistance(0.3, 0.4, 0.6)
    speeds, masses = np.linspace(-1.0, 2.0, 60), np.linspace(15e3, 19e3, 60)
    whole, _ = effect.over(0.0, speeds, {"machine_mass_kg": masses}, 0.1)
    state, stepped = effect.start(0.0), []
    for speed, mass in zip(speeds, masses, strict=True):
        value, state = effect.step(0.0, speed, {"machine_mass_kg": mass}, state, 0.1)
        stepped.append(value)
    assert whole == pytest.approx(np.array(stepped))
