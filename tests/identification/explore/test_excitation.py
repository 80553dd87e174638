"""Persistent excitation, spectrum and levels of inputs of which they are known."""

import numpy as np
import pytest

from cruise.identification.explore import Excitation, NotPossible, excitation
from tests.identification.explore.drives import DT_S, recording, steps, white

TIME_S = DT_S * np.arange(4000)


def excited(u: np.ndarray) -> Excitation:
    found = excitation([recording(u, u / 300.0)])
    assert isinstance(found, Excitation)
    return found


@pytest.mark.parametrize("lines", [1, 2, 5])
def test_a_sum_of_sinusoids_excites_of_twice_its_number(lines):
    waves = [40.0 * np.sin(2.0 * np.pi * f * TIME_S + f) for f in np.linspace(1.0, 8.0, lines)]
    u = 700.0 + np.sum(waves, axis=0)
    assert excited(u).persistent_order == 2 * lines


def test_white_noise_excites_of_any_order_and_a_ramp_hardly():
    assert excited(white(4000, 1)).persistent_order == 50
    assert excited(300.0 + 4.0 * TIME_S).persistent_order == 1
    assert 3 < excited(steps(4000, 1)).persistent_order <= 50


def test_the_share_below_1_hz_is_that_of_the_lines():
    u = 30.0 * np.sin(2.0 * np.pi * 0.5 * TIME_S) + 10.0 * np.sin(2.0 * np.pi * 4.0 * TIME_S)
    assert excited(u).share_below_1hz == pytest.approx(0.9, abs=1e-6)
    alternating = np.sqrt(450.0) * np.cos(
        np.pi * np.arange(4000)
    )  # at half the sampling rate, with the line's variance
    assert excited(30.0 * np.sin(2.0 * np.pi * 0.5 * TIME_S) + alternating).share_below_1hz == pytest.approx(0.5)
    assert excited(white(4000, 2)).share_below_1hz == pytest.approx(0.1, abs=0.03)


def test_the_spectrum_of_white_noise_is_flat_at_its_variance():
    found = excited(white(20_000, 3))
    assert np.mean(found.spectrum_ma2_per_hz[2:-2]) == pytest.approx(120.0**2 / 10.0, rel=0.05)
    assert np.sum(found.counts) == 20_000


@pytest.mark.parametrize("levels", [2, 3, 7])
def test_distinct_levels_are_counted_through_the_noise_of_the_sensor(levels):
    rng = np.random.default_rng(levels)
    places = np.linspace(450.0, 1000.0, levels)
    chosen = np.concatenate([np.arange(levels), rng.integers(0, levels, 60)])
    u = np.repeat(places[chosen], 40) + 1.0 * rng.standard_normal(40 * len(chosen))
    found = excited(u)
    assert found.levels == levels
    assert ("two levels can't show a curve" in " ".join(found.words())) == (levels == 2)


def test_a_constant_current_teaches_nothing():
    found = excitation([recording(np.full(100, 3.3), white(100, 1))])
    assert isinstance(found, NotPossible)
    assert "teaches nothing" in found.reason
