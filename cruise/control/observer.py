"""The disturbance observer: what the model doesn't explain, as one slowly moving number, and how fast the drive is now.

    x_k = [y_k, d_k, q_k, r_k]'
    y_(k+1) = y_k + (1 - A^(p_k / l_k)) (s_k + d_k - y_k) + noise,   d_(k+1) = d_k + sqrt(alpha) noise
    q' = r,   r' = -omega^2 q - 2 zeta omega r + noise,   measured: y_k + r_k + noise
    d_k = d_(k|k-1) + c_k K_d e_k,   c_k = 1 / (1 + (s'_k / R)^2)
    K = K_0 + w_k (K_1 - K_0),   w_k = 1 - min(1, V / m_k^2),   m_k = m_(k-1) + (T / tau_m) (c_k e_k - m_(k-1))
    ln p_k = exp(-T / tau) ln p_(k-1) + (1 - c_k) K_p e_k,   |ln p| <= 2 kappa |ln alpha|
    h_k = 1 + exp(-T / tau_h) (h_(k-1) - 1) + K_h (e_k - <e>),   x <- x + dx/dh (h_k - h_(k-1)),   0 <= h <= 1

y speed in m/s, A pole of the vehicle over a frame and alpha the pace by which a gear slows it down, s steady speed in
m/s that drive and loads give by the model, d disturbance in m/s of steady speed, r ripple in m/s that the sensor shows
and the machine, heavy as it is, does not follow: lugs of the tyres, slack and swinging of the drive train (omega in
rad/s, zeta damping, q its way in m), e innovation. A Kalman filter (filterpy) in its steady state: its gain, K_0, is
found once for each gear (`rounded`). Filtering a ripple where it is measured costs less than in the command: the way
from the reference, and from what is fed forward, to the command stays as it is. While s changes at a rate s', a model
that answers some hundredths of a second too early or late, or with a pole that is wrong, errs by that rate times its
error in time: what doesn't fit is then no disturbance, and would be an overshoot if it were taken for one. With d in
the prediction the controller has no steady-state error (Muske and Badgwell, "Disturbance modeling for offset-free
linear model predictive control", J. Process Control 12 (2002)).

A hill takes 1/alpha as much of the steady speed as in a slow gear and comes as quickly, but so quick a filter would
leave fourth gear hardly any margins, and take for a hill whatever the model has wrong at a step of the
reference. K_1 is that of the noise of a slow gear, not times sqrt(alpha) (2.6 and 67 degrees; there 2.3 and 61). As
much of it counts as what lasts of the innovations, m, is more than chance, of variance V: the noise is as great as the
innovations show (D. H. Zhou and P. M. Frank, "Strong tracking filtering of nonlinear time-varying stochastic systems
with coloured noise", Int. J. Control 65 (1996)).

p / l is the pace of the drive over the one that its gear has. What of it is known is l, how far the drive yields at its
stroke by the model (`cruise.model.core`). The rest, p, is 1 where the model was learned, and known the less the more a
gear slows the drive: to kappa |ln alpha|, one standard deviation of ln p. K_p is the gain of a Kalman filter for ln p
alone, to which dx / d ln p, from a second filter beside the first, shows it. An extended Kalman filter would move x
along with p; but p (s + d - y) is the same for a slow drive with much of a disturbance as for a fast one with little,
and where the model errs the two wound each other up without end. So an innovation is shared: what comes while the drive
moves is its pace, what comes at rest a disturbance, and x follows by its own filter (recursive prediction errors: L.
Ljung, "Asymptotic behavior of the extended Kalman filter as a parameter estimator for linear systems", IEEE TAC 24
(1979)).

h is the share of its hysteresis' width that the model is believed (`width.py`). A band that is too wide makes the
machine go too far at every turn of the current, so that e takes the sign of the turn, as dx / dh from a third filter
does. K_h is again a Kalman filter's, to which an innovation is 1 / c_k times as uncertain while the drive moves: then
most of it is something else. Here x moves along, for h is bounded, and nothing else has that pattern but what made the
current turn, a hill that still comes. It stands in e before the turn as after it: so what of e has lasted, <e>, is
left out, and of what dx / dh shows of itself in e alike. The width is the machine's: it is kept for long, and when the
filter begins anew. It is never believed to be more than the model's: a band that is too narrow costs little, one that
is too wide swings.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter
from scipy import linalg

from cruise.control.steady_gain import steady_gain
from cruise.settings import Positive


class ObserverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the observer trusts sensor and model."""

    speed_noise_mps: Positive = 0.010  # m/s, of one mean over a frame
    model_noise_mps: Positive = 0.12  # m/s after 1 s, what the model errs by while the speed changes
    disturbance_mps: Positive = 0.08  # m/s after 1 s, how fast hills and soil may come
    ripple_mps: Positive = 0.11  # m/s RMS; more keeps 1.5 to 5 Hz out of the command and lets a hill cost more
    ripple_hz: Positive = 1.5  # above what the command may contain
    ripple_damping: Positive = 0.3
    brisk_mps2: Positive = 0.4  # R, m/s2: at this rate of s half of an innovation is believed; hills stay below it
    brisk_s: Positive = 0.5  # tau_m, s over which the rate is seen, and what lasts of the innovations
    # kappa: fourth gear is slowed to a seventh, give or take a factor of 1.6; by 1, as much as by the gear itself
    pace_share: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.25
    pace_s: Positive = 5.0  # tau, s: a pressure is kept for about as long
    width_share: Positive = 0.8  # one standard deviation of h: it may as well be none as that of the model
    width_s: Positive = 1800.0  # tau_h, s: what makes a width, oil and wear, changes more slowly


