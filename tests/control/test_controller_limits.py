"""What the controller asks for stays within current, rate, acceleration and 1 Hz."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cruise.control.controller import Controller, ControlSettings, LimitStatus
from cruise.control.limits import LimitSettings
from cruise.control.observer import ObserverSettings
from cruise.control.predictive import PredictiveSettings
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.saturation import Saturation
from cruise.signals import Sample
from tests.control.machine import EFFECTS, FRAME_S, MODEL, RATIO, Loop, Machine


@pytest.mark.parametrize("gear", [1, 2])
def test_what_is_on_its_way_comes_in_its_order(gear):
    """A current that rose slowly, all of it within the dead time: its end at once would be three times that."""
    loop = Loop(Machine(gear=gear)).by_hand(700.0, 30.0)
    for k in range(10):
        loop.by_hand(700.0 + 10.0 * k, FRAME_S)
    known_mps2, speeds = loop.controller.coming_mps2, [loop.machine.speed_mps]
    for _ in range(12):
        loop.by_hand(790.0, FRAME_S)
        speeds.append(loop.machine.speed_mps)
    assert known_mps2 == pytest.approx(np.diff(speeds).max() / FRAME_S, rel=0.3)


def test_what_is_on_its_way_comes_frame_by_frame():
    """Three frames at another current: the model itself as the machine then moves by what was said, in each of them."""
    controller = Controller(MODEL, ControlSettings())
    fast, signals = controller.model, {"engine_speed_rpm": 2100.0, "gear": 2.0}
    state, speeds = fast.start(0.9, 700.0, signals), [0.9]

    def frames(count: int, current_ma: float, watched: bool = True) -> None:
        nonlocal state
        for _ in range(count):
            state = fast.apply(state, current_ma, signals)
            speeds.append(fast.next_speed(state))
            state = fast.observe(state, speeds[-1])
            if watched:
                controller.step(Sample(FRAME_S * len(speeds), current_ma, speeds[-1], signals), None)

    frames(600, 700.0)
    frames(5, 800.0)
    said = controller.coming_mps
    assert len(said) == fast.delay
    frames(fast.delay, 800.0, watched=False)
    moved = np.diff(speeds)[-fast.delay :]
    assert max(moved) > 0.01
    np.testing.assert_allclose(said, moved, atol=1e-4)


@pytest.mark.parametrize("gear", RATIO)
@pytest.mark.parametrize("change_ma", [200.0, -200.0])
def test_it_knows_the_acceleration_that_is_on_its_way(change_ma, gear):
    """A current that jumps by hand: what the machine then does was known before it began, and is over after it."""
    loop = Loop(Machine(gear=gear)).by_hand(800.0, 30.0)
    assert loop.controller.coming_mps2 < 0.02
    loop.by_hand(800.0 + change_ma, 0.5)
    known_mps2, before_mps = loop.controller.coming_mps2, loop.machine.speed_mps
    speeds = [before_mps]
    for _ in range(200):
        loop.by_hand(800.0 + change_ma, FRAME_S)
        speeds.append(loop.machine.speed_mps)
    assert known_mps2 == pytest.approx(abs(np.diff(speeds[:13])).max() / FRAME_S, rel=0.5)
    assert loop.controller.coming_mps2 < 0.1


def test_no_command_leaves_the_limits():
    limits = LimitSettings(current_min_ma=450.0, current_max_ma=760.0, rate_max_ma_per_s=100.0)
    loop = Loop(Machine(), settings=ControlSettings(limits=limits)).by_hand(700.0, 10.0)
    loop.engaged(3.0, 15.0)
    assert loop.currents[-1] == pytest.approx(760.0)
    loop.engaged(0.3, 15.0)
    assert loop.currents.min() >= 450.0
    assert loop.currents.max() <= 760.0
    assert abs(np.diff(loop.currents)).max() <= 100.0 * 0.05 + 1e-9
    assert any(command.limited for command in loop.commands)
    loop.engaged(1.2, 20.0)
    assert loop.speeds[-1] == pytest.approx(1.2, abs=0.01)


def test_acceleration_stays_within_what_is_comfortable():
    loop = Loop(Machine()).by_hand(600.0, 20.0).engaged(2.4, 15.0).engaged(0.6, 15.0)
    assert abs(np.diff(loop.speeds)).max() / FRAME_S < 1.0


def test_it_takes_over_gently_until_it_is_told_otherwise():
    def hardest(gently: bool) -> float:
        predictive = PredictiveSettings(accel_max_mps2=0.5)
        loop = Loop(Machine(), settings=ControlSettings(predictive=predictive)).by_hand(600.0, 20.0)
        for _ in range(100):
            loop.commands.append(loop.controller.step(loop.sample, 2.4, gently))
            loop.sample = loop.machine.step(loop.commands[-1].current_ma)
            loop.speeds.append(loop.machine.speed_mps)
        return float(abs(np.diff(loop.speeds)).max()) / FRAME_S

    assert hardest(True) < 0.9 * hardest(False)


def test_an_acceleration_is_bounded_as_if_the_drive_were_quicker_where_its_gear_is_not_sure():
    """Fourth gear, whose time constant the ratio alone does not tell, and second, which the model was learned in."""

    def hardest(gear: int, pace_share: float) -> float:
        settings = ControlSettings(
            predictive=PredictiveSettings(accel_max_mps2=0.5), observer=ObserverSettings(pace_share=pace_share)
        )
        loop = Loop(Machine(gear=gear), settings=settings).by_hand(830.0, 40.0)
        by_hand_mps = loop.machine.speed_mps
        loop.engaged(by_hand_mps, 8.0).engaged(0.6 * by_hand_mps, 12.0)
        return float(abs(np.diff(loop.speeds)).max()) / FRAME_S

    assert hardest(4, 0.25) < 0.9 * hardest(4, 1e-9)
    assert hardest(2, 0.25) == pytest.approx(hardest(2, 1e-9))


def test_the_command_has_little_above_1_hz_with_a_noisy_sensor_too():
    loop = Loop(Machine(band_ma=30.0)).by_hand(700.0, 20.0)
    rng = np.random.default_rng(0)
    step = loop.machine.step

    def noisy(current_ma: float) -> Sample:
        sample = step(current_ma)
        return replace(sample, speed_mps=sample.speed_mps + 0.01 * rng.standard_normal())

    loop.machine.step = noisy
    loop.engaged(1.0, 20.0).engaged(1.5, 20.0)
    spectrum = np.fft.rfft((loop.currents - loop.currents.mean()) * np.hanning(len(loop.currents)))
    power = 2.0 * np.abs(spectrum / len(loop.currents)) ** 2 * 8.0 / 3.0  # of a Hann window
    frequency_hz = np.fft.rfftfreq(len(loop.currents), FRAME_S)
    assert math.sqrt(power[frequency_hz > 1.0].sum()) < 6.0


def test_from_beyond_what_the_machine_can_do_it_comes_back_at_once():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.2, 10.0).engaged(9.0, 30.0)
    most_mps = loop.speeds[-1]
    assert loop.commands[-1].limit_status is LimitStatus.LIMITED_HIGH
    assert most_mps < loop.commands[-1].reference_mps < most_mps + 0.3
    loop.engaged(1.2, 2.0)
    assert loop.commands[-1].reference_mps < most_mps - 0.4
    assert loop.speeds[-1] < most_mps - 0.1


def test_what_the_machine_can_do_is_no_end_for_good():
    """A load takes what is left at the greatest current; once it is gone, the machine goes where it was asked to."""
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.2, 10.0)
    loop.machine.load_mps = -1.5
    loop.engaged(2.2, 20.0)
    assert loop.commands[-1].limit_status is LimitStatus.LIMITED_HIGH
    loop.machine.load_mps = 0.0
    loop.engaged(2.2, 10.0)
    assert loop.speeds[-1] == pytest.approx(2.2, abs=0.03)


@pytest.mark.parametrize("effects", [(Saturation(900.0),), (Hysteresis(40.0),), ()], ids=["stop", "band", "range"])
def test_it_says_that_the_machine_can_go_no_faster_or_slower(effects):
    """A stop below the greatest current, a band that ends before it: the current never gets to its own end."""
    loop = Loop(Machine(), replace(MODEL, effects=(*effects, *EFFECTS))).by_hand(700.0, 20.0).engaged(1.2, 10.0)
    assert loop.commands[-1].limit_status is LimitStatus.NOT_LIMITED
    loop.engaged(4.5, 15.0)
    assert loop.commands[-1].limit_status is LimitStatus.LIMITED_HIGH
    loop.engaged(1.2, 15.0)
    assert loop.commands[-1].limit_status is LimitStatus.NOT_LIMITED
    loop.machine.load_mps = 0.8
    loop.engaged(0.5, 15.0)
    assert loop.commands[-1].limit_status is LimitStatus.LIMITED_LOW


@pytest.mark.parametrize("band_ma", [0.0, 40.0])
def test_a_machine_that_is_too_fast_without_any_drive_is_asked_for_none(band_ma):
    """Downhill: each current of the dead zone would do by the model; the lowest does in every machine."""
    effects = (Hysteresis(band_ma), *EFFECTS) if band_ma else EFFECTS
    loop = Loop(Machine(band_ma=band_ma), replace(MODEL, effects=effects)).by_hand(700.0, 20.0).engaged(1.0, 5.0)
    loop.machine.load_mps = 0.8
    loop.engaged(0.5, 20.0)
    assert loop.currents[-100:].max() < 1e-6
    loop.machine.load_mps = 0.03
    loop.engaged(0.5, 20.0)
    assert loop.speeds[-1] == pytest.approx(0.5, abs=0.01)


def test_a_reference_that_gives_way_to_an_overloaded_engine_is_not_the_operators():
    loop = Loop(Machine()).by_hand(700.0, 10.0).engaged(1.2, 5.0)
    assert loop.controller.asked_mps == loop.controller.reference.speed_mps
    step = loop.machine.step
    loop.machine.step = lambda current_ma: replace(
        sample := step(current_ma), signals={**sample.signals, "engine_load_pct": 100.0}
    )
    for rpm in np.linspace(2100.0, 1700.0, 40):
        loop.machine.rpm = float(rpm)
        loop.engaged(1.2, FRAME_S)
    assert loop.controller.reference.speed_mps < 1.1
    assert math.isnan(loop.controller.asked_mps)
