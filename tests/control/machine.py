"""A machine as a difference equation of its own, in frames, and the controller that drives it."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from cruise.control.controller import NEUTRAL, Command, Controller, ControlSettings
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model
from cruise.signals import Sample

PERIOD_S, FRAME_S = 0.2, 0.05  # of the model, of the machine

EFFECTS = (DeadZone(400.0), QuadraticGain(0.5), EngineSpeed(1.0), GearRatio(1.4, 2.5, 4.4, 7.5))

MODEL = Model(PERIOD_S, 1, 3, 2, EFFECTS, (0.4, 2e-4, 8e-4, 8e-4, 0.02))

RATIO = {1: 1.4 / 2.5, 2: 1.0, 3: 4.4 / 2.5, 4: 7.5 / 2.5}


@dataclass
class Machine:
    """y_k = A y_(k-1) + (1 - A) (g K v_(k-d) + w),   A = a^(alpha / 4 l), a pole over 0.2 s.

    v = x + 0.5e-3 x^2, x = max(u - 400, 0); as the model: delay and pole give its mean delay of 0.8 s.
    """

    gain: float = 1.8e-3 / 0.6
    pole: float = 0.4
    delay: int = 12  # frames of 0.05 s
    load_mps: float = 0.03
    rpm: float = 2100.0
    gear: int = 2
    band_ma: float = 0.0
    stroke_share: float = 0.0  # of its time constant that is in proportion to the stroke, as it is at 1.5 m/s
    frame_s: float = FRAME_S

    def __post_init__(self) -> None:
        delay = round(self.delay * FRAME_S / self.frame_s)
        self.past: deque[float] = deque([0.0] * (delay + 1), maxlen=delay + 1)
        self.speed_mps, self.time_s, self.acts_ma = 0.0, 0.0, 0.0

    def step(self, current_ma: float) -> Sample:
        """One frame on, at a current."""
        self.acts_ma = min(max(self.acts_ma, current_ma - 0.5 * self.band_ma), current_ma + 0.5 * self.band_ma)
        beyond = max(self.acts_ma - 400.0, 0.0)
        self.past.append(beyond + 0.5e-3 * beyond**2)
        ratio = RATIO[self.gear]
        slower = 1.0 - self.stroke_share + self.stroke_share * self.gain * self.past[0] / 1.5
        pole = self.pole ** (min(1.0, ratio**-2) * self.frame_s / PERIOD_S / slower)
        steady_mps = self.gain * self.past[0] * ratio * self.rpm / 2100.0 + self.load_mps
        self.speed_mps = pole * self.speed_mps + (1.0 - pole) * steady_mps
        self.time_s += self.frame_s
        signals = {"engine_speed_rpm": self.rpm, "gear": float(self.gear)}
        return Sample(self.time_s, current_ma, self.speed_mps, signals)


class Loop:
    """Machine and controller, a frame at a time; `commands` and `speeds` are those of every frame."""

    def __init__(self, machine: Machine, model: Model = MODEL, settings: ControlSettings | None = None) -> None:
        self.machine = machine
        self.controller = Controller(model, settings or ControlSettings())
        self.machine.frame_s = self.controller.frame_s
        self.machine.__post_init__()
        self.commands: list[Command] = []
        self.speeds: list[float] = []

    def by_hand(self, current_ma: float, seconds: float) -> "Loop":
        for _ in range(round(seconds / self.machine.frame_s)):
            self.sample = self.machine.step(current_ma)
            assert self.controller.step(self.sample, None) == NEUTRAL
        return self

    def engaged(self, setpoint_mps: float, seconds: float) -> "Loop":
        for _ in range(round(seconds / self.machine.frame_s)):
            self.commands.append(self.controller.step(self.sample, setpoint_mps))
            self.sample = self.machine.step(self.commands[-1].current_ma)
            self.speeds.append(self.machine.speed_mps)
        return self

    @property
    def currents(self) -> np.ndarray:
        return np.array([command.current_ma for command in self.commands])


BAND_MA = 40.0


def believed(band_ma: float = BAND_MA, threshold_ma: float = 400.0, curvature: float = 0.5) -> Model:
    """A model that gives the machine's speed at 800 mA, with a characteristic of its own."""
    a, *b, c_0 = MODEL.theta
    beyond = 800.0 - threshold_ma
    scale = 480.0 / (beyond * (1.0 + curvature * beyond / 1000.0))
    effects = (Hysteresis(band_ma), DeadZone(threshold_ma), QuadraticGain(curvature), *EFFECTS[2:])
    return replace(MODEL, effects=effects, theta=(a, *(scale * value for value in b), c_0))