CHANCE_STD: Final = 0.5  # of m if e were noise, sqrt(V): most of the filter's noise is ripple, which does not last
LASTING_S: Final = 2.0  # s after which an innovation has lasted: a turn is over, a hill is not
MOST_FILTERS: Final = 16  # kept: the gears of the model that drives, and of a few before it
FILTER_STEPS: Final = 100.0  # per factor e, of 1 - A and of alpha: what differs by less shares a filter
SLOWEST: Final = 1e-6  # least 1 - A
SEEN: Final = np.array([1.0, 0.0, 0.0, 1.0])  # the speed sensor shows y + r


def rounded(pole: float, pace: float, steps: float = FILTER_STEPS) -> tuple[int, int]:
    """What a filter, or a law, is kept under, made for the first such pole and pace: oil or load may move both."""
    return round(steps * math.log(max(1.0 - pole, SLOWEST))), round(steps * math.log(pace))


@dataclass(frozen=True, slots=True)
class Filter:
    """x_(k+1) = F x_k + (1 - A, 0, 0, 0)' s_k, corrected by `gain` times the innovation, whose variance is (m/s)^2."""

    moves: np.ndarray  # F (4, 4)
    gain: np.ndarray  # K_0 (4,)
    hill_gain: np.ndarray  # K_1 (4,)
    variance: float


