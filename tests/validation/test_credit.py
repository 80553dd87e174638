"""What stands in for something else counts for nothing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cruise.effects.power_limit import PowerLimit
from cruise.identification.structures import parse
from cruise.validation import trying
from cruise.validation.candidates import UNNAMED, with_effect
from cruise.validation.credit import (
    LATER,
    SURE_OF_SLIP,
    lingers,
    of_its_own,
    rings,
    stands_in_for_dead_time,
    taken_for_the_other,
    takes_acceleration_for_slope,
)
from cruise.validation.fitting import Fit
from cruise.validation.judged import Judged
from cruise.validation.search import Search
from cruise.validation.study import study
from tests.validation.diagnosing import tried
from tests.validation.driving import drive, wander

PERIOD_S = 0.2
PLAIN = "arx:na=1,nb=3,delay_s=0.4"


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


def test_a_grade_of_which_a_curve_of_the_slope_shows_little_is_the_sensors_acceleration():
    def judged(candidate: str, loss: float) -> Judged:
        return cast(Judged, SimpleNamespace(candidate=candidate, loss=loss))

    present, grade, curve = judged("", 1.0), judged("grade", 0.3), f"{UNNAMED}pitch_deg"
    assert takes_acceleration_for_slope(present, [grade, judged(curve, 0.85)])
    assert not takes_acceleration_for_slope(present, [grade, judged(curve, 0.4)])
    assert not takes_acceleration_for_slope(present, [grade]), "nothing to hold it against"
    assert not takes_acceleration_for_slope(present, [judged(curve, 0.85)])
