"""Anti-aliased, time-aligned samples: signals that come at their own rates, with jitter, become means over one period.

    mean_k = 1/m integral of x(t) dt over the measured part, m seconds long, of (t_k - T, t_k]

T period in s. Between two readings a continuous signal x(t) is the straight line through both (trapezoid rule), a held
one keeps its last value (zero-order hold: what a current regulator does); a state such as the gear has no mean, its
last value counts. A reading is worth nothing `stale_after` seconds later. The mean over one period is the box-car
filter, whose zeros lie on the multiples of the sampling rate, where aliases of a constant come from (Oppenheim and
Schafer, Discrete-Time Signal Processing, 3rd ed. 2010, section 4.8); it delays input and output alike by T / 2.
"""

import enum
import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from cruise.signals import SIGNALS

FloatArray = npt.NDArray[np.floating[Any]]

NAN: Final = math.nan
LEAST_MEASURED: Final = 0.5  # part of the period; the mean over less of it is not aligned with the other signals
MAX_READINGS: Final = 2000  # of one signal; after it half of them go: 10 s at 100 Hz, the highest rate, are left
FRESH_S: Final = 0.3  # three messages in a row lost at 10 Hz, the rate of the ISO 11783-7 speeds
FRESH_MESSAGES: Final = 3.0
LONGEST_S: Final = 1.0  # three messages at 3 Hz; for what may come once a second, up to a minute
MESSAGE_PERIOD_S: Final = {"oil_temperature_c": 1.0, "machine_mass_kg": 1.0}  # the design's table; the others: <= 0.1 s


class Kind(enum.Enum):
    """What a signal does between two readings."""

    CONTINUOUS = "continuous"
    HELD = "held"
    STATE = "state"


class Pushed(enum.Enum):
    """What became of a reading."""

    KEPT = "kept"
    REPLACED = "replaced: it has the time of the one before"
    LATE = "dropped: it is older than the one before"
    RESTARTED = "kept, and all older ones dropped: time jumped back by more than a reading lives"
    NO_TIME = "dropped: its time is not a finite number"


class SamplingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How long a reading counts."""

    stale_after_s: dict[str, Annotated[float, msgspec.Meta(gt=0, le=60)]] = {}
    """By signal; default three periods of its message, at least 0.3 s. A message at 5 Hz needs 0.6 s."""

    def __post_init__(self) -> None:
        for name, longest_s in self.stale_after_s.items():
            if name not in SIGNALS:
                raise ValueError(f"stale_after_s: there is no signal {name}; there are {', '.join(SIGNALS)}")
            if name not in MESSAGE_PERIOD_S and longest_s > LONGEST_S:
                raise ValueError(
                    f"stale_after_s.{name} is {longest_s:g} s, more than {LONGEST_S:g} s: so long nobody would notice "
                    "that it is lost"
                )

    def stale_after(self, name: str) -> float:
        """Return the time in s after which a reading of `name` is worth nothing."""
        return self.stale_after_s.get(name) or stale_after(MESSAGE_PERIOD_S.get(name, 0.0))


def stale_after(period_s: float) -> float:
    """Return how long in s a reading counts of a signal that comes every `period_s`."""
    return max(FRESH_MESSAGES * period_s, FRESH_S)


def kind_of(name: str) -> Kind:
    """Return what the signal `name` does between two readings; an unknown signal is taken as continuous."""
    signal = SIGNALS.get(name)
    if signal is not None and (signal.unit == "0/1" or name == "gear"):
        return Kind.STATE
    return Kind.HELD if name in ("pump_current_ma", "pump_current_command_ma", "setpoint_mps") else Kind.CONTINUOUS


@dataclass(slots=True)
class Stream:
    """The readings of one signal that the next mean needs, each with the integral of the signal up to it.

    `integrals` holds the integral of what was measured since the stream began, `measured_s` how long that was, both at
    the time of each reading, so that any mean is a difference between two times.
    """

    kind: Kind
    stale_after_s: float
    times_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    integrals: list[float] = field(default_factory=list)
    measured_s: list[float] = field(default_factory=list)

    def push(self, time_s: float, value: float) -> Pushed:
        """Take one reading; NaN: the sensor says that it has none. Times have to rise."""
        if not -math.inf < value < math.inf:
            value = NAN  # an inf would stay in the integral
        outcome = Pushed.KEPT
        times = self.times_s
        if not (times[-1] if times else -math.inf) < time_s < math.inf:
            outcome = self._make_room(time_s)
            if outcome is Pushed.LATE or outcome is Pushed.NO_TIME:
                return outcome
        last = len(times) - 1
        times.append(time_s)
        self.values.append(value)
        integral, measured_s = self._up_to(time_s, last, last + 1) if last >= 0 else (0.0, 0.0)
        self.integrals.append(integral)
        self.measured_s.append(measured_s)
        if len(times) == MAX_READINGS:
            self._forget(MAX_READINGS // 2)
        return outcome

    def mean(self, from_s: float, until_s: float) -> float:
        """Return the mean over (from_s, until_s], for a state its value at `until_s`; NaN if too little was measured.

        Forgets what lies before `from_s`; readings after `until_s` wait for the next call.
        """
        self._forget(bisect_right(self.times_s, from_s) - 1)
        last = bisect_right(self.times_s, until_s) - 1
        if last < 0:
            return NAN
        if self.kind is Kind.STATE:
            return self.values[last] if until_s - self.times_s[last] <= self.stale_after_s else NAN
        integral, measured_s = self._up_to(until_s, last, last)
        if self.times_s[0] < from_s:
            integral_before, measured_before_s = self._up_to(from_s, 0, min(1, last))
        else:
            integral_before, measured_before_s = self.integrals[0], self.measured_s[0]
        measured_s -= measured_before_s
        if measured_s < LEAST_MEASURED * (until_s - from_s):
            return NAN
        return (integral - integral_before) / measured_s

    def _up_to(self, time_s: float, last: int, follower: int) -> tuple[float, float]:
        """Return integral and measured time at `time_s`, after the reading `last` and not after the one `follower`.

        `follower` equal to `last`: what follows is not known yet.
        """
        value, integral, measured_s = self.values[last], self.integrals[last], self.measured_s[last]
        if value != value:
            return integral, measured_s
        passed_s = time_s - self.times_s[last]
        if follower > last and self.kind is Kind.CONTINUOUS:
            whole_s = self.times_s[follower] - self.times_s[last]
            rise = self.values[follower] - value
            if whole_s <= self.stale_after_s and rise == rise:
                return integral + (value + 0.5 * rise * passed_s / whole_s) * passed_s, measured_s + passed_s
        held_s = min(passed_s, self.stale_after_s)
        return integral + value * held_s, measured_s + held_s

    def _make_room(self, time_s: float) -> Pushed:
        """Return what to do with a reading that is not newer than the last one, and drop what it replaces."""
        if not math.isfinite(time_s):
            return Pushed.NO_TIME
        back_s = self.times_s[-1] - time_s
        if 0.0 < back_s <= self.stale_after_s:
            return Pushed.LATE
        if back_s == 0.0:
            for kept in (self.times_s, self.values, self.integrals, self.measured_s):
                kept.pop()
            return Pushed.REPLACED
        self._forget(len(self.times_s))
        return Pushed.RESTARTED

    def _forget(self, count: int) -> None:
        if count > 0:
            del self.times_s[:count], self.values[:count], self.integrals[:count], self.measured_s[:count]


class StreamSampler:
    """Collects the readings of all signals and takes samples of them, aligned in time.

    The caller brings the time: stamps of one clock, `until_s` rising from call to call. Memory is bounded by the number
    of `names`.
    """

    def __init__(self, settings: SamplingSettings, names: Iterable[str] = SIGNALS) -> None:
        self.streams = {name: Stream(kind_of(name), settings.stale_after(name)) for name in names}

    def push(self, name: str, time_s: float, value: float) -> Pushed:
        """Take one reading of the signal `name`; NaN: no measurement. Raises KeyError for a foreign name."""
        return self.streams[name].push(time_s, value)

    def sample(self, until_s: float, period_s: float) -> dict[str, float]:
        """Return every signal's mean over (until_s - period_s, until_s], NaN where it was not measured."""
        from_s = until_s - period_s
        return {name: stream.mean(from_s, until_s) for name, stream in self.streams.items()}


