"""Everything is tried from where the core really is."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import Saturation
from cruise.identification.structures import parse
from cruise.validation import trying
from cruise.validation.candidates import UNNAMED, candidates, unnamed, with_effect
from cruise.validation.fitting import Fit
from cruise.validation.judged import Judged
from cruise.validation.mediator import Through
from cruise.validation.search import Search
from cruise.validation.study import Study, study
from cruise.validation.trying import (
    MOVED,
    leaves_only_noise,
    of_the_best_kind,
    tried_beside,
)
from tests.validation.diagnosing import DT_S, SAMPLES, SECONDS, few, tried
from tests.validation.driving import drive, levels, wander

PERIOD_S = 0.2
PLAIN = "arx:na=1,nb=3,delay_s=0.4"


def test_all_are_tried_anew_where_the_core_was_found_to_be_elsewhere(plain, monkeypatch):
    present = plain.base.explanation
    slow = replace(present, core=replace(present.core, time_constant_s=3.0, lag_s=0.9))
    astray = plain.search.judged("", plain.search.fitted(slow, steps=1))
    assert astray.fit.cost > 1.5 * plain.base.fit.cost
    fitted, began = trying._fitted, []

    def seen(search: Search, present: Judged, *others) -> list[Fit]:
        began.append(present.fit.cost)
        return fitted(search, present, *others)

    monkeypatch.setattr(trying, "_fitted", seen)
    step = tried(plain, astray)
    assert step.before.loss == pytest.approx(plain.base.loss, rel=0.02)
    assert min(one.gain for one in step.tried) > -0.1, "none stands where the core was"
    assert began == [astray.fit.cost, pytest.approx(plain.base.fit.cost, rel=0.02)]
    began.clear()
    monkeypatch.setattr(trying, "MOVED", 1.0)
    tried(plain, astray)
    assert began == [astray.fit.cost]
    assert MOVED < 0.1


def test_an_effect_whose_fit_went_astray_takes_nothing_away():
    """A stop of a drive that a strong curve made ten times as much of: every fit of it begins far below."""
    bent = drive(160.0, command=lambda u: u * (1.0 + 9.0 * u / 1000.0) / 6.0)
    one = study([bent], parse(f"{PLAIN}+quadratic_gain"), None, PERIOD_S)
    step = tried(one, one.base)
    stop = next(found for found in step.tried if found.name == "saturation")
    assert stop.judged.loss == step.before.loss
    assert (stop.gain, stop.counted) == (0.0, 0.0)
    (fitted,) = (effect for effect in stop.judged.explanation.effects if effect.name == "saturation")
    assert fitted == Saturation()
    assert np.isfinite(one.search.unseen_ahead_mps(stop.judged, 15)).any()
    assert min(found.gain for found in step.tried) > -0.2
    assert not np.isfinite(one.search.standard_errors(stop.judged.fit)).all()


def test_what_the_drive_itself_moves_is_no_direct_cause_in_the_place_of_the_pressure(monkeypatch):
    moves = wander(800, 0.2, 5, 20.0, 2.0)
    load_mps = -0.2 * (moves / 20.0) ** 2
    columns = {"engine_load_pct": 50.0 + moves, "line_pressure_bar": 120.0 - 300.0 * load_mps}
    one = study(
        [drive(160.0, 4, 0.2, 0.01, columns=columns, load_mps=load_mps)],
        parse("arx:na=1,nb=3,delay_s=0.4"),
        None,
        PERIOD_S,
    )
    seen: list[Judged] = []

    def remember(study: Study, present: Judged, mediator: Judged, direct: Judged, first: bool) -> tuple[Through, float]:
        seen.append(direct)
        return Through.RECORDED, 0.0

    monkeypatch.setattr(trying, "behind", remember)
    everyone = [*candidates(one.recordings, one.base.explanation)[0], *unnamed(one.recordings, one.base.explanation)]
    step = tried_beside(one, one.base, everyone, [], np.random.default_rng(1), lambda text: None)
    moved = {found.name: found.judged.loss for found in step.tried}
    assert moved[f"{UNNAMED}engine_load_pct"] < 0.5 * min(seen[-1].loss, step.before.loss), "it would explain most"
    assert seen[-1].candidate not in (f"{UNNAMED}engine_load_pct", f"{UNNAMED}line_pressure_bar", "leakage")


@pytest.fixture
def begun_elsewhere(monkeypatch) -> list[str]:
    """What is begun once more from elsewhere, where nothing better is found."""
    names: list[str] = []

    def elsewhere(search: Search, present: Judged, begun: tuple) -> Fit:
        names.append(begun[0].name)
        return begun[1]

    monkeypatch.setattr(trying, "_from_elsewhere", elsewhere)
    monkeypatch.setattr(trying, "side_by_side", lambda work, things: [work(thing) for thing in things])
    return names


def test_what_rings_is_fitted_from_elsewhere_where_the_core_has_a_pair_of_its_own(begun_elsewhere):
    one = study([drive(160.0, noise_mps=0.01, pair=(0.9, 0.7))], parse("arx:na=1,nb=3,delay_s=0.4"), None, PERIOD_S)
    assert one.base.explanation.core.servo_hz
    tried(one, one.base)
    assert {"resonance", "transport_delay"} <= set(begun_elsewhere)


def test_what_takes_nothing_or_is_far_behind_the_best_is_begun_from_nowhere_else(plain, begun_elsewhere):
    """No other start mends that, as fits of measured and simulated drives have shown."""
    tried(plain, plain.base)
    assert begun_elsewhere == [], "nothing takes anything"
    pitch = wander(1600, 0.1, 11, 2.5, 5.0)
    sloped = drive(load_mps=-3.4 * np.sin(np.radians(pitch)), columns={"pitch_deg": pitch})
    hidden = study([sloped], parse(PLAIN), None, PERIOD_S)
    costs = {one.name: one.judged.fit.cost for one in tried(hidden, hidden.base).tried}
    assert begun_elsewhere == ["grade"]
    _, times = trying.HOPELESS
    assert costs["grade"] == min(costs.values())
    assert 0.3 * hidden.base.fit.cost > costs["power_limit"] > times * costs["grade"], "far behind"


def test_beside_what_leaves_only_noise_nothing_is_tried_any_more():
    """No further effect can take the quarter of it that it would have to."""
    pitch = wander(4 * SAMPLES, 0.5 * DT_S, 11, 2.5, 5.0)
    load_mps = -3.4 * np.sin(np.radians(pitch))
    sloped = drive(2 * SECONDS, 4, 0.5 * DT_S, 0.02, load_mps=load_mps, columns={"pitch_deg": pitch})
    with few():
        one = study([sloped], parse(PLAIN), None, PERIOD_S)
        grade = tried(one, one.base).tried[0]
        assert grade.name == "grade"
        everyone, _ = candidates(one.recordings, grade.judged.explanation)
        given = (one, grade.judged, everyone, ["grade"], np.random.default_rng(1), lambda text: None)
        whole, ended = tried_beside(*given), tried_beside(*given, ends=True)
    assert ended.tried == ()
    assert ended.before.loss == pytest.approx(whole.before.loss, rel=0.02)
    assert 0 < len(whole.tried) == len(everyone)
    assert max(tried_one.gain for tried_one in whole.tried) < 0.1
    assert ended.background.noise == pytest.approx(whole.background.noise, rel=0.05)
    assert leaves_only_noise(one, ended.before)
    assert not leaves_only_noise(one, one.base)
    assert not leaves_only_noise(one, replace(ended.before, white=0.8 * ended.before.white)), "its past foretells it"
    assert not leaves_only_noise(replace(one, white_mps=0.0), ended.before), "the noise is not known"
    assert not leaves_only_noise(replace(one, white_mps=2.0 * one.white_mps), ended.before), "and nor is it here"


def test_a_law_of_the_models_own_that_bent_to_stand_in_for_another_begins_anew_beside_it():
    """Fitted without the dead zone, the parabola is as sharp as it can be; from there no fit finds all of that."""
    current_ma = levels(SAMPLES, DT_S, 4, 0.0, 700.0)
    one = drive(SECONDS, 4, DT_S, 0.02, lambda u: np.maximum(u - 150.0, 0.0), current_ma=current_ma)
    with few():
        begun = study([one], parse(f"{PLAIN}+quadratic_gain"), None, PERIOD_S)
        best = tried(begun, begun.base).tried[0]
    (bent,), (dead_zone, parabola) = begun.base.explanation.effects, best.judged.explanation.effects
    assert isinstance(bent, QuadraticGain)
    assert bent.curvature > 5.0
    assert best.gain > 0.7
    assert isinstance(dead_zone, DeadZone)
    assert dead_zone.threshold_ma == pytest.approx(150.0, abs=10.0)
    assert isinstance(parabola, QuadraticGain)
    assert abs(parabola.curvature) < 0.2


def test_of_two_kinds_the_one_that_errs_less_beside_the_others_is_kept():
    one = study(
        [drive(160.0, 5, 0.1, 0.02, command=lambda u: np.maximum(u - 350.0, 0.0))], parse(PLAIN), None, PERIOD_S
    )
    detent = with_effect(one.base.explanation, DeadZone(350.0, jump_share=1.0))
    wrong = one.search.judged("", one.search.fitted(detent))
    right = of_the_best_kind(one, wrong)
    (zone,) = right.explanation.effects
    assert isinstance(zone, DeadZone)
    assert zone.jump_share == 0.0
    assert zone.threshold_ma == pytest.approx(350.0, abs=8.0)
    assert right.loss < 0.5 * wrong.loss
    assert of_the_best_kind(one, right).explanation == right.explanation
