"""The gain falls in proportion to the load beyond what the governor holds, as late as the crankshaft."""

import math

import numpy as np
import pytest

from cruise.effects.engine_droop import STALLED, EngineDroop


def gain(effect, load_pct, value=1.0):
    return effect.step(value, 0.0, {"engine_load_pct": load_pct}, effect.start(0.0 * load_pct), 0.2)[0]


def test_full_load_costs_the_droop_and_half_load_half_of_it():
    np.testing.assert_allclose(gain(EngineDroop(0.08), np.array([0.0, 50.0, 100.0])), [1.0, 0.96, 0.92])


def test_it_scales_the_gain_that_is_there():
    assert gain(EngineDroop(0.2), 100.0, value=0.5) == 0.4


def test_up_to_its_onset_the_governor_holds_the_speed():
    np.testing.assert_allclose(gain(EngineDroop(0.5, 60.0), np.array([20.0, 60.0, 100.0])), [1.0, 1.0, 0.8])


def test_no_load_stops_the_engine_or_makes_it_faster():
    assert gain(EngineDroop(1.5), 125.0) == STALLED
    assert gain(EngineDroop(1.5), -20.0) == 1.0


def test_the_crankshaft_follows_its_load_through_a_lag():
    effect, state = EngineDroop(0.2, filter_s=1.0), (0.0, 0.0)
    for _ in range(4):
        _, state = effect.step(1.0, 0.0, {"engine_load_pct": 100.0}, state, 0.2)
    found, _ = effect.step(1.0, 0.0, {"engine_load_pct": 100.0}, state, 0.2)
    assert found == pytest.approx(1.0 - 0.2 * (1.0 - math.exp(-1.0)))


def test_a_governor_with_an_integral_part_brings_the_speed_back_and_overshoots_when_the_load_goes():
    effect, state, gains = EngineDroop(0.2, recovery_per_s=0.25), (math.nan, math.nan), []
    for load_pct in [20.0] * 5 + [70.0] * 100 + [20.0] * 5:
        found, state = effect.step(1.0, 0.0, {"engine_load_pct": load_pct}, state, 0.2)
        gains.append(found)
    assert gains[4] == 1.0  # whatever load there is at first has been made up for
    np.testing.assert_allclose(gains[5:9], 1.0 - 0.1 * np.exp(-0.25 * 0.2 * np.arange(1, 5)))
    assert gains[104] == pytest.approx(1.0, abs=1e-3)
    assert gains[105] > 1.09