def means(
    time_s: FloatArray, values: FloatArray, until_s: FloatArray, period_s: float, kind: Kind, stale_after_s: float
) -> FloatArray:
    """Return the samples (M,) at `until_s` (M,) of one recorded signal, as StreamSampler would have taken them online.

    `time_s` (N,) rising, `values` (N,), NaN for no measurement. All at once: recordings have 10^5 readings and more.
    """
    if not len(time_s):
        return np.full(len(until_s), NAN)
    last = np.searchsorted(time_s, until_s, side="right") - 1
    if kind is Kind.STATE:
        given = np.where(np.isfinite(values), values, NAN)[np.maximum(last, 0)]
        return np.where((last >= 0) & (until_s - time_s[last] <= stale_after_s), given, NAN)
    from_s = until_s - period_s
    first = np.searchsorted(time_s, from_s, side="right") - 1
    every = np.arange(len(time_s) - 1)
    pieces = _pieces(time_s, values, time_s[1:], every, every + 1, kind, stale_after_s)
    so_far = [np.concatenate([[0.0], np.cumsum(piece)]) for piece in pieces]
    at_end = _pieces(time_s, values, until_s, last, last, kind, stale_after_s)
    began = np.maximum(first, 0)  # a stream that begins within the period counts from its first reading on
    begins_s, follower = np.maximum(from_s, time_s[0]), np.minimum(began + 1, last)
    at_start = _pieces(time_s, values, begins_s, began, follower, kind, stale_after_s)
    integral, measured_s = (
        (whole[last] + end) - (whole[began] + start) for whole, end, start in zip(so_far, at_end, at_start, strict=True)
    )
    enough = (last >= 0) & (measured_s >= LEAST_MEASURED * (until_s - from_s))
    return np.where(enough, integral / np.where(enough, measured_s, 1.0), NAN)


def _pieces(
    time_s: FloatArray,
    values: FloatArray,
    at_s: FloatArray,
    last: npt.NDArray[np.intp],
    follower: npt.NDArray[np.intp],
    kind: Kind,
    stale_after_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return what the readings `last` (M,) add to integral and measured time up to `at_s` (M,), as `Stream._up_to`."""
    value, passed_s = values[last], at_s - time_s[last]
    known = np.isfinite(value)
    held_s = np.minimum(passed_s, stale_after_s)
    integral, measured_s = value * held_s, held_s
    if kind is Kind.CONTINUOUS:
        whole_s, rise = time_s[follower] - time_s[last], values[follower] - value
        line = (follower > last) & (whole_s <= stale_after_s) & np.isfinite(rise)
        on_line = (value + 0.5 * rise * passed_s / np.where(line, whole_s, 1.0)) * passed_s
        integral = np.where(line, on_line, integral)
        measured_s = np.where(line, passed_s, measured_s)
    return np.where(known, integral, 0.0), np.where(known, measured_s, 0.0)
