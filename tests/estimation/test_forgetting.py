"""How fast to forget: long while nothing changes, fast after a change; one bad sample is neither."""

import numpy as np
import pytest

from cruise.estimation.forgetting import Forgetting, ForgettingSettings

PERIOD_S, NOISE_MPS = 0.2, 0.02
SETTINGS = ForgettingSettings()


def settled(seed: int = 1) -> Forgetting:
    forgetting = Forgetting(SETTINGS, PERIOD_S, NOISE_MPS**2)
    for innovation in NOISE_MPS * np.random.default_rng(seed).standard_normal(2000):
        forgetting.step(float(innovation))
    return forgetting


def memory_s(factor: float) -> float:
    return PERIOD_S / (1.0 - factor)


@pytest.mark.parametrize("sigmas", [10.0, 100.0])
def test_one_bad_sample_does_not_pass_for_noise(sigmas: float):
    forgetting = settled()
    before = forgetting.slow
    forgetting.step(sigmas * NOISE_MPS)
    assert forgetting.slow <= before * (1.0 + PERIOD_S / SETTINGS.fall_s * (SETTINGS.outlier - 1.0))


def test_a_change_is_forgotten_over_fast_though_a_bad_sample_came_before_it():
    forgetting = settled()
    forgetting.step(100.0 * NOISE_MPS)
    for _ in range(round(3.0 * SETTINGS.fast_s / PERIOD_S)):
        forgetting.step(NOISE_MPS)  # what the sample left in the fast mean
    shortest = min(memory_s(forgetting.step(4.0 * NOISE_MPS)) for _ in range(round(SETTINGS.fast_s / PERIOD_S)))
    assert shortest < 2.0 * SETTINGS.shortest_s


def test_noise_alone_keeps_the_memory_long():
    forgetting = settled()
    draws = NOISE_MPS * np.random.default_rng(2).standard_normal(500)
    assert np.median([memory_s(forgetting.step(float(one))) for one in draws]) > 0.7 * SETTINGS.longest_s
