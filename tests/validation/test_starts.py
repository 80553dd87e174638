"""Starts of a fit: what promises most to first order, what lies between, far apart from each other, not astray."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.rate_limit import RateLimit
from cruise.validation.candidates import EffectCandidate, with_effect
from cruise.validation.fitting import bounded
from cruise.validation.search import Search
from cruise.validation.starts import NEARLY, Promise, Starts, apart
from cruise.validation.told import told_shapes
from tests.validation.driving import drive
from tests.validation.test_search import START, recorded, search_of


def starts_of(search: Search) -> Starts:
    return Starts(search.scene, search.plan(search.fitted(START).explanation))


@pytest.mark.parametrize("curvature", [-0.1, 0.04])  # of the usual starts the weakest is 0.16, all curve upwards
def test_a_weak_effect_is_found_within_the_few_steps_that_a_start_gets(curvature):
    search = search_of(drive(240.0, 1, 0.2, 0.004, command=lambda u: u * (1.0 + 1e-3 * curvature * np.abs(u))))
    base = search.fitted(START)
    starts = Starts(search.scene, search.plan(base.explanation))
    best = starts.promising(list(EffectCandidate("quadratic_gain").grown(base.explanation)))[0].start.effects[0]
    assert isinstance(best, QuadraticGain)
    assert best.curvature == pytest.approx(curvature, rel=0.5)
    assert search.begun(base.explanation, EffectCandidate("quadratic_gain")).cost < 0.9 * base.cost


def test_starts_lie_between_the_best_option_and_its_neighbours_too():
    search = search_of(recorded(240.0, command=lambda u: u - np.clip(u, -200.0, 200.0)))
    options = [with_effect(START, DeadZone(threshold, 1.0)) for threshold in (50.0, 160.0, 260.0, 500.0)]
    promising = Starts(search.scene, search.plan(START)).promising(options)
    tried = [one.start.effects[0] for one in promising]
    thresholds = [one.threshold_ma for one in tried if isinstance(one, DeadZone)]
    assert len(thresholds) == len(promising)
    assert 160.0 < thresholds[0] < 260.0
    assert [one.left for one in promising] == sorted(one.left for one in promising)


def test_between_two_kinds_of_an_effect_lies_no_start():
    search = search_of(recorded(240.0, command=lambda u: np.where(np.abs(u) > 260.0, u, 0.0)))
    options = list(EffectCandidate("dead_zone", told=told_shapes("dead_zone", [])).grown(START))
    promising = Starts(search.scene, search.plan(START)).promising(options)
    zones = [zone for one in promising for zone in one.start.effects if isinstance(zone, DeadZone)]
    assert {zone.jump_share for zone in zones} == {0.0, 1.0}
    assert zones[0].jump_share == 1.0


def test_among_those_that_promise_nearly_as_much_the_farthest_comes_next():
    def promise(left: float, place: float) -> Promise:
        return Promise(left, place, START, True)

    best, beside, far, poor = promise(1.0, 2.0), promise(1.01, 1.5), promise(1.1, 5.0), promise(2.0 * NEARLY, 9.0)
    assert apart([best, beside, far, poor]) == [best, far, beside, poor]


def test_a_friction_that_would_hold_the_machine_still_starts_with_a_core_that_moves_it():
    search = search_of(recorded(240.0))
    starts = starts_of(search)
    held = with_effect(starts.explanation, CoulombFriction(0.05))
    held = type(held)(held.core, held.effects, (4.0,), held.offset_mps, held.structural)
    chosen = starts.nearest(held)
    errors = bounded(search.scene.errors([held, chosen]))
    assert np.sum(errors[1] ** 2) < 0.5 * np.sum(errors[0] ** 2)


def test_a_servo_that_takes_ten_seconds_for_its_stroke_is_found():
    def slow(current_ma: np.ndarray) -> np.ndarray:
        result = current_ma.copy()
        for i in range(1, len(current_ma)):
            result[i] = result[i - 1] + np.clip(current_ma[i] - result[i - 1], -12.0, 12.0)
        return result

    search = search_of(recorded(240.0, command=slow))  # 60 mA/s
    base = search.fitted(START)
    found = search.finished(search.begun(base.explanation, EffectCandidate("rate_limit")))
    effect = found.explanation.effects[0]
    assert isinstance(effect, RateLimit)
    assert effect.rate_ma_per_s == pytest.approx(60.0, rel=0.1)
    assert found.cost < 0.2 * base.cost


def test_where_no_start_keeps_its_promise_the_weakest_is_tried(monkeypatch):
    search = search_of(recorded(240.0))
    base, real = search.fitted(START), search.fitted
    tried = []

    def astray(start, *how):
        """Every fit with a dead zone above 60 mA ends nowhere."""
        tried.append(start.effects[0].threshold_ma)
        found = real(start, *how)
        return replace(found, cost=1e3 * base.cost) if tried[-1] > 60.0 else found

    starts = Starts(search.scene, search.plan(base.explanation))
    promises = [
        Promise(float(k), float(-k), with_effect(base.explanation, DeadZone(edge, 1.0)), True)
        for k, edge in enumerate((800.0, 600.0, 400.0, 200.0, 50.0))
    ]
    monkeypatch.setattr(search, "_starts_beside", lambda explanation: starts)
    monkeypatch.setattr(starts, "promising", lambda options: promises)
    monkeypatch.setattr(search, "fitted", astray)
    found = search.begun(base.explanation, EffectCandidate("dead_zone"))
    assert tried == [800.0, 600.0, 400.0, 50.0]
    assert found.cost < 2.0 * base.cost
