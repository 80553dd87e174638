"""The controller takes over without a bump and reaches the setpoint, on machines that differ from its model."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cruise.control.controller import NEUTRAL, Controller, ControlSettings
from cruise.effects.rate_limit import RateLimit
from cruise.model.model import Model
from cruise.signals import Sample
from tests.control.machine import EFFECTS, FRAME_S, MODEL, PERIOD_S, Loop, Machine


def test_it_is_neutral_until_it_is_engaged_and_again_after():
    loop = Loop(Machine()).by_hand(700.0, 10.0).engaged(1.3, 5.0)
    assert loop.currents.min() > 600.0
    for _ in range(3):
        assert loop.controller.step(loop.sample, None) == NEUTRAL
    assert loop.controller.limits.last_ma == 0.0


def test_a_past_of_the_limits_that_changed_by_itself_is_seen_before_it_acts():
    loop = Loop(Machine()).by_hand(700.0, 10.0)
    for _ in range(40):
        assert not loop.controller.upset
        loop.engaged(1.3, FRAME_S)
    loop.by_hand(650.0, 1.0).engaged(1.3, 1.0)
    assert not loop.controller.upset, "nor after it took over anew"
    loop.controller.limits.last_ma += 200.0
    assert loop.controller.upset
    loop.controller.limits.last_ma = math.nan
    assert loop.controller.upset
    loop.by_hand(650.0, FRAME_S)
    assert not loop.controller.upset, "neutral has no past"


def test_taking_over_makes_no_bump():
    loop = Loop(Machine(gain=3.3e-3, load_mps=-0.05)).by_hand(700.0, 20.0)
    present_mps = loop.machine.speed_mps
    loop.engaged(present_mps, 4.0)
    assert abs(loop.currents[:4] - 700.0).max() < 2.0
    assert abs(loop.currents - 700.0).max() < 6.0
    assert abs(np.array(loop.speeds) - present_mps).max() < 0.02


def test_taking_over_again_begins_from_the_machine_too():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.4, 20.0).by_hand(620.0, 20.0)
    present_mps, first = loop.machine.speed_mps, len(loop.commands)
    loop.engaged(present_mps, 4.0)
    assert abs(loop.currents[first:] - 620.0).max() < 6.0
    assert abs(np.array(loop.speeds[-80:]) - present_mps).max() < 0.02


FAR_OFF = 0.28  # overshoot of a machine that answers a fifth of a second later, or a third more, than its model

MACHINES = {
    "as the model": Machine(),
    "a third weaker": Machine(gain=2e-3),
    "a third stronger": Machine(gain=4e-3),
    "slower": Machine(pole=0.65),
    "more delay": Machine(delay=16),
    "uphill": Machine(load_mps=-0.2),
    "low engine speed": Machine(rpm=1500.0),
    "first gear": Machine(gear=1),
    "third gear": Machine(gear=3),
    "fourth gear": Machine(gear=4),
}


@pytest.mark.parametrize("name", MACHINES)
def test_there_is_no_steady_state_error_and_little_overshoot(name):
    machine = replace(MACHINES[name])
    loop = Loop(machine).by_hand(700.0, 20.0)
    start_mps = machine.speed_mps
    top_mps = 1.35 * start_mps
    loop.engaged(start_mps, 10.0).engaged(top_mps, 25.0)
    assert loop.speeds[-1] == pytest.approx(top_mps, abs=0.002)
    assert np.ptp(loop.speeds[-100:]) < 0.002
    most = FAR_OFF if name in ("a third stronger", "slower", "more delay") else 0.12
    assert max(loop.speeds) - top_mps < most * (top_mps - start_mps)
    down = len(loop.speeds)
    loop.engaged(start_mps, 25.0)
    assert loop.speeds[-1] == pytest.approx(start_mps, abs=0.002)
    assert start_mps - min(loop.speeds[down:]) < most * (top_mps - start_mps)


def test_a_drive_that_yields_more_at_a_greater_stroke_is_driven_as_it_is():
    """From creeping to fast and back, with a model that knows it and with one that does not."""

    def beyond_mps(model):
        loop = Loop(Machine(pole=0.75, stroke_share=0.8, delay=8), model).by_hand(600.0, 20.0).engaged(0.4, 10.0)
        up, down = (np.array(loop.engaged(wish, 20.0).speeds[-400:]) for wish in (2.0, 0.4))
        return max(up.max() - 2.0, 0.4 - down.min())

    knowing = replace(MODEL, theta=(0.75, 1e-4, 3e-4, 3.5e-4, 0.01), stroke_share=0.8, delay=1)
    assert beyond_mps(knowing) < 0.005
    assert beyond_mps(replace(knowing, stroke_share=0.0)) > 0.012


def test_a_step_of_load_is_taken_up():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.3, 20.0)
    loop.machine.load_mps -= 0.1
    loop.engaged(1.3, 20.0)
    assert 1.05 < min(loop.speeds[-400:]) < 1.27
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.002)


def test_adopting_another_model_makes_no_jump():
    loop = Loop(Machine(gain=2.5e-3)).by_hand(700.0, 20.0).engaged(1.2, 20.0)
    a, *b, c = MODEL.theta
    loop.controller.adopt(MODEL.with_theta((a + 0.1, *(0.7 * value for value in b), c - 0.05)))
    settled_ma = loop.currents[-1]
    loop.engaged(1.2, 15.0)
    assert abs(loop.currents[-300:] - settled_ma).max() < 0.1  # 0.9 if the observer isn't told
    assert abs(np.array(loop.speeds[-300:]) - 1.2).max() < 5e-4


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_adopting_on_the_way_leaves_what_was_asked_for_as_it_was(delay):
    """The watch compares the speed with what was asked for a dead time ago: another model did not ask for anything."""
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.2, 20.0).engaged(0.6, 1.5)
    asked = list(loop.controller.past_references)
    loop.controller.adopt(replace(MODEL, delay=delay))
    now = list(loop.controller.past_references)
    kept = min(len(asked), len(now))
    assert now[-kept:] == asked[-kept:]
    assert set(now[:-kept]) <= {asked[0]}


SERVOS = {
    "fast": RateLimit(),
    "a rate": RateLimit(270.0),
    "a lag": RateLimit(lag_s=0.3),
    "both": RateLimit(270.0, 0.3),
    "quick back": RateLimit(150.0, 0.1, 3.0),
}


@pytest.mark.parametrize("name", SERVOS)
def test_a_slow_servo_that_the_model_knows_is_no_reason_to_drive_slowly(name):
    """The current that flows is not what acts: neither the reach of the drive nor its steps end at one frame of it."""
    servo, model = SERVOS[name], replace(MODEL, effects=(SERVOS[name], *EFFECTS))
    loop = Loop(Machine(), model)
    step, acts_ma = loop.machine.step, [math.nan]

    def followed(current_ma: float) -> Sample:
        acts_ma[0], _ = servo.step(current_ma, 0.0, {}, acts_ma[0], FRAME_S)
        return replace(step(acts_ma[0]), current_ma=current_ma)

    loop.machine.step = followed
    loop.by_hand(700.0, 20.0).engaged(1.0, 5.0)
    up, down = (np.array(loop.engaged(wish, 12.0).speeds[-240:]) for wish in (1.8, 0.8))
    assert np.argmax(up > 1.7) * FRAME_S < 3.0
    assert np.argmax(down < 0.9) * FRAME_S < 3.0
    assert max(up.max() - 1.8, 0.8 - down.min()) < 0.02
    assert (up[-1], down[-1]) == pytest.approx((1.8, 0.8), abs=0.005)


def test_adopting_before_anything_is_known_is_fine():
    loop = Loop(Machine())
    loop.controller.adopt(MODEL.with_theta((0.5, *MODEL.theta[1:])))
    loop.by_hand(700.0, 10.0).engaged(1.3, 15.0)
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.01)


HOLES = {
    "speed": {"speed_mps": math.nan},
    "current": {"current_ma": math.nan},
    "engine speed": {"signals": {"engine_speed_rpm": math.nan, "gear": 2.0}},
    "gear": {"signals": {"engine_speed_rpm": 2100.0}},
}


@pytest.mark.parametrize("hole", HOLES)
def test_without_a_measurement_it_asks_for_neutral_at_once_and_does_not_hold_a_current(hole):
    loop = Loop(Machine()).by_hand(700.0, 10.0).engaged(1.3, 5.0)
    broken = replace(loop.sample, **HOLES[hole])
    commands = [loop.controller.step(broken, 1.3) for _ in range(4)]
    assert {command.current_ma for command in commands} == {0.0}
    assert {command.limited for command in commands} == {"no measurement"}
    # Once it can see again it begins from the measured current, not from what it wanted before.
    again = replace(loop.sample, current_ma=500.0)
    assert loop.controller.step(again, 1.3).current_ma == pytest.approx(500.0, abs=30.0)


@pytest.mark.parametrize("frame_s", [0.03, 0.15, 0.4])
def test_frames_that_do_not_fit_into_a_period_are_refused(frame_s):
    with pytest.raises(ValueError, match="must be a multiple"):
        Controller(MODEL, ControlSettings(frame_s=frame_s))


@pytest.mark.parametrize("frame_s", [0.1, 0.02, 0.01])
def test_any_frame_that_fits_will_do(frame_s):
    loop = Loop(Machine(), settings=ControlSettings(frame_s=frame_s)).by_hand(700.0, 10.0).engaged(1.3, 15.0)
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.01)


STRUCTURES = {
    "no delay": Model(PERIOD_S, 1, 1, 0, EFFECTS, (0.4, 1.8e-3, 0.02)),
    "delay and nothing else": Model(PERIOD_S, 0, 1, 3, EFFECTS, (3e-3, 0.03)),
    "delay of the whole horizon": Model(PERIOD_S, 1, 2, 15, EFFECTS, (0.4, 9e-4, 9e-4, 0.02)),
    "second order": Model(PERIOD_S, 2, 3, 1, EFFECTS, (0.5, -0.1, 2e-4, 8e-4, 8e-4, 0.02)),
}

MATCHING = {
    "no delay": Machine(delay=0),
    "delay and nothing else": Machine(delay=12, pole=0.0),
    "delay of the whole horizon": Machine(delay=60),
    "second order": Machine(delay=9),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_at_the_edges_drive_too(name):
    machine = replace(MATCHING[name])
    loop = Loop(machine, STRUCTURES[name]).by_hand(700.0, 20.0).engaged(1.3, 50.0)
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.01)
