"""Gain and phase margin of the speed loop: the law that one model would give, around another model as the machine.

    L = -P X / Y,   X / Y = s k D Z^-1 K / [B D - s k D Z^-1 (I - K C) (1 - A, 0, 0, 0)' H E q],   q = exp(-i w T)
    P = (K_P / K) (1 - A_P) H_P E_P q / (1 - A_P q),   H = q^d sum_j h_j q^j,   G = 1 - (1 - c) q,   s = c^n
    Z = I - (I - K C) F q,   D = det Z,   E = (1 - e) / (1 - e q),   e = exp(-T / tau)
    B = G^n (1 - k_w q) - s q E sum_j k_j q^j - q sum_i k_i c^i G^(n-i)

Y measured speed, X the drive that is sent, both in m/s; k the first move of the law, unconstrained, for each thing that
a plan begins from: speed and disturbance as a row k, and one by one drives sent k_j, states of the shaper k_i, wanted
drive of before k_w. F, K and C transition, gain and sensor's row of the disturbance observer, A pole of the vehicle, h
and d response and delay of the drive, K_P / K gains in m/s per mA, those without P of the law's model, those with P of
the machine. c share and n order of the shaper, tau lag of a servo of its own (`rate_limit`), T frame. The command
effects are inverted and drop out; what is measured beside the speed is fed forward and is outside of the loop.

The loop is stable where its characteristic polynomial, the denominator of 1 / (1 + L) with nothing cancelled, has no
zero in |q| <= 1: where it does not wind around zero (argument principle). The margins are those of python-control's
`margin`, a test holds them equal; importing it takes a second. Source: K. J. Astrom, B. Wittenmark, Computer-Controlled
Systems, 3rd ed. 1997, sections 3.2 and 4.4.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial.polynomial import polyval

from cruise.control.controller import ControlSettings
from cruise.control.frame_model import at_period, servo_of
from cruise.control.observer import SEEN, DisturbanceObserver
from cruise.control.predictive import Bounds, Now, Programme
from cruise.control.shaping import CommandShaper
from cruise.effects import low_pass
from cruise.model.model import Model

LOWEST_HZ: Final = 1e-3  # below, the loop is its integrator
BEND_HZ: Final = 0.3  # up to here the frequencies are spread by their logarithm, beyond it evenly
LOW_POINTS, HIGH_POINTS = 60, 220
FREE: Final = 1e9  # m/s and m/s2: a bound that none is


@dataclass(frozen=True, slots=True)
class Margins:
    """How far a loop is from being unstable; both 0 for one that is."""

    gain: float  # factor on the loop gain, infinite where none makes it unstable
    phase_deg: float
    crossover_hz: float  # where the loop gain is 1


class Drive:
    """What one model says of drive and vehicle, frame by frame, at one pace of the gears and yielding of its stroke."""

    def __init__(self, model: Model, frame_s: float, pace: float = 1.0, yielding: float = 1.0) -> None:
        fast = at_period(model, frame_s)
        (pole,), taps, *_ = fast.split(fast.theta)
        self.gain = fast.dc_gain_mps_per_ma
        self.usual_pole = 1.0 - pace * (1.0 - pole)
        self.pole = self.usual_pole ** (1.0 / yielding)
        self.delay, self.response = fast.delay, np.array(taps) / sum(taps)
        self.servo_s = servo_of(fast).lag_s
        self._kept = 1.0 - low_pass.share(self.servo_s, frame_s)

    def followed(self, q: np.ndarray) -> np.ndarray:
        """E, from the drive that is sent to what the servo makes of it."""
        return (1.0 - self._kept) / (1.0 - self._kept * q)

    def felt(self, q: np.ndarray) -> np.ndarray:
        """(1 - A) H q E, from the drive that is sent to the numerator of the speed."""
        return (1.0 - self.pole) * q ** (self.delay + 1) * polyval(q, self.response) * self.followed(q)


@dataclass(frozen=True, slots=True)
class FirstMove:
    """What the law moves by first for a unit of each thing that a plan begins from."""

    speed: float
    drives: np.ndarray  # (depth,)
    shaper: np.ndarray  # (n,)
    load: float
    wanted: float

    @classmethod
    def of(cls, law: Programme, depth: int, order: int) -> "FirstMove":
        """Asked of the law itself, with bounds that never hold."""
        size = 3 + depth + order
        still, bounds = np.zeros(law.count), Bounds(-FREE, FREE, FREE, FREE, FREE)

        def move(at: int) -> float:
            one = np.zeros(size)
            one[at] = 1.0
            shaper = one[3 + depth :]
            return law.solve(Now(one[0], one[3 : 3 + depth], shaper, one[1], 0.0, one[2]), still, bounds).wanted_mps

        moves = np.array([move(at) for at in range(size)])
        return cls(moves[0], moves[3 : 3 + depth], moves[3 + depth :], moves[1], moves[2])


class Law:
    """What one model's law makes of the measured speed at the frequencies `hz`; gears slow the pole by `pace`.

    `yielding` is l, how far the drive yields at its stroke (`cruise.model.core`), beside what the gear does to it.
    `hill` is w, the share by which the observer's gain has moved from its usual one, K_0, to that of a hill, K_1.
    """

    def __init__(
        self,
        model: Model,
        settings: ControlSettings,
        pace: float = 1.0,
        hill: float = 0.0,
        yielding: float = 1.0,
        hz: np.ndarray | None = None,
    ) -> None:
        frame_s = self.frame_s = settings.frame_s
        self.pace, self.yielding = pace, yielding
        self.hz = frequencies_hz(frame_s) if hz is None else hz
        drive = Drive(model, frame_s, pace, yielding)
        pole, depth, order = drive.pole, drive.delay + len(drive.response), settings.shaping_order
        shaper = CommandShaper(settings.shaping_hz, order, frame_s)
        predictive, paced = settings.predictive, min(pace, 1.0)
        law = Programme(pole, drive.response, drive.delay, shaper, frame_s, predictive, paced, drive.servo_s)
        move, share = FirstMove.of(law, depth, order), shaper.share
        seen = DisturbanceObserver(frame_s, settings.observer).filter(drive.usual_pole, paced)
        moves = seen.moves.copy()
        moves[0, :2] = pole, 1.0 - pole
        gain = seen.gain + hill * (seen.hill_gain - seen.gain)  # K
        q = self._q = np.exp(-2j * math.pi * frame_s * self.hz)
        left = np.eye(len(SEEN)) - np.outer(gain, SEEN)
        late = np.eye(len(SEEN)) - q[:, None, None] * (left @ moves)  # Z
        estimated = np.array([move.speed, move.load, 0.0, 0.0])
        observer = np.linalg.det(late)  # D
        asked = observer[:, None] * np.linalg.solve(late.transpose(0, 2, 1), estimated[:, None])[:, :, 0]  # D k Z^-1
        lag, through = 1.0 - (1.0 - share) * q, share**order  # G and s
        kept = lag**order * (1.0 - move.wanted * q) - through * q * polyval(q, move.drives) * drive.followed(q)  # B
        for i, state in enumerate(move.shaper, 1):
            kept -= q * state * share**i * lag ** (order - i)
        self.gain = drive.gain
        self.sent = kept * observer - through * drive.felt(q) * (asked @ left[:, 0])
        self.measured = through * (asked @ gain)

    @property
    def response(self) -> np.ndarray:
        """X / Y (N,): the drive that is sent, in m/s of steady speed by the model, over the measured speed."""
        return self.measured / self.sent

    def loop(self, machine: Model) -> tuple[np.ndarray, np.ndarray]:
        """L around a machine and the characteristic polynomial, each (N,)."""
        drive = Drive(machine, self.frame_s, self.pace, self.yielding)
        felt, late = drive.gain / self.gain * drive.felt(self._q), 1.0 - drive.pole * self._q
        with np.errstate(divide="ignore", invalid="ignore"):  # the integrator, at zero
            return -felt * self.measured / (late * self.sent), late * self.sent - felt * self.measured

    def around(self, machine: Model) -> Margins:
        """The margins of the loop around a machine."""
        loop_gain, polynomial = self.loop(machine)
        turned = np.unwrap(np.angle(polynomial))
        if not np.isfinite(polynomial).all() or abs(turned[-1] - turned[0]) > 0.5 * math.pi:
            return Margins(0.0, 0.0, math.nan)
        return _margins(self.hz[1:], loop_gain[1:])


def frequencies_hz(frame_s: float) -> np.ndarray:
    """From zero to half the rate of the frames."""
    low = np.geomspace(LOWEST_HZ, BEND_HZ, LOW_POINTS)
    return np.concatenate([(0.0,), low, np.linspace(BEND_HZ, 0.5 / frame_s, HIGH_POINTS + 1)[1:]])


def _margins(hz: np.ndarray, loop_gain: np.ndarray) -> Margins:
    """Margins of a stable loop from its gain (N,) over `hz`."""
    real, _ = _crossings(np.imag(loop_gain), np.real(loop_gain), hz)
    turned = np.abs(real[real < 0.0])
    angle, at_hz = _crossings(np.log(np.abs(loop_gain)), np.unwrap(np.angle(loop_gain)), hz)
    from_turned = np.abs((angle % (2.0 * math.pi)) - math.pi)
    least = int(np.argmin(from_turned)) if len(angle) else -1
    return Margins(
        float(np.maximum(turned, 1.0 / turned).min()) if len(turned) else math.inf,
        math.degrees(from_turned[least]) if len(angle) else math.inf,
        float(at_hz[least]) if len(angle) else math.nan,
    )


def _crossings(values: np.ndarray, *beside: np.ndarray) -> list[np.ndarray]:
    """What stands `beside` the values where they change their sign, between the points."""
    at = np.flatnonzero(np.signbit(values[1:]) != np.signbit(values[:-1]))
    share = values[at] / (values[at] - values[at + 1])
    return [one[at] + share * (one[at + 1] - one[at]) for one in beside]
