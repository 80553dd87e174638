"""Sensor bias: what it knows, and when."""

import numpy as np
import pytest

from cruise.effects.sensor_bias import SensorBias

DT_S = 0.2


def phi(ground_mps, wheel_mps, filter_s=30.0):
    signals = {"ground_speed_mps": ground_mps, "wheel_speed_mps": wheel_mps}
    return SensorBias(filter_s).over(0.0, np.zeros(len(ground_mps)), signals, DT_S)[0]


def test_a_constant_difference_is_known_from_the_first_sample_on_at_any_speed():
    wheel = np.sin(np.arange(300) / 20.0)
    np.testing.assert_allclose(phi(wheel - 0.07, wheel), -0.07, rtol=1e-9)


def test_the_noise_of_a_sample_does_not_explain_itself():
    noise = 0.04 * np.random.default_rng(3).standard_normal(4000)
    found = phi(1.0 + noise, np.ones(4000))[50:]
    assert abs(np.corrcoef(found, noise[50:])[0, 1]) < 0.05
    assert np.std(found) < 0.005


@pytest.mark.parametrize("filter_s", [4.0, 30.0])
def test_it_forgets_with_its_time_constant(filter_s):
    ground = np.where(np.arange(2000) < 1000, 1.0, 1.2)
    found = phi(ground, np.ones(2000), filter_s)
    assert found[1000] == 0.0, "known before the sample"
    assert found[1000 + round(filter_s / DT_S)] == pytest.approx(0.2 * (1 - np.exp(-1)), rel=0.02)


def test_it_is_the_mean_over_what_it_has_seen_before_it_forgets():
    difference = np.array([0.3, 0.1, -0.1, 0.5, 0.0])
    np.testing.assert_allclose(phi(1.0 + difference, np.ones(5)), [0.3, 0.3, 0.2, 0.1, 0.2], atol=1e-12)


def test_a_sample_without_a_speed_is_left_out():
    ground, wheel = np.full(20, 1.1), np.ones(20)
    wheel[7] = np.nan
    found = phi(ground, wheel)
    assert np.isnan(found[7])
    np.testing.assert_allclose(np.delete(found, 7), 0.1, rtol=1e-9)


def test_a_radar_shows_nothing_at_rest_and_what_it_learned_once_the_machine_moves():
    wheel = np.repeat([0.0, 2.0, 0.0, 2.0], 100)
    signals = {"ground_speed_mps": wheel + 0.3 * (wheel > 0.0), "wheel_speed_mps": wheel}
    found, _ = SensorBias(rest_share=0.0).over(0.0, np.zeros(400), signals, DT_S)
    assert found[101:200] == pytest.approx(np.full(99, 0.3))
    assert found[200:300] == pytest.approx(np.zeros(100))
    assert found[300:] == pytest.approx(np.full(100, 0.3))


def test_at_rest_from_the_first_sample_on_its_noise_does_not_explain_itself():
    noise = 0.04 * np.random.default_rng(3).standard_normal(100)
    signals = {"ground_speed_mps": noise, "wheel_speed_mps": np.zeros(100)}
    found, _ = SensorBias(rest_share=0.0).over(0.0, np.zeros(100), signals, DT_S)
    np.testing.assert_array_equal(found, 0.0)
