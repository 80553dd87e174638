"""Coulomb friction, by hand and in a model."""

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.model.model import Model


@pytest.mark.parametrize(("speed_mps", "phi"), [(2.0, -1.0), (-2.0, 1.0), (0.0, 0.0), (0.04, -0.4)])
def test_it_acts_against_the_motion_and_hardly_depends_on_its_speed(speed_mps, phi):
    assert CoulombFriction(0.1).step(0.0, speed_mps, {}, 0.0, 0.2)[0] == pytest.approx(phi)


def test_a_machine_with_it_comes_to_rest_sooner_and_does_not_run_backwards():
    free = Model(0.05, 1, 1, 0, (), (0.98, 1e-3, 0.0))
    held = Model(0.05, 1, 1, 0, (CoulombFriction(0.1),), (0.98, 1e-3, 0.02, 0.0))
    speeds = [one.predict(one.start(1.0, 0.0, {}), [0.0] * 60, [{}] * 60) for one in (free, held)]
    below = [next((k for k, speed in enumerate(run) if speed < 0.35), 60) for run in speeds]
    assert below[1] < 0.6 * below[0]
    assert abs(speeds[1][-1]) < 0.02 < min(speeds[0])
    assert min(speeds[1]) > -0.1


@pytest.mark.parametrize("drive_mps", [0.1, 0.3, -0.3])
def test_a_drive_that_is_weaker_than_it_moves_nothing_and_one_that_is_stronger_gives_the_rest(drive_mps):
    model = Model(0.2, 1, 1, 0, (CoulombFriction(0.07),), (0.6, 0.4e-3, 0.4 * 0.38, 0.0))
    weak, strong = (
        np.array(model.predict(model.start(0.0, 0.0, {}), [1e3 * d] * 50, [{}] * 50)) for d in (drive_mps, 1.0)
    )
    assert np.abs(weak[10:]).max() < 0.015
    assert strong[-1] == pytest.approx(1.0 - 0.38)


@pytest.mark.parametrize(
    ("speed_mps", "phi"), [(0.1, -2.5), (-0.1, 2.5), (0.2, -1.0 - 1.5 * np.exp(-3.0)), (2.0, -1.0)]
)
def test_there_is_more_of_it_at_a_creep_and_none_of_that_at_speed(speed_mps, phi):
    """Of what there is more at rest, 1 / e is left at the speed at which a film carries."""
    found, _ = CoulombFriction(0.05, 1.5 * np.e, 0.1).step(0.0, speed_mps, {}, 0.0, 0.2)
    assert found == pytest.approx(phi)
