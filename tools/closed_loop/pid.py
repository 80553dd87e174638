"""The baseline: a PID by the SIMC rules on the same model, with its inverse characteristic, limits and reference.

    K_c = tau_1 / (tau_c + theta),   tau_I = min(tau_1, 4 (tau_c + theta)),   tau_D = tau_2,   tau_c = theta
    s = r + tau dr/dt + K_c [ e + z - tau_D dy_f/dt ],   dz/dt = e / tau_I,   e = r(t - theta) - y

s drive in m/s of steady speed (so that the gain is 1), r the feasible reference in m/s, y measured speed, theta delay,
tau_1 >= tau_2 the two time constants of the model in s and tau their sum, y_f the speed through a lag of tau_D / 10 and
one frame. The reference is fed forward through the inverse of the lags and compared once it can have arrived. The
integrator stops while the current is limited. A PID that is held to the 1 Hz of the law sends its current through the
law's shaper: its lags count in tau, and by the half rule in tau_2 and theta. Source: S. Skogestad, "Simple analytic
rules for model reduction and PID controller tuning", J. Process Control 13 (2003), with the series form's derivative on
the measured speed.
"""

import math
from collections import deque

import msgspec

from cruise.control.controller import ControlSettings
from cruise.control.frame_model import core_of
from cruise.control.inversion import Inversion
from cruise.control.limits import Limits
from cruise.control.reference import Reference
from cruise.control.shaping import CommandShaper
from cruise.model.model import Model, ModelState
from cruise.signals import Sample


class Pid:
    """SIMC-PID, scheduled by the gear as the model is."""

    def __init__(self, model: Model, settings: ControlSettings, held: bool = False) -> None:
        """`held` to the 1 Hz of the law."""
        self.model, self.dt_s = model, settings.frame_s
        order = settings.shaping_order if held else 0
        self.shaper = CommandShaper(settings.shaping_hz, order, self.dt_s)
        self.shaping_s = [1.0 / (2.0 * math.pi * settings.shaping_hz)] * order
        core = core_of(model, self.dt_s)
        self.core = core
        self.limits = Limits(settings.limits)
        at_once = msgspec.structs.replace(settings.inversion, lasting_s=math.inf)  # what lasts is its own integrator's
        self.inversion = Inversion(at_once, self.dt_s)
        self.reference = Reference(settings.reference)
        self.past: deque[float] = deque(maxlen=max(round(core.delay_s / self.dt_s), 1) + 1)
        self.state: ModelState | None = None
        self.integral_mps, self.slow_mps, self.engaged, self.wanted_ma = 0.0, math.nan, False, 0.0

    def step(self, sample: Sample, setpoint_mps: float | None) -> float:
        """The current in mA after one frame; `setpoint_mps` None while a person drives."""
        model, signals = self.model, sample.signals
        if self.state is None:
            self.state = model.start(sample.speed_mps, sample.current_ma, signals)
        self.state = model.advance(self.state, sample.current_ma, sample.speed_mps, signals)
        response = model.linearise(self.state, signals)
        pole = 1.0 - self.state.pace * (1.0 - self.core.pole(self.dt_s))  # equation 12
        vehicle_s = -self.dt_s / math.log(min(max(pole, 1e-9), 0.9999))
        pace = response.speed_coefficients[0]
        tau_1, tau_2, *more_s = sorted((vehicle_s, self.core.lag_s, *self.shaping_s), reverse=True)
        lags_s = tau_1 + tau_2 + sum(more_s)
        tau_2 += 0.5 * sum(more_s[:1])
        theta = self.core.delay_s + sum(more_s) - 0.5 * sum(more_s[:1])
        gain = tau_1 / (2.0 * theta)
        integral_s = min(tau_1, 8.0 * theta)
        speed_mps = sample.speed_mps
        if math.isnan(self.slow_mps):
            self.slow_mps = speed_mps
        rate_mps2 = (speed_mps - self.slow_mps) / (0.1 * tau_2 + self.dt_s)
        self.slow_mps += self.dt_s * rate_mps2
        if setpoint_mps is None:
            self.engaged = False
            return 0.0
        if not self.engaged:
            self._take_over(sample, response.dc_gain, response.offset_mps / (1.0 - pace))
        reference_mps = self.reference.step(setpoint_mps, self.dt_s)
        self.past.append(reference_mps)
        error_mps = self.past[0] - speed_mps
        steady_mps = reference_mps + lags_s * self.reference.accel_mps2
        steady_mps += gain * (error_mps - tau_2 * rate_mps2) + self.integral_mps
        drive_ma = (steady_mps - response.offset_mps / (1.0 - pace)) / response.dc_gain if response.dc_gain else 0.0
        inverse = self.inversion.step(model, drive_ma, self.state, signals)
        shaped_ma = self.shaper.step(inverse.nearest(self.limits.last_ma))
        current_ma = self.limits.step(shaped_ma, self.dt_s)
        if current_ma != shaped_ma:
            self.shaper.reset(current_ma)
        else:
            self.integral_mps += gain * self.dt_s / integral_s * error_mps
        return current_ma

    def _take_over(self, sample: Sample, dc_gain: float, offset_mps: float) -> None:
        assert self.state is not None
        self.engaged = True
        self.limits.take_over(sample.current_ma)
        self.shaper.reset(self.limits.last_ma)
        self.reference.reset(sample.speed_mps)
        self.past.extend([sample.speed_mps] * (self.past.maxlen or 1))
        drive_ma = self.model.drive_for(sample.current_ma, self.state, sample.signals)
        self.integral_mps = dc_gain * drive_ma + offset_mps - sample.speed_mps
