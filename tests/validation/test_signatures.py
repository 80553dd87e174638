"""Each missing term has the strongest test of its own regressor, and noise has none."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.arx import fit_arx
from cruise.identification.preparation import PreparationSettings
from cruise.identification.structures import Family, parse
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.comparison import Comparison, compare, of_parameters
from cruise.validation.signatures import Signature, signatures
from tools.benchmarks.recovery import currents, filtered

PERIOD_S = 0.2
PLAIN = PreparationSettings(cutoff_hz=0.0)


def recorded(
    seed: int, quadratic: float = 0.0, grade: float = 0.0, gain: float = 0.0, samples: int = 1500
) -> Recording:
    """y = 0.7 y + 3e-4 v + 3e-4 v - grade s + e behind 0.4 s; v = u + quadratic (u - 725)^2, gain scales with rpm."""
    rng = np.random.default_rng(seed)
    u = currents(rng, samples)
    slope, rpm, header = (filtered([0.2], [1.0, -0.98], rng.standard_normal(samples)) for _ in range(3))
    v = (u + quadratic * (u - 725.0) ** 2) * (1.0 + gain * rpm)
    late = np.concatenate([np.full(2, v[0]), v])[:samples]
    forced = filtered([3e-4, 3e-4], [1.0], late) - grade * slope + 0.02 * rng.standard_normal(samples)
    columns = {
        INPUT: u,
        OUTPUT: filtered([1.0], [1.0, -0.7], forced),
        "pitch_deg": slope,
        "engine_speed_rpm": 2000.0 + 50.0 * rpm,
        "header": header,
    }
    return Recording(PERIOD_S * np.arange(samples), columns, PERIOD_S, "system.csv")


def judged(recording: Recording, structure: str = "arx:na=1,nb=2,delay_s=0.4") -> Comparison:
    return compare(parse(structure), [recording], PLAIN)


def of(found: Comparison, name: str) -> Signature:
    return next(one for one in signatures(found).tests if one.regressor == name)


@pytest.mark.parametrize(
    ("lacking", "name", "sign"),
    [({"quadratic": 4e-4}, "u²", 1.0), ({"grade": 0.02}, "slope", -1.0), ({"gain": 0.05}, "engine speed u", 1.0)],
)
def test_the_missing_term_tells_most(lacking: dict, name: str, sign: float):
    found = signatures(judged(recorded(1, **lacking)))
    first = max((one for one in found.tests if not one.refused), key=lambda one: one.share)
    assert first.regressor == name
    assert first.found
    assert np.sign(first.correlation) == sign
    assert first.share == pytest.approx(first.correlation**2)


def test_the_standard_test_is_three_times_weaker_where_the_quadratic_is_missing():
    correlations, tests = [], []
    for seed in range(6):
        found = signatures(judged(recorded(seed, quadratic=4e-4)))
        (square,) = (one for one in found.tests if one.regressor == "u²")
        assert square.found
        correlations.append(abs(square.correlation / found.standard.correlation))
        tests.append(abs(square.t / found.standard.t))
    assert np.median(correlations) > 3.0
    assert np.median(tests) > 3.0


def test_a_model_that_has_the_term_refuses_or_does_not_find_it():
    curved = recorded(2, quadratic=4e-4)
    without, with_term = judged(curved), judged(curved, "arx:na=1,nb=2,delay_s=0.4+quadratic_gain")
    assert of(without, "u²").found
    assert not of(with_term, "u²").found


def test_what_the_model_could_absorb_itself_is_no_signature():
    structure = parse("arx:na=1,nb=2,delay_s=0.4")

    def weakened(recording: Recording) -> Comparison:
        model = fit_arx(structure.model(PERIOD_S), [recording]).model
        a, b_0, b_1, c_0 = model.theta
        weak = of_parameters(Family.ARX, model.with_theta((a, 0.8 * b_0, 0.8 * b_1, c_0 + 0.05)))
        return compare((structure, weak), [recording], PLAIN)

    found = signatures(weakened(recorded(5)))
    assert found.standard.found
    assert [one.regressor for one in found.tests if one.found] == []
    curved = recorded(5, quadratic=4e-4)
    assert of(weakened(curved), "u²").share == pytest.approx(of(judged(curved), "u²").share, abs=0.03)


def test_noise_is_found_nothing_as_often_as_the_level_says():
    below, found_any, tests, runs = Counter(), 0, 0, 25
    for seed in range(runs):
        all_tests = [one for one in signatures(judged(recorded(100 + seed, samples=900))).tests if not one.refused]
        below.update(one.regressor for one in all_tests if one.p_value < 0.05)
        found_any += any(one.found for one in all_tests)
        tests += len(all_tests)
    assert 0.01 < sum(below.values()) / tests < 0.1  # 3 minutes of driving; the level is 0.05
    assert found_any <= 4  # 5 % of 25 is 1; more than 4 has a chance of 1 %


def test_other_families_are_tested_too():
    curved = recorded(3, quadratic=4e-4)
    assert of(judged(curved, "oe:nf=1,nb=2,delay_s=0.4"), "u²").found
    assert not of(judged(curved, "narx:na=1,nb=2,degree=2,delay_s=0.4"), "u²").found


@pytest.mark.parametrize("name", ["u", "y"])
def test_what_never_moves_is_tested_against_nothing(name, monkeypatch):
    """A slope at a constant current is what is driven to see what it costs; within a dead zone the model stands."""
    moving = recorded(3, grade=0.01)
    found = compare(parse("arx:na=1,nb=2,delay_s=0.4"), [moving], PLAIN)
    if name == "u":
        still = replace(moving, columns={**moving.columns, INPUT: np.full(len(moving), 500.0)})
        found = replace(found, recordings=(still,))
    else:
        monkeypatch.setattr("cruise.validation.signatures._own_speeds", lambda _: [np.zeros(len(moving))])
    tests = signatures(found).tests
    assert all(math.isfinite(one.correlation) for one in tests if not one.refused)
    assert next(one.refused for one in tests if one.regressor == name) == "it never moves"


def test_a_recording_too_short_refuses():
    tests = signatures(judged(recorded(1, samples=120))).tests
    assert {one.refused for one in tests} <= {"too few blocks of time", "the model has this term"}
    assert not any(one.found for one in tests)
