"""The variable pump: spool, hydraulic half bridge, swash servo and mechanical stop.

    opening    r = s w ln(1 + exp((|u| - u_0) / w)) / (u_1 - u_0)            spool past its overlap, smooth edge
    bridge     b = (r^2 / (1 + r^2)) / (s^2 / (1 + s^2))                    pressure divider of two orifices
    target     x_t = sign(u) b (1 - k p sign(u)), held by the stop |x_t| <= 1 and, pumping, by p x_t D n <= P
    servo      dx/dt = e / sqrt(tau^2 + (e / R)^2),    e = x_t - x

u effective current [mA], u_0 threshold [mA], u_1 current of full stroke [mA], w width of the overlap's edge [mA],
s opening of the variable orifice at full stroke relative to the fixed one [-], x swash (displacement relative to the
greatest) [-], p line pressure [Pa], k load sensitivity [1/Pa]: the pump has no mechanical feedback, the pressure's
moment on the swash plate takes displacement away while pumping and adds some while motoring; tau small-signal lag [s],
R greatest rate [1/s] that the control flow allows, Q = D n x flow [m3/s], P power that the control lets the pump take
[W].

Source: M. Jelali, A. Kroll, Hydraulic Servo-systems (2003), ch. 4 (half bridges, displacement control); data sheets of
axial piston pumps with non-feedback proportional electric control, 12 V, 400..1200 mA; the paper, section IV.C and
figure 4 (dead zones at small and large currents, quadratic in between).
"""

from math import copysign, exp, log1p, pi, sqrt
from typing import Annotated

from msgspec import Meta, Struct

from cruise.plant.bounds import NotNegative, Positive, Share


class PumpSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Displacement, static characteristic and servo."""

    displacement_cm3: Positive = 105.0  # per revolution; pumps of combines of this class: 75..130
    speed_ratio: Positive = 1.25  # pump shaft over crankshaft: 1.0..1.4
    threshold_ma: NotNegative = 375.0  # end of the overlap; 12 V class: 350..450
    threshold_edge_ma: NotNegative = 14.0  # width over which the overlap opens: 5..40
    full_stroke_ma: Positive = 1150.0  # current that reaches the stop without load: 1050..1250
    bridge_opening: Positive = 0.85  # s; below 0.5 nearly a parabola, above 2 flattening: 0.5..2
    bridge_share: Share = 1.0  # 1 meters through the half bridge, 0 a linear pressure-reducing valve
    stop: Positive = 1.0  # greatest swash angle, relative
    power_kw: Positive = 300.0  # power control: 20..150; 300 is more than relief pressure times full flow, so none
    load_sensitivity_per_bar: NotNegative = 8e-4  # no mechanical feedback: 5..25 % less stroke at 250 bar: 2e-4..1e-3
    servo_lag_s: NotNegative = 0.12  # small strokes; control orifices of propel pumps: 0.08..0.4
    stroke_rate_per_s: Positive = 1.5  # neutral to full in 0.7 s; with orifices 0.4..3 s, so 0.3..2.5
    return_rate_per_s: Positive = 2.1  # the centring springs help: 0.4..4
    # Electronics, overlap and filling of the servo: 0.1..0.6; 0.47 puts the paper's correlation peak at 0.75 s.
    transport_delay_s: Annotated[float, Meta(ge=0, le=2)] = 0.47


def displacement_m3_per_rad(settings: PumpSettings) -> float:
    """Greatest displacement D [m3/rad]."""
    return settings.displacement_cm3 * 1e-6 / (2.0 * pi)


def stroke(settings: PumpSettings, effective_ma: float) -> float:
    """Static swash [-] of the unloaded pump without its stop, for an effective current [mA]."""
    edge_ma = settings.threshold_edge_ma
    past_ma = abs(effective_ma) - settings.threshold_ma
    if edge_ma > 0.0 and past_ma < 30.0 * edge_ma:  # beyond 30 widths the edge changes nothing in double precision
        past_ma = edge_ma * log1p(exp(past_ma / edge_ma))
    elif past_ma < 0.0:
        return 0.0
    opening = past_ma / (settings.full_stroke_ma - settings.threshold_ma)
    ratio_full = settings.bridge_opening**2
    ratio = ratio_full * opening * opening
    bridge = ratio / (1.0 + ratio) * (1.0 + ratio_full) / ratio_full
    share = settings.bridge_share
    return copysign(share * bridge + (1.0 - share) * opening, effective_ma)


def target(settings: PumpSettings, effective_ma: float, pressure_pa: float, full_flow_m3ps: float) -> float:
    """Swash [-] at which the servo comes to rest under a line pressure [Pa], for the flow [m3/s] of full swash."""
    unloaded = stroke(settings, effective_ma)
    loaded = unloaded * (1.0 - settings.load_sensitivity_per_bar * 1e-5 * copysign(pressure_pa, pressure_pa * unloaded))
    full_power_w = copysign(pressure_pa, pressure_pa * loaded) * full_flow_m3ps
    stop = settings.stop
    if full_power_w > 0.0:
        stop = min(stop, 1e3 * settings.power_kw / full_power_w)
    return min(max(loaded, -stop), stop)


def advance(settings: PumpSettings, swash: float, target_swash: float, step_s: float) -> float:
    """Swash [-] a time `step_s` later towards a held target: exponential midpoint rule, which never overshoots."""
    error = target_swash - swash
    if error == 0.0:
        return swash
    returning = swash * error < 0.0
    rate_per_s = settings.return_rate_per_s if returning else settings.stroke_rate_per_s
    lag_s = settings.servo_lag_s
    halfway = error * _decay(error, lag_s, rate_per_s, 0.5 * step_s)
    return target_swash - error * _decay(halfway, lag_s, rate_per_s, step_s)


def _decay(error: float, lag_s: float, rate_per_s: float, step_s: float) -> float:
    """Factor by which the error shrinks within `step_s` at the time constant that it has now."""
    slowness_s = error / rate_per_s
    time_constant_s = sqrt(lag_s * lag_s + slowness_s * slowness_s)
    return exp(-step_s / time_constant_s) if time_constant_s > 0.0 else 0.0
