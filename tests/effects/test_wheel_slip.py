"""Wheel slip: what it takes for slip."""

import numpy as np
import pytest

from cruise.effects.wheel_slip import WheelSlip
from cruise.model.model import Model

DT_S = 0.2


def lost_mps(ground_mps, wheel_mps, filter_s=0.6):
    """What the ground lags behind the wheels, by the effect, at the measured speed of one sample ago."""
    signals = {"ground_speed_mps": ground_mps, "wheel_speed_mps": wheel_mps}
    past = np.concatenate([ground_mps[:1], ground_mps[:-1]])
    return -WheelSlip(filter_s).over(0.0, past, signals, DT_S)[0]


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("slip", [0.05, 0.2])
def test_what_is_lost_is_the_difference_of_the_speeds_in_both_directions_of_travel(direction, slip):
    wheel = np.full(100, 1.5 * direction)
    assert lost_mps((1.0 - slip) * wheel, wheel)[-1] == pytest.approx(slip * 1.5 * direction, rel=1e-6)


@pytest.mark.parametrize("filter_s", [0.1, 0.6])
def test_it_is_known_a_sample_later_and_follows_with_its_time_constant(filter_s):
    wheel, ground = np.ones(60), np.where(np.arange(60) < 30, 1.0, 0.7)
    found = lost_mps(ground, wheel, filter_s)
    assert found[30] == 0.0
    slip = 0.3 * (1 - np.exp(-DT_S / filter_s))
    assert found[31] == pytest.approx(0.7 * slip / (1 - slip))


def test_at_rest_the_last_slip_stays_and_nothing_is_lost():
    wheel = np.concatenate([np.full(50, 1.0), np.full(50, 0.29), np.zeros(50)])
    ground = np.concatenate([np.full(50, 0.8), np.full(50, 0.2), np.zeros(50)])
    found = lost_mps(ground, wheel)
    np.testing.assert_allclose(found[51:100], 0.2 * 0.2 / 0.8, rtol=1e-6)
    np.testing.assert_array_equal(found[101:], 0.0)


@pytest.mark.parametrize(("ground_mps", "limit"), [(0.1, 0.5), (5.0, -0.5)])
def test_slip_that_no_tyre_has_is_bounded(ground_mps, limit):
    found = lost_mps(np.full(60, ground_mps), np.ones(60))[-1]
    assert found == pytest.approx(ground_mps * limit / (1 - limit), rel=1e-6)


def test_a_machine_whose_wheels_slip_settles_at_what_the_wheels_leave():
    speed_mps, free_mps, slip = 0.0, 2.0, 0.25
    for _ in range(100):
        now = {"ground_speed_mps": (1 - slip) * 1.6, "wheel_speed_mps": 1.6}
        phi, _ = WheelSlip().step(0.0, speed_mps, now, slip, DT_S)
        speed_mps = 0.7 * speed_mps + 0.3 * (free_mps + phi)
    assert speed_mps == pytest.approx((1 - slip) * free_mps)


def test_in_a_model_it_is_a_load_that_grows_with_the_speed():
    model = Model(DT_S, 0, 1, 0, (WheelSlip(),), (1e-3, 0.9, 0.1))
    assert model.parameter_names == ("b_0_mps_per_ma", "c_wheel_slip", "c_0_mps")
    now = {"ground_speed_mps": 0.8, "wheel_speed_mps": 1.0}
    state = model.start(0.8, 900.0, now)
    for _ in range(60):
        state = model.advance(state, 900.0, 0.8, now)
    assert model.next_speed(state) == pytest.approx(0.9 - 0.9 * 0.2 + 0.1, rel=1e-6)
