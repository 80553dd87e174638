"""Coulomb friction, by hand and in a model."""

import math

import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.model.model import Model


@pytest.mark.parametrize(("speed_mps", "phi"), [(2.0, -1.0), (-2.0, 1.0), (0.0, 0.0), (0.1, -math.tanh(1.0))])
def test_it_acts_against_the_motion_and_hardly_depends_on_its_speed(speed_mps, phi):
    assert CoulombFriction(0.1).step(0.0, speed_mps, {}, None, 0.2)[0] == pytest.approx(phi, abs=1e-6)


def test_a_machine_with_it_comes_to_rest_sooner_and_does_not_run_backwards():
    free = Model(0.05, 1, 1, 0, (), (0.98, 1e-3, 0.0))
    held = Model(0.05, 1, 1, 0, (CoulombFriction(0.1),), (0.98, 1e-3, 0.02, 0.0))
    speeds = [one.predict(one.start(1.0, 0.0, {}), [0.0] * 60, [{}] * 60) for one in (free, held)]
    below = [next((k for k, speed in enumerate(run) if speed < 0.35), 60) for run in speeds]
    assert below[1] < 0.6 * below[0]
    assert 0.0 <= min(speeds[1]) < 0.02 < min(speeds[0])
