"""The gain falls in proportion to the load."""

import numpy as np

from cruise.effects.engine_droop import EngineDroop


def test_full_load_costs_the_droop_and_half_load_half_of_it():
    gain, _ = EngineDroop(0.08).step(1.0, 0.0, {"engine_load_pct": np.array([0.0, 50.0, 100.0])}, None, 0.2)
    np.testing.assert_allclose(gain, [1.0, 0.96, 0.92])


def test_it_scales_the_gain_that_is_there():
    assert EngineDroop(0.2).step(0.5, 0.0, {"engine_load_pct": 100.0}, None, 0.2)[0] == 0.4
