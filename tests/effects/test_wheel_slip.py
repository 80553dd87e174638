"""Wheel slip: what it takes for slip."""

import numpy as np
import pytest

from cruise.effects import over
from cruise.effects.wheel_slip import WheelSlip
from cruise.model.model import Model

DT_S = 0.2


def gain(ground_mps, wheel_mps, share=1.0):
    signals = {"ground_speed_mps": ground_mps, "wheel_speed_mps": wheel_mps}
    return over(WheelSlip(share), np.ones(len(ground_mps)), np.zeros(len(ground_mps)), signals, DT_S)[0]


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_the_gain_falls_by_the_slip_in_both_directions_of_travel(direction, share):
    wheel = np.full(100, 1.5 * direction)
    assert gain(0.8 * wheel, wheel, share)[-1] == pytest.approx(1 - 0.2 * share, rel=1e-6)


def test_it_is_known_a_sample_later_and_follows_with_its_time_constant():
    wheel, ground = np.ones(60), np.where(np.arange(60) < 30, 1.0, 0.7)
    found = gain(ground, wheel)
    assert found[30] == 1.0
    assert found[31] == pytest.approx(1 - 0.3 * (1 - np.exp(-DT_S / WheelSlip().filter_s)))


def test_at_rest_the_last_slip_stays():
    wheel = np.concatenate([np.full(50, 1.0), np.full(50, 0.29), np.zeros(50)])
    ground = np.concatenate([np.full(50, 0.8), np.full(100, 0.1)])
    found = gain(ground, wheel)
    np.testing.assert_array_equal(found[50:], found[50])


@pytest.mark.parametrize(("ground_mps", "limit"), [(0.0, 0.9), (5.0, -0.5)])
def test_slip_that_no_tyre_has_is_bounded(ground_mps, limit):
    assert gain(np.full(60, ground_mps), np.ones(60))[-1] == pytest.approx(1 - limit, rel=1e-6)


def test_in_a_model_it_is_a_gain_and_a_bias_a_load():
    model = Model(DT_S, 0, 1, 0, (WheelSlip(1.0),), (1e-3, 0.1))
    assert model.parameter_names == ("b_0_mps_per_ma", "c_0_mps")
    now = {"ground_speed_mps": 0.8, "wheel_speed_mps": 1.0}
    state = model.start(0.8, 900.0, now)
    for _ in range(60):
        state = model.advance(state, 900.0, 0.8, now)
    assert model.next_speed(state) == pytest.approx(0.8 * 0.9 + 0.1, rel=1e-6)
