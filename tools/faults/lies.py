"""Sensors and panels that say what is not so: values that are wrong before the sender protects its message."""

import math
from collections.abc import Callable
from random import Random

from cruise.signals import SIGNALS

from .bed import Fault

Change = Callable[[float, float], float]
"""A value and the time since the fault came in s, to what is said instead."""

SPEED = {"DriveFeedback": ("ground_speed_mps",)}
ALL_SPEEDS = {"DriveFeedback": ("ground_speed_mps",), "WBSD": ("wheel_speed_mps",), "GBSD": ("ground_speed_mps",)}
OTHER_SPEEDS = {"WBSD": ("wheel_speed_mps",), "GBSD": ("ground_speed_mps",)}
CURRENT = {"DriveFeedback": ("pump_current_ma",)}
ENGINE = {"EEC1": ("engine_speed_rpm",)}
GEAR = {"ETC2": ("gear",)}
PITCH = {"SSI2": ("pitch_deg",)}
LEVER = {"MachineState": ("lever_pct",)}
PEDALS = {"CCVS": ("brake_pedal", "clutch_pedal")}
SETPOINT = {"MachineSelectedSpeedCommand": ("setpoint_mps",)}
Where = dict[str, tuple[str, ...]]


class Lie(Fault):
    """Signals of some messages, changed in one way."""

    def __init__(self, where: Where, change: Change) -> None:
        self.where, self.change = where, change
        self.since_s = math.nan

    def said(self, message: str, values: dict[str, float], now_s: float) -> dict[str, float]:
        """The message with the lie in it, within what the signal can be."""
        if math.isnan(self.since_s):
            self.since_s = now_s
        for name in self.where.get(message, ()):
            value = self.change(values[name], now_s - self.since_s)
            signal = SIGNALS[name]
            values[name] = min(max(value, signal.low), signal.high) if math.isfinite(value) else math.nan
        return values


class Frozen(Fault):
    """Signals that stay as they were when the fault came; the message goes on."""

    def __init__(self, where: Where) -> None:
        self.where = where
        self.kept: dict[str, float] = {}

    def said(self, message: str, values: dict[str, float], now_s: float) -> dict[str, float]:
        """The message with old values in it."""
        for name in self.where.get(message, ()):
            values[name] = self.kept.setdefault(message + name, values[name])
        return values


def biased(where: Where, rng: Random, low: float, high: float) -> Lie:
    """By so much, to either side."""
    by = rng.choice((-1.0, 1.0)) * rng.uniform(low, high)
    return Lie(where, lambda value, since_s: value + by)


def scaled(where: Where, rng: Random, low: float, high: float) -> Lie:
    """Times so much, or divided by it."""
    by = rng.uniform(low, high) ** rng.choice((-1, 1))
    return Lie(where, lambda value, since_s: value * by)


def drifting(where: Where, rng: Random, low: float, high: float) -> Lie:
    """By so much a second, to either side."""
    rate = rng.choice((-1.0, 1.0)) * rng.uniform(low, high)
    return Lie(where, lambda value, since_s: value + rate * since_s)


def noisy(where: Where, rng: Random, low: float, high: float) -> Lie:
    """With noise of such a standard deviation."""
    std, noise = rng.uniform(low, high), Random(rng.random())
    return Lie(where, lambda value, since_s: value + noise.gauss(0.0, std))


def spiked(where: Where, rng: Random, low: float, high: float) -> Lie:
    """One reading in twenty is off by so much."""
    by, dice = rng.uniform(low, high), Random(rng.random())
    return Lie(where, lambda value, since_s: value + (dice.choice((-by, by)) if dice.random() < 0.05 else 0.0))


def constant(where: Where, value: float) -> Lie:
    """One value, whatever is true."""
    return Lie(where, lambda true, since_s: value)
