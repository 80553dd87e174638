"""What stands behind an effect through whose signal every force acts: itself, another cause, or an unknown force."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.structures import parse
from cruise.signals import INPUT, OUTPUT
from cruise.validation import mediator
from cruise.validation.candidates import UNNAMED, candidate_of
from cruise.validation.judged import Judged
from cruise.validation.mediator import (
    ALONE,
    BY_COMMAND,
    BY_MANY,
    DIRECT,
    LONELIER,
    LONELY,
    MEDIATED,
    NOISY,
    TOLD,
    UNSEEN,
    Through,
    behind,
    least_of_a_force,
    leaves_room,
    needed,
    refuted,
)
from cruise.validation.study import Study, study
from cruise.validation.tried import Tried
from cruise.validation.unnamed import SPEED
from tests.validation.driving import drive, wander

CURVE = {"name": f"{UNNAMED}header_height_mm"}  # of a signal of which no effect of the table knows


@pytest.fixture(scope="module")
def begun() -> Study:
    drives = [drive(80.0, 4, 0.1, 0.02, columns={"pitch_deg": wander(800, 0.1, 1, 2.0, 5.0)})]
    return study(drives, parse("arx:na=1,nb=3,delay_s=0.4"), None, 0.2)


def said(begun: Study, left: float, instead: float, told: float, monkeypatch, **how) -> tuple[Through, float]:
    """The mediator leaves a share of the loss, the best direct cause takes a share of what it takes instead."""

    def share_told(*given) -> float:
        by = given[-1]
        return how.get("by_command", 0.0) if by == INPUT else how.get("alone", told) if by else told

    monkeypatch.setattr(mediator, "share_told", share_told)

    def leaves(share: float, name: str) -> Judged:
        return replace(begun.base, candidate=name, raw=share * np.ones_like(begun.base.raw))

    def takes(share: float, name: str) -> Judged:
        return leaves(1.0 - share * (1.0 - left), name)

    together = takes(how.get("many", 1.0), "coulomb_friction")
    monkeypatch.setattr(mediator, "_forces_together", lambda search, present: together)
    monkeypatch.setattr(mediator, "_exponent", lambda search, found: how.get("exponent", (1.0, 0.02)))
    direct = takes(instead, how.get("name", "grade"))
    return behind(begun, leaves(1.0, ""), leaves(left, "leakage"), direct, how.get("chosen", ()))


@pytest.mark.parametrize(
    ("left", "instead", "told", "how", "through"),
    [
        (0.1, 0.1, 0.9, {}, Through.ITSELF),
        (0.1, 0.1, TOLD - 0.05, {}, Through.UNRECORDED),
        (0.1, DIRECT + 0.05, 0.9, {}, Through.RECORDED),
        (0.1, DIRECT + 0.05, 0.9, {"name": f"{UNNAMED}gear"}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, {"name": f"{UNNAMED}gear", "chosen": ("dead_zone",)}, Through.RECORDED),
        (0.1, DIRECT + 0.05, 0.9, CURVE | {"alone": 0.85}, Through.RECORDED),
        (0.1, DIRECT - 0.05, 0.9, CURVE | {"alone": 0.85}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, CURVE | {"alone": 0.9 * ALONE[1] - 0.05}, Through.ITSELF),
        (0.1, DIRECT + 0.05, ALONE[0], CURVE | {"alone": ALONE[0] - 0.05}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, CURVE | {"alone": 0.85, "name": f"{UNNAMED}gear"}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, CURVE | {"alone": 0.85, "name": f"{UNNAMED}{SPEED}"}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, CURVE | {"alone": 0.85, "chosen": ("dead_zone",)}, Through.RECORDED),
        (MEDIATED + 0.05, LONELY - 0.05, 0.9, {}, Through.ITSELF),
        (UNSEEN - 0.05, LONELY - 0.05, TOLD - 0.05, {}, Through.UNRECORDED),
        (UNSEEN + 0.05, LONELY - 0.05, TOLD - 0.05, {}, Through.RECORDED),
        (UNSEEN - 0.05, LONELY + 0.05, TOLD - 0.05, {}, Through.RECORDED),
        (MEDIATED + 0.05, LONELY + 0.05, 0.9, {}, Through.RECORDED),
        (UNSEEN + 0.05, LONELIER - 0.05, 0.9, {}, Through.ITSELF),
        (UNSEEN + 0.05, LONELY - 0.05, 0.9, {}, Through.RECORDED),
        (MEDIATED + 0.05, LONELY - 0.05, 0.9, {"chosen": ("dead_zone",)}, Through.RECORDED),
        (NOISY + 0.05, LONELY - 0.05, 0.9, {}, Through.RECORDED),
        (1.1, 0.0, 0.9, {}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05}, Through.ITSELF),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY + 0.05}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05, "chosen": ("dead_zone",)}, Through.ITSELF),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05, "chosen": ("grade",)}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05, "name": "rolling_resistance"}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05, "name": "dead_zone"}, Through.RECORDED),
        (MEDIATED + 0.05, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.05}, Through.RECORDED),
        (0.26, DIRECT + 0.2, 0.9, {"many": BY_MANY - 0.01}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (0.6, 0.02)}, Through.ITSELF),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (0.6, 0.1)}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (1.4, 0.05)}, Through.ITSELF),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (1.4, 0.15)}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (0.6, 0.02), "name": "dead_zone"}, Through.RECORDED),
        (0.1, DIRECT + 0.2, 0.9, {"exponent": (0.6, 0.02), "chosen": ("grade",)}, Through.RECORDED),
        (0.26, 0.9, 0.9, {"exponent": (0.6, 0.02)}, Through.RECORDED),
        (0.1, 0.1, 0.9, {"by_command": (BY_COMMAND + 0.05) * 0.9}, Through.COMMANDED),
        (0.1, 0.1, 0.9, {"by_command": (BY_COMMAND - 0.05) * 0.9}, Through.ITSELF),
        (0.1, DIRECT + 0.05, 0.9, {"by_command": 0.9}, Through.RECORDED),
        (0.1, DIRECT + 0.05, 0.9, {"by_command": 0.9, "name": "rolling_resistance"}, Through.COMMANDED),
        (0.1, DIRECT + 0.05, 0.9, {"by_command": 0.7, "name": "rolling_resistance"}, Through.RECORDED),
        (0.1, DIRECT + 0.05, TOLD - 0.05, {"by_command": TOLD, "name": "rolling_resistance"}, Through.RECORDED),
        (NOISY + 0.05, 1.0, 0.9, {"by_command": 0.9, "name": "rolling_resistance"}, Through.COMMANDED),
    ],
)
def test_what_it_takes_away_tells_what_stands_behind_it(begun, left, instead, told, how, through, monkeypatch):
    found, margin = said(begun, left, instead, told, monkeypatch, **how)
    assert found is through
    assert (margin > 0.0) is (through not in (Through.RECORDED, Through.COMMANDED))


def test_it_is_nearly_the_cause_where_only_others_explain_a_little_too_much(begun, monkeypatch):
    def short(left: float, instead: float, told: float, **how) -> float:
        return -said(begun, left, instead, told, monkeypatch, **how)[1]

    assert short(0.5, 1.1 * LONELIER, 0.9) == pytest.approx(0.1)
    assert short(1.1 * MEDIATED, 1.5 * LONELY, 0.9) == pytest.approx(0.1)
    assert short(0.5, 1.1 * LONELIER, TOLD - 0.05) == short(NOISY + 0.05, 1.1 * LONELIER, 0.9) == 0.0
    assert short(0.5, 1.1 * LONELIER, 0.9, chosen=("dead_zone",)) == 0.0


def test_the_power_of_the_pressure_is_known_as_well_as_the_data_say():
    bar = np.maximum(150.0 + wander(1200, 0.1, 1, 60.0, 30.0), 30.0)
    one = drive(120.0, 4, 0.1, 0.02, columns={"line_pressure_bar": bar})
    lost = 0.5 * np.sqrt(bar / 100.0)
    speed = one.output - lost
    found = study([replace(one, columns={**one.columns, OUTPUT: speed})], parse("arx:na=1,nb=3,delay_s=0.4"), None, 0.2)
    leaky = found.search.grown(found.base.explanation, candidate_of("leakage", found.recordings))
    exponent, std = mediator._exponent(found.search, found.search.judged("leakage", leaky))
    assert 0.0 < std < 0.1
    assert exponent == pytest.approx(0.5, abs=4.0 * std)


def test_where_no_slope_is_recorded_a_force_that_nothing_foretells_is_no_news(begun, monkeypatch):
    flat = [
        replace(one, columns={k: v for k, v in one.columns.items() if k != "pitch_deg"}) for one in begun.recordings
    ]
    level = replace(begun, recordings=tuple(flat))
    for left in (0.1, UNSEEN - 0.05):
        assert said(begun, left, 0.1, TOLD - 0.05, monkeypatch)[0] is Through.UNRECORDED
        assert said(level, left, 0.1, TOLD - 0.05, monkeypatch)[0] is Through.ITSELF
    assert said(level, UNSEEN + 0.05, 0.1, TOLD - 0.05, monkeypatch)[0] is Through.RECORDED, "soil has as much"


def test_it_is_the_surer_the_farther_it_is_from_a_limit(begun, monkeypatch):
    def margin(left: float, instead: float) -> float:
        return said(begun, left, instead, 0.9, monkeypatch)[1]

    assert margin(0.05, 0.4) > margin(0.2, 0.4) > 0.0, "of what it leaves"
    assert margin(0.5, 0.05) > margin(0.5, 0.2) > 0.0, "of what another takes"
    assert margin(0.2, 0.05) == pytest.approx(1.0 - 0.05 / LONELY), "whichever is farther"


@pytest.mark.parametrize(("force", "is_needed"), [(0.5, True), (0.11, True), (0.09, False)])
def test_what_is_no_force_is_not_needed_where_a_force_alone_leaves_as_little(begun, force, is_needed):
    def tried(name: str, share: float) -> Tried:
        judged = replace(begun.base, candidate=name, raw=share * np.ones_like(begun.base.raw))
        return Tried(name, 1.0 - share, 100.0, 1.0, 9.0, judged, judged)

    alone = [tried("dead_zone", 0.2), tried("coulomb_friction", force), tried("leakage", 0.05), tried("grade", 0.9)]
    present, mediator = tried("", 1.0).judged, tried("leakage", 0.3).judged
    least = least_of_a_force(present, alone)
    assert least == pytest.approx(force)
    assert needed(present, mediator, alone[0], tried("dead_zone", 0.1), least) is is_needed


@pytest.mark.parametrize(
    ("left", "white", "room"), [(0.3, 0.26, False), (0.3, 0.24, True), (0.9, 0.8, False), (0.3, 0.31, True)]
)
def test_nothing_is_needed_beside_it_where_it_leaves_little_but_noise(begun, left, white, room):
    """A share of the present loss is asked for, and one of what it leaves; white noise that is more is none."""
    present, mediator = (replace(begun.base, raw=share * np.ones_like(begun.base.raw)) for share in (1.0, left))
    assert leaves_room(present, mediator, white**0.5) is room
    assert leaves_room(present, mediator, 0.0)


def test_a_curve_of_a_signal_that_no_force_reads_is_refuted_as_its_effects_are(begun):
    def tried(name: str, share: float) -> Tried:
        judged = replace(begun.base, candidate=name, raw=share * np.ones_like(begun.base.raw))
        return Tried(name, 1.0 - share, 100.0, 1.0, 9.0, judged, judged)

    names = ["gear_ratio", "grade", *(f"{UNNAMED}{one}" for one in ("gear", "pitch_deg", "header_height_mm", SPEED))]
    judged = tried("leakage", 0.2).judged
    assert refuted(judged, [tried(name, 0.3) for name in names]) == ("gear_ratio", f"{UNNAMED}gear")
    assert refuted(judged, [tried(name, 0.15) for name in names]) == (), "they leave clearly less"


def test_slip_shows_in_the_pressure_as_the_force_does_and_is_not_refuted_by_it(begun):
    def tried(name: str, share: float) -> Tried:
        judged = replace(begun.base, candidate=name, raw=share * np.ones_like(begun.base.raw))
        return Tried(name, 1.0 - share, 100.0, 1.0, 9.0, judged, judged)

    alone = [tried("wheel_slip", 0.3), tried("sensor_bias", 0.3)]
    assert refuted(tried("leakage", 0.2).judged, alone) == ("sensor_bias",)
