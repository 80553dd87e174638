"""The proportional solenoid of the pump: a coil behind a current regulator that can give no more than the battery.

    L di/dt = V - R i,    V = limit(R i_command + k (i_command - i), +-V_battery),    k = L / tau - R

i coil current [A], L inductance [H], R resistance [ohm], V mean voltage of the pulse-width modulation [V], tau time
constant of the regulated current [s]. The forward and the reverse coil are one signed current: one is fed at a time.

Source: D. Schroeder, Electrical Drives - Control, ch. 5 (current regulation of an L-R load); coil data of the
12 V class of electric displacement controls.
"""

from math import copysign, exp
from typing import NamedTuple

from msgspec import Struct

from cruise.plant.bounds import NotNegative, Positive


class SolenoidSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Coil and current regulator."""

    resistance_ohm: Positive = 3.7  # 12 V coil at 20 degC, 1.2 A class: data sheets give 3.6..5.3; warm up to +40 %
    inductance_h: Positive = 0.033  # same class: 0.02..0.06
    battery_v: Positive = 13.5  # charging 12 V system: 11..14.5
    regulated_lag_s: NotNegative = 0.012  # digital current regulators: 0.005..0.03
    maximum_current_ma: Positive = 1300.0  # output stage's current limit: 1200..1800


class CoilStep(NamedTuple):
    """Coil current at the end of a step and its mean over it."""

    current_ma: float
    mean_ma: float


def advance(settings: SolenoidSettings, current_ma: float, command_ma: float, step_s: float) -> CoilStep:
    """The coil a time `step_s` later while `command_ma` is held: exact while the voltage limit stays constant."""
    limit_ma = settings.maximum_current_ma
    target_ma = min(max(command_ma, -limit_ma), limit_ma)
    lag_s = settings.regulated_lag_s
    if lag_s == 0.0:
        return CoilStep(target_ma, target_ma)
    resistance, inductance = settings.resistance_ohm, settings.inductance_h
    error_ma = current_ma - target_ma
    volts = 1e-3 * (resistance * current_ma - inductance / lag_s * error_ma)
    if abs(volts) <= settings.battery_v:
        left = exp(-step_s / lag_s)
        return CoilStep(target_ma + error_ma * left, target_ma + error_ma * (1.0 - left) * lag_s / step_s)
    settled_ma = copysign(1e3 * settings.battery_v / resistance, volts)
    reached_ma = settled_ma + (current_ma - settled_ma) * exp(-step_s * resistance / inductance)
    # Within a step the voltage limit is left again once the target is passed: the regulator holds the target there.
    reached_ma = min(reached_ma, target_ma) if error_ma < 0.0 else max(reached_ma, target_ma)
    return CoilStep(reached_ma, 0.5 * (current_ma + reached_ma))
