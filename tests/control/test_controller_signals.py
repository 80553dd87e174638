"""What is measured beside the speed acts through the model: gear, throttle, slope and load."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cruise.control.controller import Controller, ControlSettings
from cruise.effects.effect import Effect
from cruise.effects.grade import Grade
from cruise.effects.power_limit import PowerLimit
from cruise.model.model import Model
from cruise.signals import Sample
from tests.control.machine import EFFECTS, FRAME_S, MODEL, PERIOD_S, Loop, Machine


def test_a_change_of_gear_and_of_throttle_makes_no_bump_in_the_speed_that_is_asked_for():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.2, 20.0)
    for rpm in np.linspace(2100.0, 1500.0, 100):  # 120 rpm/s
        loop.machine.rpm = float(rpm)
        loop.engaged(1.2, FRAME_S)
    loop.engaged(1.2, 10.0)
    assert abs(np.array(loop.speeds[-300:]) - 1.2).max() < 0.045
    loop.machine.gear = 3
    settled = len(loop.commands)
    loop.engaged(1.2, 20.0)
    assert abs(np.diff(loop.currents[settled:])).max() <= 600.0 * FRAME_S + 1e-9
    assert loop.speeds[-1] == pytest.approx(1.2, abs=0.005)


@pytest.mark.parametrize(("gear", "setpoint_mps"), [(2, 1.2), (3, 1.8)])
def test_a_throttle_that_is_pushed_quickly_is_met_by_the_current(gear, setpoint_mps):
    """333 rpm/s, which the dead time lets through for 0.2 m/s: that is no dip of the engine."""
    loop = Loop(Machine(rpm=1100.0, gear=gear)).by_hand(700.0, 10.0).engaged(setpoint_mps, 20.0)
    for rpm in np.linspace(1100.0, 2100.0, 60):
        loop.machine.rpm = float(rpm)
        loop.engaged(setpoint_mps, FRAME_S)
    loop.engaged(setpoint_mps, 6.0)
    off_mps = np.array(loop.speeds[-180:]) - setpoint_mps
    assert np.abs(off_mps).max() < 0.23
    assert np.sqrt(np.mean(off_mps**2)) < 0.08


@pytest.mark.parametrize("share", [1.0, 0.0])
def test_the_acceleration_in_a_pitch_sensor_is_not_fed_back(share):
    """On level ground a model that knows slopes drives as one that doesn't, whatever of the acceleration is shown."""

    def driven(model: Model, shown: float) -> np.ndarray:
        loop = Loop(Machine(), model).by_hand(700.0, 20.0)
        step, before = loop.machine.step, [loop.machine.speed_mps]

        def pitching(current_ma: float) -> Sample:
            sample = step(current_ma)
            accel_mps2 = (sample.speed_mps - before[0]) / FRAME_S
            before[0] = sample.speed_mps
            pitch_deg = math.degrees(math.asin(shown * accel_mps2 / 9.81))
            return replace(sample, signals={**sample.signals, "pitch_deg": pitch_deg})

        loop.machine.step = pitching
        loop.sample = loop.machine.step(700.0)
        return loop.engaged(1.2, 10.0).engaged(1.7, 15.0).currents

    knows = Model(PERIOD_S, 1, 3, 2, (*EFFECTS, Grade(0.0, share, 0.4)), (0.4, 2e-4, 8e-4, 8e-4, 0.06, 0.02))
    assert np.abs(driven(knows, share) - driven(MODEL, 0.0)).max() < 6.0


def test_the_noise_of_a_pitch_sensor_is_less_of_a_slope_in_a_fast_gear():
    """As it would move the machine for as much longer there."""
    model = Model(PERIOD_S, 1, 3, 2, (*EFFECTS, Grade(0.0, 1.0, 0.4)), (0.4, 2e-4, 8e-4, 8e-4, 0.06, 0.02))

    def spread(gear: float) -> float:
        controller, rng, found = Controller(model, ControlSettings()), np.random.default_rng(0), []
        for k in range(400):
            signals = {"engine_speed_rpm": 2100.0, "gear": gear, "pitch_deg": 0.11 * rng.standard_normal()}
            controller.step(Sample(FRAME_S * k, 700.0, 1.2 + 0.01 * rng.standard_normal(), signals), None)
            found.append(controller.signals["pitch_deg"])
        return float(np.std(found[100:]))

    assert spread(4.0) < 0.6 * spread(2.0)
    assert spread(1.0) == pytest.approx(spread(2.0), rel=0.1)


