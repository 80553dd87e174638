"""The dead zone: overlap that opens from nothing, and a detent that lets through at once all that was asked for."""

import math

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.effect import Inverse

OVERLAP, DETENT = DeadZone(threshold_ma=300.0), DeadZone(threshold_ma=300.0, jump_share=1.0)


def drives(zone: DeadZone, current_ma: float) -> float:
    return float(zone.step(current_ma, 0.0, {}, 0.0, 0.1)[0])


def test_overlap_takes_the_threshold_off_and_a_detent_takes_nothing_off_beyond_it():
    assert drives(OVERLAP, 500.0) == pytest.approx(200.0)
    assert drives(DETENT, 500.0) == pytest.approx(500.0)
    for zone in (OVERLAP, DETENT):
        assert drives(zone, 200.0) == pytest.approx(0.0, abs=1e-2)
        assert drives(zone, 0.0) == 0.0
        assert drives(zone, -500.0) == -drives(zone, 500.0)
    half = DeadZone(threshold_ma=300.0, jump_share=0.5)
    assert drives(half, 500.0) == pytest.approx(350.0)


def test_a_detent_opens_within_a_few_widths_and_rises_throughout():
    current_ma = np.linspace(-600.0, 600.0, 2401)
    for edge_ma in (0.0, 8.0, 40.0):
        zone = DeadZone(threshold_ma=300.0, edge_ma=edge_ma, jump_share=1.0)
        drive_ma, _ = zone.step(current_ma, 0.0, {}, 0.0, 0.1)
        assert np.all(np.diff(drive_ma) >= 0.0)
        assert drives(zone, 300.0) == pytest.approx(150.0)
        width_ma = max(edge_ma, 8.0)
        assert drives(zone, 300.0 - 6.0 * width_ma) < 1.0
        assert drives(zone, 300.0 + 6.0 * width_ma) > 299.0


@pytest.mark.parametrize("share", [1.0, 0.4])
@pytest.mark.parametrize("edge_ma", [0.0, 30.0])
def test_the_inverse_leads_back_to_the_value_and_to_the_edge_where_it_jumps(share, edge_ma):
    zone = DeadZone(threshold_ma=300.0, edge_ma=edge_ma, jump_share=share)
    for value in (1.0, -40.0, 150.0, -299.0, 700.0):
        found = zone.inverse(value, {}, 0.0)
        assert found.low == found.high
        assert math.copysign(1.0, found.low) == math.copysign(1.0, value)
        assert drives(zone, found.low) == pytest.approx(value, abs=1e-3)
    assert zone.inverse(0.0, {}, 0.0) == Inverse(0.0, 0.0)


def test_what_sticks_until_it_breaks_away_closes_at_less_than_it_opened_at():
    zone = DeadZone(threshold_ma=300.0, jump_share=1.0, release_share=0.6)
    up_and_down = np.array(
        [0.0, 250.0, 290.0, 310.0, 400.0, 250.0, 190.0, 170.0, 250.0, -250.0, -310.0, -190.0, -170.0]
    )
    drive_ma, _ = zone.over(up_and_down, np.zeros(len(up_and_down)), {}, 0.1)
    through_ma = [0.0, 0.0, 0.0, 310.0, 400.0, 250.0, 190.0, 0.0, 0.0, 0.0, -310.0, -190.0, 0.0]
    np.testing.assert_allclose(drive_ma, through_ma, atol=3.0)


def test_a_current_between_the_two_thresholds_is_taken_as_one_that_never_opened_it():
    zone = DeadZone(threshold_ma=300.0, jump_share=1.0, release_share=0.6)
    assert abs(zone.step(250.0, 0.0, {}, zone.start(0.0), 0.1)[0]) < 1e-6
    after_a_hole, _ = zone.over(np.array([400.0, 250.0, math.nan, 250.0]), np.zeros(4), {}, 0.1)
    np.testing.assert_allclose(after_a_hole, [400.0, 250.0, math.nan, 0.0], atol=1e-6)


def test_the_inverse_knows_whether_it_is_open():
    zone = DeadZone(threshold_ma=300.0, jump_share=1.0, release_share=0.6)
    for state, current_ma in ((1.0, 250.0), (0.0, 300.0)):
        assert zone.inverse(250.0, {}, state).low == pytest.approx(current_ma, abs=8.0)


def test_only_a_detent_that_sticks_has_a_place_where_it_closes():
    assert "release_share" in DeadZone(300.0, release_share=0.6).idle
    assert "release_share" in DETENT.idle
    assert not DeadZone(300.0, jump_share=1.0, release_share=0.6).idle