class DisturbanceObserver:
    """`speed_mps`, `disturbance_mps`, `ripple`, `steady_mps` and what it learns are all its state.

    That is `log_pace` and `width_share`, each with its variance and the derivative of the rest by it, `moved` and
    `turned`, what `lasts`, and m, `hill_mps`. `innovation_mps` is what the last frame did not fit by; `unexpected_mps`
    what of the change of the measured speed, `measured_mps`, since the frame before was not expected, and
    `expected_mps` the rest. A filter that corrects the speed slowly, as the ripple wants it, goes on showing in the one
    what came long ago.
    """

    def __init__(self, frame_s: float, settings: ObserverSettings) -> None:
        self.frame_s = frame_s
        self.settings = settings
        self.calm = 1.0  # share of what is seen that the drive has not moved itself
        self._rate_share = -math.expm1(-frame_s / settings.brisk_s)
        self._kept_share = math.exp(-frame_s / settings.pace_s)
        self._width_kept = math.exp(-frame_s / settings.width_s)
        self._lasting_share = -math.expm1(-frame_s / LASTING_S)
        self.width_share, self.width_variance = 1.0, settings.width_share**2
        self._filters: dict[tuple[int, int], Filter] = {}
        self.reset(0.0)

    def reset(self, speed_mps: float) -> None:
        """Begin at a measured speed, with nothing known beside it but the width."""
        self.speed_mps = self.measured_mps = speed_mps
        self.disturbance_mps = 0.0
        self.innovation_mps = self.expected_mps = self.unexpected_mps = self.hill_mps = 0.0
        self.steady_mps = math.nan  # s through a lag of brisk_s
        self.ripple = np.zeros(2)  # q and r
        self.log_pace, self.log_pace_variance = 0.0, 0.0
        self.moved, self.turned = np.zeros(4), np.zeros(4)  # dx / d ln p, dx / dh
        self.lasts = 0.0, 0.0  # of e and of what of it h shows, in m/s
        self._keep()

    @property
    def upset(self) -> bool:
        """Whether the state is no longer what was kept of it: nothing in the program did that."""
        return self._kept != self._state()

    def quicker(self, deviations: float = 1.0) -> float:
        """Factor by which the drive may be quicker than its model: as estimated, and so many standard deviations more.

        Always as quick as its gear is by the model: a hill that comes while the drive moves makes it look slow.
        """
        return math.exp(max(deviations * math.sqrt(self.log_pace_variance), -self.log_pace))

    def pole(self, pole: float, yielding: float = 1.0) -> float:
        """That of the drive as it is now, for the one that the model gives the gear; `yielding` is l."""
        return max(pole, 0.0) ** (math.exp(self.log_pace) / yielding)

    def step(
        self,
        pole: float,
        steady_mps: float,
        speed_mps: float,
        pace: float = 1.0,
        width_mps: float = 0.0,
        yielding: float = 1.0,
    ) -> float:
        """One frame on: predict with the model, correct with the measured speed; returns the innovation in m/s.

        `width_mps` is by how much the width of the hysteresis moves the steady speed, ds / dh, and `yielding` l. A
        state that was upset stays so.
        """
        upset = self.upset
        found = self._usual(pole, pace)
        pole = self.pole(pole, yielding)
        share, by_log_pace, moves = 1.0 - pole, -pole * math.log(pole) if pole > 0.0 else 0.0, found.moves.copy()
        moves[0, :2] = 1.0 - share, share
        ahead_mps = steady_mps + self.disturbance_mps - self.speed_mps
        states = np.array([(self.speed_mps, self.disturbance_mps, *self.ripple), self.moved, self.turned]) @ moves.T
        states[:, 0] += share * steady_mps, by_log_pace * ahead_mps, share * width_mps
        seen, by_pace, by_width = (states @ SEEN).tolist()
        self.innovation_mps = speed_mps - seen
        self.expected_mps = share * ahead_mps
        self.unexpected_mps = speed_mps - self.measured_mps - self.expected_mps
        self.measured_mps = speed_mps
        self.calm = 1.0 / (1.0 + (self._rate_mps2(steady_mps) / self.settings.brisk_mps2) ** 2)
        gain = found.gain + self._hill_share(found.variance) * (found.hill_gain - found.gain)
        states += np.outer((self.innovation_mps, -by_pace, -by_width), gain * (1.0, self.calm, 1.0, 1.0))
        x, self.moved, self.turned = states
        self._learn_pace(by_pace, found.variance, pace)
        x = x + self.turned * self._learn_width(by_width, found.variance)
        self.speed_mps, self.disturbance_mps, self.ripple = float(x[0]), float(x[1]), x[2:]
        if not upset:
            self._keep()
        return self.innovation_mps

    def _usual(self, pole: float, pace: float) -> Filter:
        """The filter of a gear, made when it is met first."""
        key = rounded(pole, pace)
        found = self._filters.get(key)
        if found is None:
            if len(self._filters) == MOST_FILTERS:
                del self._filters[next(iter(self._filters))]
            found = self._filters[key] = self.filter(pole, pace)
        return found

    def _hill_share(self, variance_mps2: float) -> float:
        """w, for innovations of this variance where nothing lasts."""
        share = self._rate_share
        self.hill_mps += share * (self.calm * self.innovation_mps - self.hill_mps)
        chance_mps2 = CHANCE_STD**2 * variance_mps2 * share / (2.0 - share)
        return 1.0 - chance_mps2 / max(self.hill_mps**2, chance_mps2)

    def _learn_pace(self, shown: float, variance_mps2: float, pace: float) -> None:
        """ln p one frame on, by what of the innovation, of this variance where p is known, shows it so much."""
        std = self.settings.pace_share * abs(math.log(pace))
        kept = self._kept_share
        variance = kept**2 * self.log_pace_variance + (1.0 - kept**2) * std**2
        gain = (1.0 - self.calm) * variance * shown / (variance_mps2 + variance * shown**2)
        found = kept * self.log_pace + gain * self.innovation_mps
        self.log_pace = min(max(found, -2.0 * std), 2.0 * std)
        self.log_pace_variance = variance * (1.0 - gain * shown)

    def _learn_width(self, shown: float, variance_mps2: float) -> float:
        """h one frame on; by how much it changed."""
        kept_mps, kept_shown = self.lasts
        share = self._lasting_share
        self.lasts = kept_mps + share * (self.innovation_mps - kept_mps), kept_shown + share * (shown - kept_shown)
        innovation_mps, shown = self.innovation_mps - self.lasts[0], shown - self.lasts[1]
        kept = self._width_kept
        variance = kept**2 * self.width_variance + (1.0 - kept**2) * self.settings.width_share**2
        gain = variance * shown / (variance_mps2 / self.calm**2 + variance * shown**2)
        before, found = self.width_share, 1.0 + kept * (self.width_share - 1.0) + gain * innovation_mps
        self.width_share = min(max(found, 0.0), 1.0)
        self.width_variance = variance * (1.0 - gain * shown)
        return self.width_share - before

    def _rate_mps2(self, steady_mps: float) -> float:
        """How fast drive and loads move the steady speed, through a lag."""
        if math.isnan(self.steady_mps):
            self.steady_mps = steady_mps
        ahead_mps = steady_mps - self.steady_mps
        self.steady_mps += self._rate_share * ahead_mps
        return ahead_mps / self.settings.brisk_s

    def filter(self, pole: float, pace: float = 1.0) -> Filter:
        """The filter in its steady state."""
        settings, found = self.settings, KalmanFilter(dim_x=4, dim_z=1)
        omega = 2.0 * math.pi * settings.ripple_hz
        swing = np.array([[0.0, 1.0], [-(omega**2), -2.0 * settings.ripple_damping * omega]])
        kept = linalg.expm(swing * self.frame_s)
        found.F = np.array(linalg.block_diag([[pole, 1.0 - pole], [0.0, 1.0]], kept))
        found.H = SEEN[None, :]
        found.R *= settings.speed_noise_mps**2
        ripple = np.diag([settings.ripple_mps / omega, settings.ripple_mps]) ** 2  # lasting: what it loses is its noise

        def gain(share: float) -> np.ndarray:
            std = np.array([settings.model_noise_mps, share * settings.disturbance_mps])
            found.Q = np.array(linalg.block_diag(np.diag(std) ** 2 * self.frame_s, ripple - kept @ ripple @ kept.T))
            return steady_gain(found)[:, 0]

        usual = gain(math.sqrt(pace))
        variance = settings.speed_noise_mps**2 / (1.0 - float(SEEN @ usual))
        return Filter(found.F, usual, gain(1.0), variance)

    def shift(self, disturbance_mps: float) -> None:
        """Move the disturbance by what a change of the model explains differently, so that the change makes no bump."""
        upset = self.upset
        self.disturbance_mps += disturbance_mps
        self.steady_mps -= disturbance_mps
        if not upset:
            self._keep()

    def _state(self) -> tuple[float, ...]:
        return self.speed_mps, self.disturbance_mps, self.log_pace, self.width_share, *self.ripple.tolist()

    def _keep(self) -> None:
        """Note the state a second time, as IEC 61508 asks for what safety depends on."""
        self._kept = self._state()