def test_a_power_limit_that_looks_at_the_pitch_sees_the_slope_once():
    """Its own share of the acceleration is of the pitch as shown; where `grade` has it taken out, none is left."""

    def gains(*beside: Effect) -> np.ndarray:
        limit = PowerLimit(power_kw=20.0, rolling_resistance=0.06, acceleration_share=1.0, filter_s=0.4)
        theta = (*MODEL.theta[:4], *(0.02 for _ in beside), MODEL.theta[4])
        model = replace(MODEL, effects=(*EFFECTS, limit, *beside), theta=theta)
        controller, speed_mps, found = Controller(model, ControlSettings()), 1.0, []
        for k in range(300):
            accel_mps2 = 0.3 if 200 <= k < 260 else 0.0
            speed_mps += accel_mps2 * FRAME_S
            pitch_deg = math.degrees(math.asin(math.sin(math.radians(3.0)) + accel_mps2 / 9.81))
            signals = {"engine_speed_rpm": 2100.0, "gear": 2.0, "pitch_deg": pitch_deg}
            controller.step(Sample(FRAME_S * k, 700.0, speed_mps, signals), None)
            assert controller.state is not None
            found.append(controller.state.gain)
        return np.array(found)

    alone, beside = gains(), gains(Grade(0.0, 1.0, 0.4))
    assert alone[259] < 0.8
    assert np.abs(beside - alone)[199:].max() < 0.1


def test_an_engine_that_gives_way_to_the_drive_itself_is_no_trend():
    """400 rpm per m/s2, an engine at its limit: what the trend of it would add comes when it is back already."""
    loop = Loop(Machine()).by_hand(700.0, 20.0)
    step, before = loop.machine.step, [loop.machine.speed_mps]

    def drooping(current_ma: float) -> Sample:
        sample = step(current_ma)
        accel_mps2 = (sample.speed_mps - before[0]) / FRAME_S
        before[0] = sample.speed_mps
        loop.machine.rpm += 0.2 * (2100.0 - 400.0 * accel_mps2 - loop.machine.rpm)
        return sample

    loop.machine.step = drooping
    loop.engaged(1.2, 10.0).engaged(1.8, 15.0)
    assert max(loop.speeds) - 1.8 < 0.11


def test_the_observer_knows_the_pace_of_a_gear():
    loop = Loop(Machine(gear=4)).by_hand(700.0, 60.0)  # at rest, where nothing tells how fast the drive is
    controller, pace = loop.controller, (2.5 / 7.5) ** 2
    before_mps = controller.observer.disturbance_mps
    controller.step(replace(loop.sample, speed_mps=loop.sample.speed_mps + 0.05), None)
    gain = controller.observer.filter(controller.pole, pace).gain[1]
    learned_mps = controller.observer.disturbance_mps - before_mps
    assert learned_mps == pytest.approx(gain * controller.observer.calm * controller.observer.innovation_mps, rel=1e-3)


def test_the_law_knows_the_pace_of_a_gear():
    """A load in fourth gear: moves as dear as in second, where the same drive takes more current, cost 0.254 m/s."""
    machine = Machine(gear=4)
    loop = Loop(machine).by_hand(600.0, 30.0)
    start_mps = machine.speed_mps
    loop.engaged(start_mps, 10.0)
    machine.load_mps -= 0.5
    loop.engaged(start_mps, 15.0)
    assert start_mps - min(loop.speeds) < 0.245


def test_each_gear_has_its_law_whichever_was_driven_first():
    """Fourth gear quicker than its model may have the pole of a slow third: a move weighs another amount there."""
    loop = Loop(Machine(gear=3)).by_hand(600.0, 5.0)
    controller, state = loop.controller, loop.controller.state
    assert state is not None
    third = controller._programme(state)
    pole, pace = controller.pole, controller.pace
    controller.pace = 0.4 * pace
    fourth = controller._programme(state)
    assert fourth is not third
    assert fourth._weight == pytest.approx(math.sqrt(0.4) * third._weight, rel=0.05)
    controller.pole, controller.pace = pole, pace
    assert controller._programme(state) is third
