"""The diesel: full-load curve, governor, torque lag and the inertia of everything that turns with it.

    J dw/dt  = T - T_load
    tau dT/dt = limit(K_p (w_r - w) + I, -T_drag(w), T_full(w)) - T,    dI/dt = K_i (w_r - w) within the limits
    w_r      = w_set (1 - delta T / T_rated)

w crankshaft speed [rad/s], T torque at the flywheel [N m], T_full full-load torque [N m], T_drag drag of the unfuelled
engine [N m], w_set governor's set speed [rad/s], delta droop between no and full load [-] (0: isochronous), J inertia
[kg m2]. Below zero torque the engine brakes: then the pump drives it.

Source: L. Guzzella, C. Onder, Introduction to Modeling and Control of Internal Combustion Engine Systems, ch. 2; curves
of 9 l class, 250 kW harvester engines with about 25 % torque rise; the paper, section V.A (1300 to 2100 rpm).
"""

from bisect import bisect_right
from math import exp, pi
from typing import NamedTuple

from msgspec import Struct

from cruise.plant.bounds import NotNegative, Positive

RADPS_PER_RPM = pi / 30.0


class EngineSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Full-load curve and governor."""

    curve_speed_rpm: tuple[float, ...] = (0.0, 800.0, 1000.0, 1300.0, 1500.0, 1700.0, 1900.0, 2100.0, 2300.0)
    curve_torque_nm: tuple[float, ...] = (300.0, 800.0, 1100.0, 1340.0, 1400.0, 1370.0, 1280.0, 1140.0, 900.0)  # +-25 %
    torque_scale: Positive = 1.0  # 0.7..1.3 makes a smaller or greater engine
    rated_speed_rpm: Positive = 2100.0  # the paper's maximum
    rated_torque_nm: Positive = 1140.0  # 250 kW at rated speed; the torque to which the droop refers
    inertia_kgm2: Positive = 12.0  # engine 3..5 and the threshing drums seen through their belts: 6..30
    droop_share: NotNegative = 0.03  # electronic governors 0..0.05, mechanical ones up to 0.08
    governor_gain_nm_per_radps: NotNegative = 65.0  # natural frequency of 3 rad/s, well damped: 30..150
    governor_integral_nm_per_rad: NotNegative = 108.0  # 0..300
    torque_lag_s: Positive = 0.08  # injection and turbocharger at part load: 0.05..0.4
    drag_torque_nm: NotNegative = 180.0  # unfuelled at rated speed, 12..18 % of the rated torque
    accessories_power_kw: NotNegative = 12.0  # idling threshing unit, fan and charge pump at rated speed: 5..60


class EngineStep(NamedTuple):
    """State and load of the engine after a step."""

    speed_radps: float
    torque_nm: float
    governor_nm: float
    load_pct: float


def full_load_torque_nm(settings: EngineSettings, speed_radps: float) -> float:
    """Torque [N m] that the engine can give at a speed [rad/s]: the curve, linear between its points, held outside."""
    rpm = speed_radps / RADPS_PER_RPM
    speeds, torques = settings.curve_speed_rpm, settings.curve_torque_nm
    after = bisect_right(speeds, rpm)
    if after == 0 or after == len(speeds):
        return settings.torque_scale * torques[max(after - 1, 0)]
    low, high = speeds[after - 1], speeds[after]
    share = (rpm - low) / (high - low)
    return settings.torque_scale * (torques[after - 1] + share * (torques[after] - torques[after - 1]))


def drag_torque_nm(settings: EngineSettings, speed_radps: float) -> float:
    """Drag [N m] of the unfuelled engine: half of it dry friction, half proportional to the speed."""
    return settings.drag_torque_nm * 0.5 * (1.0 + speed_radps / (settings.rated_speed_rpm * RADPS_PER_RPM))


def machine_torque_nm(settings: EngineSettings, crop_power_kw: float, speed_radps: float) -> float:
    """Torque [N m] of accessories and crop, whose power is stated at rated speed; dry, so constant over the speed."""
    rated_radps = settings.rated_speed_rpm * RADPS_PER_RPM
    torque_nm = 1e3 * (settings.accessories_power_kw + crop_power_kw) / rated_radps
    return torque_nm * min(1.0, speed_radps / (0.05 * rated_radps))  # a stopped shaft takes no torque


def advance(
    settings: EngineSettings,
    speed_radps: float,
    torque_nm: float,
    governor_nm: float,
    setpoint_rpm: float,
    load_nm: float,
    step_s: float,
) -> EngineStep:
    """The engine a time `step_s` later under a held load torque [N m] at the crankshaft."""
    full_nm = full_load_torque_nm(settings, speed_radps)
    droop = settings.droop_share * max(torque_nm, 0.0) / settings.rated_torque_nm
    error_radps = setpoint_rpm * RADPS_PER_RPM * (1.0 - droop) - speed_radps
    proportional_nm = settings.governor_gain_nm_per_radps * error_radps
    drag_nm = drag_torque_nm(settings, speed_radps)
    governor_nm += step_s * settings.governor_integral_nm_per_rad * error_radps
    # The integral stops where the fuel rack does, so that the governor comes off its limit without a delay.
    governor_nm = min(max(governor_nm, -drag_nm), full_nm)
    demand_nm = min(max(proportional_nm + governor_nm, -drag_nm), full_nm)
    reached_nm = demand_nm + (torque_nm - demand_nm) * exp(-step_s / settings.torque_lag_s)
    mean_nm = 0.5 * (torque_nm + reached_nm)
    speed_radps = max(speed_radps + step_s * (mean_nm - load_nm) / settings.inertia_kgm2, 0.0)
    return EngineStep(speed_radps, reached_nm, governor_nm, 100.0 * max(reached_nm, 0.0) / full_nm)
