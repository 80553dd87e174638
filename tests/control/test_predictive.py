"""The programme against a general solver, and its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

from cruise.control.predictive import Bounds, Now, PredictiveSettings, Programme
from cruise.control.shaping import CommandShaper

FRAME_S, DELAY, POLE = 0.05, 10, 0.75
RESPONSE = np.array([0.4, 0.4, 0.2])
WIDE = Bounds(-10.0, 10.0, 100.0, 100.0)
FREE = Bounds(-10.0, 10.0, 1e6, 1e6, 1e6)
DEPTH = DELAY + len(RESPONSE)


def programme(servo_s: float = 0.0, **changes) -> Programme:
    shaper = CommandShaper(2.0, 2, FRAME_S)
    return Programme(POLE, RESPONSE, DELAY, shaper, FRAME_S, PredictiveSettings(**changes), servo_s=servo_s)


def at_rest(speed_mps: float = 1.0, trend_mps2: float = 0.0) -> Now:
    return Now(speed_mps, np.full(DEPTH, speed_mps), np.full(2, speed_mps), 0.0, trend_mps2, speed_mps)


def simulated(wanted, now: Now, count: int, servo_s: float = 0.0) -> np.ndarray:
    """The equations of the module, step by step."""
    shaper = CommandShaper(2.0, 2, FRAME_S)
    shaper.states_ma = now.shaper_mps.tolist()
    past, speed, speeds = now.drives_mps.tolist(), now.speed_mps, []
    for k in range(count):
        kept = np.exp(-FRAME_S / servo_s) if servo_s else 0.0
        past.insert(0, kept * past[0] + (1.0 - kept) * shaper.step(wanted[k]))
        felt = sum(h * past[DELAY + j] for j, h in enumerate(RESPONSE))
        lasts_s = PredictiveSettings().believed_s
        load = now.load_mps + now.trend_mps2 * lasts_s * (1.0 - np.exp(-(k + 1) * FRAME_S / lasts_s))
        speed = POLE * speed + (1.0 - POLE) * (felt + load)
        speeds.append(speed)
    return np.array(speeds)


def test_at_rest_on_the_setpoint_it_stays():
    law = programme()
    found = law.solve(at_rest(), np.ones(law.count), WIDE)
    assert found.solved
    assert found.wanted_mps == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(found.speeds_mps, 1.0, atol=1e-6)


@pytest.mark.parametrize("servo_s", [0.0, 0.3])
def test_what_it_predicts_is_what_the_equations_give(servo_s):
    law = programme(servo_s, move_weight=1e9)  # the wish stands still
    rng = np.random.default_rng(0)
    now = Now(1.2, rng.uniform(0.8, 1.4, DEPTH), np.array([1.1, 0.9]), -0.1, 0.05, 1.3)
    found = law.solve(now, np.ones(law.count), FREE)
    assert found.wanted_mps == pytest.approx(1.3, abs=1e-4)
    np.testing.assert_allclose(found.speeds_mps, simulated(np.full(law.count, 1.3), now, law.count, servo_s), atol=1e-4)


def test_it_is_the_optimum():
    law = programme(accel_max_mps2=100.0, jerk_max_mps3=1e4)
    reference = 1.0 + np.linspace(0.0, 0.3, law.count)
    found = law.solve(at_rest(), reference, WIDE)
    lengths, weight = law.lengths, PredictiveSettings().move_weight

    def cost(blocks):
        wanted = np.repeat(blocks, lengths)
        wanted = np.concatenate([wanted, np.full(law.count - len(wanted), blocks[-1])])
        error = simulated(wanted, at_rest(), law.count) - reference
        moves = np.diff(np.concatenate([[1.0], blocks]))
        return error @ error + weight * moves @ moves

    best = optimize.minimize(cost, np.ones(len(lengths)), method="L-BFGS-B", options={"maxiter": 500, "ftol": 1e-14})
    assert found.wanted_mps == pytest.approx(best.x[0], abs=1e-3)


def test_in_a_gear_of_half_the_pace_a_move_costs_the_root_of_it():
    shaper = CommandShaper(2.0, 2, FRAME_S)
    settings = PredictiveSettings(move_weight=8.0)
    slow = Programme(POLE, RESPONSE, DELAY, shaper, FRAME_S, settings, pace=0.25)
    light = programme(move_weight=4.0)
    higher = np.full(light.count, 1.1)
    expected = light.solve(at_rest(), higher, WIDE).wanted_mps
    assert slow.solve(at_rest(), higher, WIDE).wanted_mps == pytest.approx(expected, abs=1e-9)
    assert programme(move_weight=8.0).solve(at_rest(), higher, WIDE).wanted_mps < expected - 0.005


def test_it_keeps_the_bounds_of_the_drive():
    law = programme(move_weight=1e-3)
    found = law.solve(at_rest(), np.full(law.count, 4.0), Bounds(0.5, 1.2, 100.0, 100.0))
    assert found.wanted_mps == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("shares", "jerk_mps3", "expected"), [((1.0, 1.0), 10.0, 1.0), ((0.5, 1.0), 10.0, 0.5), ((1.0, 0.5), 5.0, 0.5)]
)
def test_it_keeps_the_predicted_acceleration_as_far_as_it_is_worth(shares, jerk_mps3, expected):
    law = programme(move_weight=1e-3, excess_weight=1e5, jerk_max_mps3=jerk_mps3)
    found = law.solve(at_rest(), np.full(law.count, 4.0), Bounds(-10.0, 10.0, 100.0, 100.0, *shares))
    accel = np.diff(found.speeds_mps[DELAY:]) / FRAME_S
    assert accel.max() == pytest.approx(expected, rel=0.1)


def test_it_keeps_the_predicted_jerk():
    law = programme(move_weight=1e-3, excess_weight=1e5)
    found = law.solve(at_rest(), np.full(law.count, 4.0), WIDE)
    gentle = law.solve(at_rest(), np.full(law.count, 4.0), replace(WIDE, accel_share=10.0))
    assert np.abs(np.diff(gentle.speeds_mps[DELAY:], 2)[:3]).max() == pytest.approx(
        np.abs(np.diff(found.speeds_mps[DELAY:], 2)[:3]).max(), rel=0.1
    )  # its share is the acceleration's alone
    jerk = np.diff(found.speeds_mps[DELAY:], 2) / FRAME_S**2
    free = programme(move_weight=1e-3, accel_max_mps2=1e3, jerk_max_mps3=1e4)
    rough = np.diff(free.solve(at_rest(), np.full(law.count, 4.0), WIDE).speeds_mps[DELAY:], 2) / FRAME_S**2
    assert np.abs(rough).max() > 4.0 * np.abs(jerk).max()


def test_a_broken_bound_is_no_dead_end():
    law = programme()
    now = Now(3.0, np.full(DEPTH, 1.0), np.full(2, 1.0), 0.0, 0.0, 1.0)
    assert law.solve(now, np.ones(law.count), Bounds(0.99, 1.01, 0.1, 0.1)).solved


def test_a_trend_is_met_before_it_costs_speed():
    law = programme()
    assert law.solve(at_rest(trend_mps2=-0.1), np.ones(law.count), WIDE).wanted_mps > 1.005


def test_a_tap_that_hardly_acts_is_not_driven_to_the_ends():
    """What was sent already has broken the bound on jerk; a tap of a thousandth cannot mend that."""
    response, delay = np.array([0.001, 0.75, 0.19, 0.059]), 12
    law = Programme(0.8, response, delay, CommandShaper(2.0, 2, FRAME_S), FRAME_S, PredictiveSettings())
    sent = np.array([1.2, 1.1, *[1.0] * (delay + len(response) - 2)])
    found = law.solve(
        Now(1.0, sent, np.full(2, 1.2), 0.0, 0.0, 1.2), np.full(law.count, 1.2), Bounds(0.0, 2.4, 1.2, 1.2)
    )
    assert found.wanted_mps == pytest.approx(1.2, abs=0.15)
