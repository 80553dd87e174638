"""Evidence is for what is more than a little, beside everything else that may be there a little."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cruise.validation.background import FORM, LITTLE, Background
from cruise.validation.disturbance import Disturbance

N = 3000
RNG = np.random.default_rng(5)
NOISE_MPS = 0.02
NOISE = NOISE_MPS * RNG.standard_normal(N)
SHAPES = RNG.standard_normal((6, N))
NAMES = ("grade", "dead_zone", "engine_speed", "leakage", "hysteresis", "crop_load")
Z = dict(zip(NAMES, SHAPES / np.sqrt(np.mean(SHAPES**2, axis=1))[:, None], strict=True))
J = RNG.standard_normal((N, 2)) * 0.05


def fitted(error: np.ndarray, room: float = np.inf) -> Any:
    """A fit of which only the error and its derivatives are asked."""
    return SimpleNamespace(
        error_mps=error,
        jacobian=J,
        layout=SimpleNamespace(scale=np.ones(2)),
        room=np.full(2, room),
        cost=float(np.nanmean(error**2)),
    )


def background(present: np.ndarray, after: dict[str, np.ndarray], **options: Any) -> Background:
    found = Background(
        fitted(present), {name: fitted(error) for name, error in after.items()}, Disturbance(), list(after), **options
    )
    found.settle(list(after))
    return found


def alone(error: np.ndarray) -> dict[str, np.ndarray]:
    """What every effect leaves where it takes away all that looks like it."""
    return {name: error - float(error @ z) / N * z for name, z in Z.items()}


def test_a_large_effect_has_the_evidence_and_a_little_of_everything_has_none():
    little = sum(0.003 * z for z in Z.values())
    one = background(NOISE + little + 0.06 * Z["grade"], alone(NOISE + little + 0.06 * Z["grade"]))
    assert one.evidence("grade") > 100.0
    assert all(one.evidence(name) < 10.0 for name in NAMES if name != "grade")
    nothing = background(NOISE + little, alone(NOISE + little))
    assert all(nothing.evidence(name) < 10.0 for name in NAMES)


def test_what_passes_for_little_follows_the_background():
    quiet = background(NOISE + 0.05 * Z["grade"], alone(NOISE + 0.05 * Z["grade"]))
    loud_error = NOISE + 0.05 * Z["grade"] + sum(0.006 * Z[name] for name in ("dead_zone", "engine_speed", "crop_load"))
    loud = background(loud_error, alone(loud_error))
    assert quiet.little == (LITTLE[0], LITTLE[0])
    assert loud.little[1] > quiet.little[1]
    assert 0.0 < loud.evidence("grade") < quiet.evidence("grade")


def test_two_large_effects_are_no_large_background():
    error = NOISE + 0.05 * Z["grade"] + 0.04 * Z["dead_zone"]
    two = background(error, alone(error))
    assert two.little[1] == LITTLE[0]
    assert min(two.evidence("grade"), two.evidence("dead_zone")) > 300.0
    assert all(two.evidence(name) < 10.0 for name in NAMES if name not in ("grade", "dead_zone"))


def test_what_the_core_can_move_is_no_effect():
    error = NOISE + J @ np.array([0.8, -0.6])
    one = background(error, {"grade": NOISE})
    assert one.evidence("grade") < 10.0


def test_a_core_that_its_bounds_hold_moves_no_further():
    error = NOISE + J @ np.array([0.8, -0.6])
    held = Background(fitted(error, 0.0), {"grade": fitted(NOISE)}, Disturbance(), ["grade"])
    held.settle(["grade"])
    assert held.evidence("grade") > 100.0


def test_a_form_that_is_a_little_wrong_keeps_its_evidence():
    error = NOISE + 0.06 * Z["dead_zone"]
    right, wrong = NOISE, NOISE + 0.7 * FORM * 0.06 * Z["dead_zone"]
    exact = background(error, alone(error) | {"dead_zone": right}).evidence("dead_zone")
    assert background(error, alone(error) | {"dead_zone": wrong}).evidence("dead_zone") > 0.8 * exact


def test_an_effect_that_shows_in_a_measurement_of_its_own_counts_against_all_others():
    error = NOISE + 0.05 * Z["grade"]
    blind = background(error, alone(error))
    seeing = background(error, alone(error), seen=(0.02, frozenset({"crop_load"})))
    assert seeing.evidence("grade") == pytest.approx(blind.evidence("grade"), abs=1e-6)
    shown = (0.02 / (LITTLE[-1] * NOISE_MPS)) ** 2
    assert seeing.evidence("crop_load") - blind.evidence("crop_load") == pytest.approx(shown, rel=0.1)


def test_a_fit_that_went_astray_or_says_nothing_of_most_has_no_evidence():
    error = NOISE + 0.05 * Z["grade"]
    holes = NOISE.copy()
    holes[: 2 * N // 3] = np.nan
    one = background(error, alone(error) | {"engine_speed": 3.0 * error, "leakage": holes})
    assert one.evidence("engine_speed") == one.evidence("leakage") == 0.0
    assert {"engine_speed", "leakage"}.isdisjoint(one.directions)
    assert one.evidence("grade") > 100.0
