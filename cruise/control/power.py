"""Engine and drive at their limits: rather slower than stalled.

    c_(k+1) = c_k - a T   while load > HIGH and n < s n_0, from the present speed on;   + b T   while load < LOW
    r' = min(r n / (s' n_0), c)   from load > HIGH until load < LOW

r setpoint, r' the one that is driven, c highest setpoint in m/s, a and b rates in m/s2, T frame in s, load the engine's
own figure in percent of the torque available at its speed, through a lag that begins near LOW (one that begins at idle
needs seconds to come near HIGH), n engine speed, n_0 the one that it had before it was loaded, which follows n
downwards no faster than an operator throttles back, s and s' shares. An engine that lugs a little gains torque and
carries on, and its drive slows down with it: one that made up for it would be too fast as soon as the load goes. One
that keeps losing speed stalls, and the feed-forward of the engine speed would answer with more stroke, which takes more
torque still: the setpoint gives way before that. A line whose relief valve opens gives no more force whatever the
stroke: the setpoint is then the present speed. Where neither load nor pressure is measured nothing is done here.
Source: the anti-stall (load limiting) control of hydrostatic drives.
"""

import math
from typing import Final

import msgspec

from cruise.settings import Positive

NEAR_PCT: Final = 2.0  # %, below LOW: where the lag of the load begins


class PowerSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When the setpoint gives way, and how fast."""

    high_pct: Positive = 98.0  # %, of the torque that the engine has; on the bus it comes in whole percent
    low_pct: Positive = 95.0
    sag_share: Positive = 0.92  # of the engine speed before the load came: torque rises by as much on the way there
    down_mps2: Positive = 0.4  # m/s2, below what the reference may do
    up_mps2: Positive = 0.05  # m/s2, slowly back: the load rises with the speed
    lag_s: Positive = 0.3  # s, a gust of crop is no overload
    carried_share: Positive = 0.97  # of that engine speed: below, the drive slows down in proportion
    light_pct: Positive = 60.0  # %, an engine that has less to do and slows down was throttled back,
    throttled_rpm_per_s: Positive = 200.0  # rpm/s, no faster than this;
    loaded_rpm_per_s: Positive = 20.0  # and with more to do no faster than this
    pressure_max_bar: Positive = 380.0  # bar, from which the relief valve opens; closed circuits are set to 350..450
    pressure_back: Positive = 0.9  # of it, below which there is force left again


class PowerGuard:
    """`cap_mps` is the highest setpoint, infinite where the engine has power left; the rest is the load as seen.

    `spent`: the relief valve is open.
    """

    def __init__(self, settings: PowerSettings, frame_s: float) -> None:
        self.settings = settings
        self.frame_s = frame_s
        self.share = 1.0 - math.exp(-frame_s / settings.lag_s)
        self.load_pct = self.unloaded_rpm = math.nan
        self.restart()

    def restart(self) -> None:
        """Nothing gives way: what the last drive met is over. What the engine is known to do stays."""
        self.spent = self.lugging = False
        self.carried = 1.0  # of the setpoint
        self.cap_mps = math.inf

    @property
    def limiting(self) -> bool:
        """Whether the setpoint gives way."""
        return self.spent or self.carried < 1.0 or math.isfinite(self.cap_mps)

    def regains(self, engine_rpm: float) -> float | None:
        """ln(n_0 / n), by which an engine that is loaded may become faster once the load goes; None for any other."""
        if not math.isfinite(self.cap_mps) or not self.unloaded_rpm > 0.0 or not engine_rpm > 0.0:
            return None
        return max(math.log(self.unloaded_rpm / engine_rpm), 0.0)

    def watch(self, load_pct: float, engine_rpm: float) -> None:
        """The engine one frame later, whoever drives: an overload may be older than the drive that has to bear it."""
        settings = self.settings
        if math.isfinite(load_pct):
            shown_pct = max(load_pct, settings.low_pct - NEAR_PCT)
            before = self.load_pct if math.isfinite(self.load_pct) else shown_pct
            self.load_pct = before + self.share * (shown_pct - before)
        else:
            self.load_pct = math.nan
        rate_rpm_per_s = settings.throttled_rpm_per_s if load_pct < settings.light_pct else settings.loaded_rpm_per_s
        least_rpm = self.unloaded_rpm - (rate_rpm_per_s * self.frame_s if load_pct < settings.low_pct else 0.0)
        self.unloaded_rpm = max(least_rpm, engine_rpm) if math.isfinite(least_rpm) else engine_rpm

    def step(self, engine_rpm: float, pressure_bar: float, speed_mps: float, setpoint_mps: float) -> float:
        """The setpoint that engine and drive can bear, for the engine as it was watched last."""
        settings = self.settings
        self.spent = pressure_bar > settings.pressure_max_bar * (settings.pressure_back if self.spent else 1.0)
        if self.load_pct > settings.high_pct and engine_rpm < settings.sag_share * self.unloaded_rpm:
            self.cap_mps = max(min(self.cap_mps, speed_mps) - settings.down_mps2 * self.frame_s, 0.0)
        elif not self.load_pct >= settings.low_pct:
            self.cap_mps += settings.up_mps2 * self.frame_s
        if self.cap_mps >= setpoint_mps:
            self.cap_mps = math.inf
        self.lugging = self.load_pct > (settings.low_pct if self.lugging else settings.high_pct)
        left = engine_rpm / (settings.carried_share * self.unloaded_rpm) if self.lugging else 1.0
        self.carried = left if left < 1.0 else 1.0
        return min(setpoint_mps * self.carried, self.cap_mps, max(speed_mps, 0.0) if self.spent else math.inf)
