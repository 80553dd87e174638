"""Everything is tried from where the core really is."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.power_limit import PowerLimit
from cruise.effects.saturation import Saturation
from cruise.identification.structures import parse
from cruise.validation import trying
from cruise.validation.candidates import UNNAMED, candidates, unnamed, with_effect
from cruise.validation.fitting import Fit
from cruise.validation.judged import Judged
from cruise.validation.mediator import Through
from cruise.validation.search import Search
from cruise.validation.study import Study, study
from cruise.validation.tried import Step
from cruise.validation.trying import (
    LATER,
    MOVED,
    SURE_OF_SLIP,
    lingers,
    of_its_own,
    of_the_best_kind,
    rings,
    stands_in_for_dead_time,
    taken_for_the_other,
    takes_acceleration_for_slope,
    tried_beside,
)
from tests.validation.driving import drive, wander

PERIOD_S = 0.2
PLAIN = "arx:na=1,nb=3,delay_s=0.4"


@pytest.fixture(scope="module")
def plain() -> Study:
    return study([drive(160.0)], parse(PLAIN), None, PERIOD_S)


def tried(one: Study, present: Judged) -> Step:
    everyone, _ = candidates(one.recordings, present.explanation)
    return tried_beside(one, present, everyone, [], np.random.default_rng(1), lambda text: None)


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


def test_what_rings_is_fitted_from_elsewhere_where_the_core_has_a_pair_of_its_own(monkeypatch):
    one = study([drive(160.0, noise_mps=0.01, pair=(0.9, 0.7))], parse("arx:na=1,nb=3,delay_s=0.4"), None, PERIOD_S)
    seen: list[str] = []

    def elsewhere(search: Search, present: Judged, begun: tuple) -> Fit:
        seen.append(begun[0].name)
        return begun[1]

    monkeypatch.setattr(trying, "_from_elsewhere", elsewhere)
    monkeypatch.setattr(trying, "side_by_side", lambda work, things: [work(thing) for thing in things])
    assert one.base.explanation.core.servo_hz
    tried(one, one.base)
    assert {"resonance", "transport_delay"} <= set(seen)


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


@pytest.mark.parametrize(("friction", "counts"), [(0.5, False), (0.7, True)])
def test_a_load_of_the_engine_that_holds_back_as_friction_alone_does_says_nothing(friction, counts, monkeypatch):
    """Crop that leaves 0.4 of the loss; friction leaves 0.5 or 0.7 of it."""
    load_pct = 50.0 + wander(1600, 0.1, 5, 20.0, 2.0)
    one = study(
        [drive(160.0, columns={"engine_load_pct": load_pct, "machine_mass_kg": 15000.0 + 100.0 * load_pct})],
        parse("arx:na=1,nb=3,delay_s=0.4"),
        None,
        PERIOD_S,
    )
    leaves = {"crop_load": 0.4, "coulomb_friction": friction, "rolling_resistance": 0.9}
    judged = one.search.judged

    def as_said(name: str, found: Fit) -> Judged:
        share = leaves.get(name, 1.0)
        return replace(judged(name, found), raw=share * one.base.raw, white=share * one.base.white)

    monkeypatch.setattr(one.search, "judged", as_said)
    credit = {found.name: found.credit for found in tried(one, one.base).tried}
    assert (credit["crop_load"] > 0.0) is counts
    assert credit["coulomb_friction"] == credit["rolling_resistance"] == 1.0


@pytest.mark.parametrize(
    ("told", "held", "own"),
    [(0.5, 0.9, True), (0.5, 0.55, False), (0.95, 1.0, False), (0.85, 1.0, True), (1.1, 1.0, False)],
)
def test_what_the_pressure_tells_of_the_drive_and_friction_leave_must_be_a_share_of_what_a_load_takes(told, held, own):
    assert of_its_own(1.0, 0.4, told, held) is own


def test_a_resonance_that_needs_all_the_dead_time_there_may_be_stands_in_for_more_of_it(plain):
    def judged(name: str, delay_s: float, loss: float) -> Judged:
        core = replace(plain.base.explanation.core, delay_s=delay_s)
        there = plain.search.plan(replace(plain.base.explanation, core=core))
        return replace(
            plain.base,
            candidate=name,
            fit=replace(plain.base.fit, layout=there, vector=there.vector),
            raw=loss * np.ones_like(plain.base.raw),
        )

    most_s = plain.search.longest_delay_s
    delay = judged("transport_delay", 1.4, 1.0)
    assert stands_in_for_dead_time(plain.search, [judged("resonance", most_s, 0.95), delay])
    assert not stands_in_for_dead_time(plain.search, [judged("resonance", 0.8 * most_s, 0.95), delay]), "it has room"
    assert not stands_in_for_dead_time(plain.search, [judged("resonance", most_s, 0.7), delay]), "it rings"
    assert stands_in_for_dead_time(plain.search, [judged("resonance", most_s, 0.95)]), "more is not to be had"
    assert not stands_in_for_dead_time(plain.search, [delay])


def test_a_limit_that_the_machine_follows_later_than_the_current_is_none(plain):
    """Soil and loads that show in the pressure last longer than a machine takes to follow its pump."""

    def judged(effect: PowerLimit, name: str = "power_limit") -> Judged:
        there = plain.search.plan(with_effect(plain.base.explanation, effect))
        return replace(plain.base, candidate=name, fit=replace(plain.base.fit, layout=there, vector=there.vector))

    late_s = LATER * plain.base.explanation.core.behind_s
    assert lingers(judged(PowerLimit(power_kw=40.0, follow_s=1.05 * late_s)))
    assert not lingers(judged(PowerLimit(power_kw=40.0, follow_s=0.95 * late_s)))
    assert not lingers(judged(PowerLimit(onset_pct=90.0, follow_s=1.05 * late_s))), "the load cuts, whatever follows"
    assert not lingers(judged(PowerLimit(power_kw=40.0, follow_s=1.05 * late_s), "grade")), "it was there before"


def test_what_lingers_counts_against_nobody(plain, monkeypatch):
    monkeypatch.setattr(trying, "lingers", lambda one: one.candidate == "dead_zone")
    credit = {one.name: one.credit for one in tried(plain, plain.base).tried}
    assert credit["dead_zone"] == 0.0 < credit["saturation"]


def test_a_resonance_that_hardly_swings_back_is_none(plain):
    """A loop that closes quickly and creeps to its end leaves what a damped pair takes, too."""

    def judged(damping: float) -> Judged:
        core = replace(plain.base.explanation.core, resonance_share=0.5, damping=damping)
        there = plain.search.plan(replace(plain.base.explanation, core=core, structural=frozenset({"resonance"})))
        fit = replace(plain.base.fit, layout=there, vector=there.vector)
        return replace(plain.base, candidate="resonance", fit=fit)

    assert rings([judged(0.3)])
    assert not rings([judged(0.55)])
    assert rings([replace(judged(0.6), candidate="grade")])


@pytest.mark.parametrize(
    ("sure", "slip_leaves", "bias_leaves", "none"),
    [
        (2.0, 0.2, 0.2, ("sensor_bias",)),
        (-2.0, 0.2, 0.2, ("wheel_slip",)),
        (-2.0, 0.2, 0.25, ("wheel_slip",)),  # the bias takes 94 % of what slip takes
        (-2.0, 0.2, 0.3, ()),
        (2.0, 0.7, 0.2, ()),
        (0.9 * SURE_OF_SLIP, 0.2, 0.2, ()),
        (-0.9 * SURE_OF_SLIP, 0.2, 0.2, ()),
    ],
)
def test_slip_is_no_bias_and_a_bias_no_slip_where_the_two_speeds_say_so(plain, sure, slip_leaves, bias_leaves, none):
    def judged(name: str, left: float) -> Judged:
        return replace(plain.base, candidate=name, raw=left * np.ones_like(plain.base.raw))

    search, present = cast(Search, SimpleNamespace(sure_of_slip=sure)), judged("", 1.0)
    both = [judged("wheel_slip", slip_leaves), judged("sensor_bias", bias_leaves)]
    assert taken_for_the_other(search, present, both) == none
    assert taken_for_the_other(search, present, []) == ()


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


def test_a_grade_of_which_a_curve_of_the_slope_shows_little_is_the_sensors_acceleration():
    def judged(candidate: str, loss: float) -> Judged:
        return cast(Judged, SimpleNamespace(candidate=candidate, loss=loss))

    present, grade, curve = judged("", 1.0), judged("grade", 0.3), f"{UNNAMED}pitch_deg"
    assert takes_acceleration_for_slope(present, [grade, judged(curve, 0.85)])
    assert not takes_acceleration_for_slope(present, [grade, judged(curve, 0.4)])
    assert not takes_acceleration_for_slope(present, [grade]), "nothing to hold it against"
    assert not takes_acceleration_for_slope(present, [judged(curve, 0.85)])
