"""What wheel and radar usually make of the drive's speed: learned where it is calm, left by what changed."""

import math
from random import Random

import pytest

from cruise.control.usual import FADES_S, HELD_S, PRIOR_M2_PER_S, UsualShares

FRAME_S = 0.05
ALLOWED_MPS, DOUBTED = 0.08, 0.04


def driven(usual, speed_mps, ahead, seconds, bias_mps=0.0, noise=0.0):
    """The share that is used, by frame; `speed_mps` of the time, wheel and radar `ahead` by shares, drive biased."""
    rng, used = Random(2), []
    for k in range(round(seconds / FRAME_S)):
        true_mps = speed_mps(k * FRAME_S)
        others = tuple((1.0 + one) * true_mps + rng.gauss(0.0, noise) for one in ahead)
        usual.take(true_mps + bias_mps, others, ALLOWED_MPS, DOUBTED)
        used.append(usual.used)
    return used


def test_shares_are_learned_and_are_shares_at_another_speed_too():
    usual = UsualShares(FRAME_S)
    driven(usual, lambda s: 1.0 + 0.2 * math.sin(0.3 * s), (0.05, -0.03), 40.0, noise=0.01)
    for share, true in zip(usual.shares, (0.05, -0.03), strict=True):
        assert share.usual_mps(4.0) == pytest.approx(4.0 * true, abs=0.02)
        assert share.doubt < 0.2
    faster = driven(usual, lambda s: min(1.0 + 0.2 * s, 4.0), (0.05, -0.03), 20.0, noise=0.01)
    assert max(faster[3:]) < 0.5  # the speed of before is forgotten


def test_before_anything_is_known_a_share_of_a_data_sheet_is_allowed():
    assert 0.5 < max(driven(UsualShares(FRAME_S), lambda s: 3.0, (0.04, 0.04), 0.5)) < 1.0
    assert max(driven(UsualShares(FRAME_S), lambda s: 3.0, (0.1, 0.1), 0.5)) > 1.0


@pytest.mark.parametrize("bias_mps", [0.12, -0.12])
def test_a_bias_of_the_drive_is_found_and_does_not_become_usual(bias_mps):
    usual = UsualShares(FRAME_S)
    driven(usual, lambda s: 2.0, (0.03, 0.02), 20.0)
    used = driven(usual, lambda s: 2.0, (0.03, 0.02), 20.0, bias_mps=bias_mps)
    assert min(used[10:]) > 1.0


def test_one_other_that_changes_is_its_own_matter():
    usual = UsualShares(FRAME_S)
    driven(usual, lambda s: 2.0, (0.03, 0.02), 20.0)
    assert max(driven(usual, lambda s: 2.0, (0.3, 0.02), 5.0)) < 0.1
    assert max(driven(usual, lambda s: 2.0, (math.nan, 0.02), 5.0)) < 0.1


def test_with_nothing_beside_the_drive_nothing_is_said():
    usual = UsualShares(FRAME_S)
    assert all(math.isnan(one) for one in driven(usual, lambda s: 2.0, (math.nan, math.nan), 2.0))
    usual.take(math.nan, (2.0, 2.0), ALLOWED_MPS, DOUBTED)
    assert math.isnan(usual.used)


def test_what_comes_late_in_a_quick_change_teaches_little():
    """Both others 0.2 s late, up to 3 m/s at 1 m/s2; 0.1 s of it is known: without its rate it would teach 0.09 m/s."""
    usual, past = UsualShares(FRAME_S), []
    for k in range(80):
        past.append(1.0 + min(k * FRAME_S, 2.0))
        usual.take(past[-1], (past[max(k - 4, 0)],) * 2, ALLOWED_MPS, DOUBTED)
        assert usual.used < 1.0
        if k == 60:
            assert 0.0 < abs(usual.shares[0].usual_mps(2.0)) < 0.06


def test_what_teaches_was_undisputed_for_a_second():
    usual = UsualShares(FRAME_S)
    driven(usual, lambda s: 2.0, (0.03, 0.02), HELD_S)
    assert usual.shares[0].square_m2_per_s == 0.0
    driven(usual, lambda s: 2.0, (0.03, 0.02), 0.2)
    assert usual.shares[0].square_m2_per_s > 0.0


def test_what_was_usual_fades():
    usual = UsualShares(FRAME_S)
    driven(usual, lambda s: 2.0, (0.03, 0.02), 30.0)
    known = usual.shares[0].square_m2_per_s
    driven(usual, lambda s: 0.0, (0.03, 0.02), FADES_S + 1.0)
    assert usual.shares[0].square_m2_per_s == pytest.approx(known * math.exp(-1.0), rel=0.05)
    assert usual.shares[0].doubt == pytest.approx(
        math.sqrt(PRIOR_M2_PER_S / (PRIOR_M2_PER_S + usual.shares[0].square_m2_per_s))
    )
