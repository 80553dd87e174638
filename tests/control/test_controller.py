"""The controller against machines that differ from its model, each a difference equation written here."""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
import pytest

from cruise.control.controller import NEUTRAL, Command, Controller, ControlSettings
from cruise.control.limits import LimitSettings
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model
from cruise.signals import Sample

PERIOD_S = 0.2
EFFECTS = (DeadZone(400.0), QuadraticGain(0.5), EngineSpeed(1.0), GearRatio(1.4, 2.5, 4.4, 7.5))
MODEL = Model(PERIOD_S, 1, 3, 2, EFFECTS, (0.4, 2e-4, 8e-4, 8e-4, 0.02))
RATIO = {1: 1.4 / 2.5, 2: 1.0, 3: 4.4 / 2.5, 4: 7.5 / 2.5}


@dataclass
class Machine:
    """y_k = alpha (a y_(k-1) + g K (1 - a) v_(k-d) + w) + (1 - alpha) y_(k-1).

    v = x + 0.5e-3 x^2, x = max(u - 400, 0).
    """

    gain: float = 1.8e-3 / 0.6
    pole: float = 0.4
    delay: int = 3
    load_mps: float = 0.02
    rpm: float = 2100.0
    gear: int = 2

    def __post_init__(self) -> None:
        self.past: deque[float] = deque([0.0] * (self.delay + 1), maxlen=self.delay + 1)
        self.speed_mps = 0.0
        self.time_s = 0.0

    def step(self, current_ma: float) -> Sample:
        """One model period on, at a mean current."""
        beyond = max(current_ma - 400.0, 0.0)
        self.past.append(beyond + 0.5e-3 * beyond**2)
        ratio = RATIO[self.gear]
        alpha = min(1.0, ratio**-2)
        drive = self.gain * (1.0 - self.pole) * self.past[0] * ratio * self.rpm / 2100.0
        target = self.pole * self.speed_mps + drive + self.load_mps
        self.speed_mps = alpha * target + (1.0 - alpha) * self.speed_mps
        self.time_s += PERIOD_S
        signals = {"engine_speed_rpm": self.rpm, "gear": float(self.gear)}
        return Sample(self.time_s, current_ma, self.speed_mps, signals)


class Loop:
    """Machine and controller: four frames a sample; `commands` are those of every frame."""

    def __init__(self, machine: Machine, model: Model = MODEL, settings: ControlSettings | None = None) -> None:
        self.machine = machine
        self.controller = Controller(model, settings or ControlSettings())
        self.commands: list[Command] = []
        self.speeds: list[float] = []

    def by_hand(self, current_ma: float, seconds: float) -> "Loop":
        for _ in range(round(seconds / PERIOD_S)):
            sample = self.machine.step(current_ma)
            for i in range(self.controller.frames):
                assert self.controller.step(sample if i == 0 else None, None) == NEUTRAL
        self.sample = self.machine.step(current_ma)
        return self

    def engaged(self, setpoint_mps: float, seconds: float) -> "Loop":
        for _ in range(round(seconds / PERIOD_S)):
            count = self.controller.frames
            now = [self.controller.step(self.sample if i == 0 else None, setpoint_mps) for i in range(count)]
            self.commands += now
            self.sample = self.machine.step(float(np.mean([command.current_ma for command in now])))
            self.speeds.append(self.machine.speed_mps)
        return self

    @property
    def currents(self) -> np.ndarray:
        return np.array([command.current_ma for command in self.commands])


def test_it_is_neutral_until_it_is_engaged_and_again_after():
    loop = Loop(Machine()).by_hand(700.0, 10.0).engaged(1.3, 5.0)
    assert loop.currents.min() > 600.0
    for _ in range(3):
        assert loop.controller.step(None, None) == NEUTRAL
    assert loop.controller.limits.last_ma == 0.0


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
    assert abs(np.array(loop.speeds[-20:]) - present_mps).max() < 0.02


MACHINES = {
    "as the model": Machine(),
    "a third weaker": Machine(gain=2e-3),
    "a third stronger": Machine(gain=4e-3),
    "slower": Machine(pole=0.65),
    "more delay": Machine(delay=4),
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
    assert np.ptp(loop.speeds[-25:]) < 0.002
    assert max(loop.speeds) - top_mps < 0.12 * (top_mps - start_mps)
    down = len(loop.speeds)
    loop.engaged(start_mps, 25.0)
    assert loop.speeds[-1] == pytest.approx(start_mps, abs=0.002)
    assert start_mps - min(loop.speeds[down:]) < 0.12 * (top_mps - start_mps)


def test_a_step_of_load_is_taken_up():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.3, 20.0)
    loop.machine.load_mps -= 0.1
    loop.engaged(1.3, 20.0)
    assert 1.05 < min(loop.speeds[-100:]) < 1.27
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.002)


def test_adopting_another_model_makes_no_jump():
    loop = Loop(Machine(gain=2.5e-3)).by_hand(700.0, 20.0).engaged(1.2, 20.0)
    a, *b, c = MODEL.theta
    loop.controller.adopt(MODEL.with_theta((a + 0.1, *(0.7 * value for value in b), c - 0.05)))
    settled_ma = loop.currents[-1]
    loop.engaged(1.2, 15.0)
    assert abs(loop.currents[-300:] - settled_ma).max() < 0.1  # 0.9 if the observer isn't told
    assert abs(np.array(loop.speeds[-75:]) - 1.2).max() < 5e-4


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
    commands = [loop.controller.step(broken if i == 0 else None, 1.3) for i in range(4)]
    assert {command.current_ma for command in commands} == {0.0}
    assert {command.limited for command in commands} == {"no measurement"}
    # Once it can see again it begins from the measured current, not from what it wanted before.
    again = replace(loop.sample, current_ma=500.0)
    assert loop.controller.step(again, 1.3).current_ma == pytest.approx(500.0, abs=30.0)


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
    assert abs(np.diff(loop.speeds)).max() / PERIOD_S < 1.0


def test_the_command_has_next_to_nothing_above_1_hz():
    loop = Loop(Machine()).by_hand(700.0, 20.0).engaged(1.0, 20.0).engaged(1.5, 20.0)
    spectrum = np.fft.rfft((loop.currents - loop.currents.mean()) * np.hanning(len(loop.currents)))
    frequency_hz = np.fft.rfftfreq(len(loop.currents), 0.05)
    power = np.abs(spectrum) ** 2
    assert power[frequency_hz > 1.0].sum() < 1e-4 * power.sum()


@pytest.mark.parametrize("frame_s", [0.03, 0.15, 0.4])
def test_frames_that_do_not_fit_into_a_period_are_refused(frame_s):
    with pytest.raises(ValueError, match="must be a multiple"):
        Controller(MODEL, ControlSettings(frame_s=frame_s))


@pytest.mark.parametrize("frame_s", [0.2, 0.1, 0.02, 0.01])
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
    "delay and nothing else": Machine(delay=3, pole=0.0),
    "delay of the whole horizon": Machine(delay=15),
    "second order": Machine(delay=3),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_at_the_edges_drive_too(name):
    machine = replace(MATCHING[name])
    loop = Loop(machine, STRUCTURES[name]).by_hand(700.0, 20.0).engaged(1.3, 50.0)
    assert loop.speeds[-1] == pytest.approx(1.3, abs=0.01)
