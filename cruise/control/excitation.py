"""Excitation signals for identification: the pump current as a function of the time since an experiment began.

    i(t) = i_rest t / t_lead                   0 <= t < t_lead            in gently, from neutral
         = i_rest                              until t_begin              the machine comes to rest
         = signal(t - t_begin)                 until t_end                the part that identifies
         = i_last (1 - (t - t_end) / t_lead)   until t_end + t_lead       out gently, to neutral

i in mA, t in s. The signals are the paper's (sections III and IV: white noise, steps, a slow slope up and down) and a
multisine, whose flat spectrum and whole periods give a frequency response without leakage (Pintelon and Schoukens,
System Identification: A Frequency Domain Approach, 2nd ed. 2012, section 5.3). Equal seeds give equal currents.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
import numpy.typing as npt

from cruise.settings import Positive

GRID_S: Final = 0.05  # s, random hold times are whole multiples of it: the paper's 20 Hz, the period of our frames
ROUNDING: Final = 1e-6  # of a hold time: what a sum of frame periods may be off
DENSE: Final = 32  # points per shortest sine, on which the peak of a multisine is looked for

Current = Annotated[float, msgspec.Meta(ge=0.0, le=1500.0)]  # mA; experiments drive forward only
Count = Annotated[int, msgspec.Meta(ge=1)]
Frequency = Annotated[float, msgspec.Meta(gt=0.0, le=5.0)]  # Hz; half of what frames of 0.05 s could carry
SHOWN: Final = 0.25  # times the rate of the frames: half of what they could carry is still a sine
Seed = tuple[int, ...]
Form = Callable[[float], float]
"""Current in mA over the time in s since the signal began."""
FloatArray = npt.NDArray[np.floating[Any]]


class WhiteNoise(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="white_noise"
):
    """Independent values, each held for `hold_s`; white up to well below 1 / (2 hold_s)."""

    low_ma: Current
    high_ma: Current
    seconds: Positive
    hold_s: Positive = GRID_S  # s, 20 Hz as in the paper
    distribution: Literal["uniform", "gaussian"] = "uniform"
    deviation_ma: Positive = 100.0  # mA, of the Gaussian one before it is clipped to the range; 1/6 to 1/3 of the range

    def __post_init__(self) -> None:
        _check_range(self.low_ma, self.high_ma)

    @property
    def range_ma(self) -> tuple[float, float]:
        """Least and greatest current."""
        return self.low_ma, self.high_ma

    def jump_ma(self, frame_s: float) -> float:
        """Greatest change from one frame to the next."""
        return self.high_ma - self.low_ma

    @property
    def duration_s(self) -> float:
        """Length of the signal itself."""
        return self.seconds

    def lasting(self, seconds: float) -> "WhiteNoise":
        """The same signal with another length."""
        return msgspec.structs.replace(self, seconds=seconds)

    def form(self, seed: Seed) -> Form:
        """The current as a function of the time since the signal began."""
        rng = np.random.default_rng(seed)
        count = math.ceil(self.seconds / self.hold_s - ROUNDING)
        if self.distribution == "uniform":
            values_ma = rng.uniform(self.low_ma, self.high_ma, count)
        else:
            values_ma = rng.normal(self.rest_ma(seed), self.deviation_ma, count).clip(self.low_ma, self.high_ma)
        held_ma, hold_s, last = values_ma.tolist(), self.hold_s, count - 1
        return lambda t_s: held_ma[min(int(t_s / hold_s + ROUNDING), last)]

    def not_given(self, frame_s: float) -> str:
        """What of it frames of this length can't give, in words; empty where nothing."""
        return _no_multiple("hold_s", self.hold_s, frame_s)

    def rest_ma(self, seed: Seed) -> float:
        """Current at which the machine waits for the signal."""
        return 0.5 * (self.low_ma + self.high_ma)


class Steps(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="steps"):
    """Levels, each held for a random time between `hold_min_s` and `hold_max_s`; the levels go round, or are random."""

    seconds: Positive
    hold_min_s: Positive
    hold_max_s: Positive
    levels_ma: tuple[Current, ...] = ()  # in this order, again and again; empty: random ones between low_ma and high_ma
    low_ma: Current = 0.0
    high_ma: Current = 0.0

    def __post_init__(self) -> None:
        if self.levels_ma and (self.low_ma or self.high_ma):
            raise ValueError("either levels_ma or low_ma and high_ma")
        if len(self.levels_ma) == 1:
            raise ValueError("levels_ma has one level; a step needs two")
        if not self.levels_ma:
            _check_range(self.low_ma, self.high_ma)
        shortest, longest = self._holds()
        if shortest > longest:
            raise ValueError(f"no multiple of {GRID_S} s lies between hold_min_s and hold_max_s")

    @property
    def range_ma(self) -> tuple[float, float]:
        """Least and greatest current."""
        return (min(self.levels_ma), max(self.levels_ma)) if self.levels_ma else (self.low_ma, self.high_ma)

    def jump_ma(self, frame_s: float) -> float:
        """Greatest change from one frame to the next."""
        low_ma, high_ma = self.range_ma
        return high_ma - low_ma

    @property
    def duration_s(self) -> float:
        """Length of the signal itself."""
        return self.seconds

    def lasting(self, seconds: float) -> "Steps":
        """The same signal with another length."""
        return msgspec.structs.replace(self, seconds=seconds)

    def form(self, seed: Seed) -> Form:
        """The current as a function of the time since the signal began."""
        rng = np.random.default_rng(seed)
        shortest, longest = self._holds()
        count = math.ceil(self.seconds / (shortest * GRID_S)) + 1
        ends_s = GRID_S * np.cumsum(rng.integers(shortest, longest + 1, count)) - ROUNDING
        values_ma = (
            np.resize(self.levels_ma, count) if self.levels_ma else rng.uniform(self.low_ma, self.high_ma, count)
        )
        return lambda t_s: float(values_ma[int(np.searchsorted(ends_s, t_s, side="right"))])

    def not_given(self, frame_s: float) -> str:
        """What of it frames of this length can't give, in words; empty where nothing."""
        shortest, longest = self._holds()
        said = (_no_multiple("a hold time of", k * GRID_S, frame_s) for k in range(shortest, longest + 1))
        return next(filter(None, said), "")

    def rest_ma(self, seed: Seed) -> float:
        """Current at which the machine waits for the signal."""
        return self.form(seed)(0.0)

    def _holds(self) -> tuple[int, int]:
        """Shortest and longest hold time, in steps of the grid."""
        return math.ceil(self.hold_min_s / GRID_S - ROUNDING), math.floor(self.hold_max_s / GRID_S + ROUNDING)


class Ramp(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="ramp"):
    """From `low_ma` to `high_ma` and back at `rate_ma_per_s`, `repeats` times: the static curve and its hysteresis."""

    low_ma: Current
    high_ma: Current
    rate_ma_per_s: Positive
    repeats: Count = 2  # the paper drove it twice

    def __post_init__(self) -> None:
        _check_range(self.low_ma, self.high_ma)

    @property
    def range_ma(self) -> tuple[float, float]:
        """Least and greatest current."""
        return self.low_ma, self.high_ma

    def jump_ma(self, frame_s: float) -> float:
        """Greatest change from one frame to the next."""
        return self.rate_ma_per_s * frame_s

    @property
    def period_s(self) -> float:
        """Time of one way up and down."""
        return 2.0 * (self.high_ma - self.low_ma) / self.rate_ma_per_s

    @property
    def duration_s(self) -> float:
        """Length of the signal itself."""
        return self.repeats * self.period_s

    def lasting(self, seconds: float) -> "Ramp":
        """The same signal with another length, in whole periods."""
        return msgspec.structs.replace(self, repeats=max(round(seconds / self.period_s), 1))

    def form(self, seed: Seed) -> Form:
        """The current as a function of the time since the signal began."""
        low_ma, rate_ma_per_s, period_s = self.low_ma, self.rate_ma_per_s, self.period_s

        def current_ma(t_s: float) -> float:
            up_s = t_s % period_s
            return low_ma + rate_ma_per_s * min(up_s, period_s - up_s)

        return current_ma

    def not_given(self, frame_s: float) -> str:
        """What of it frames of this length can't give: they give it all."""
        return ""

    def rest_ma(self, seed: Seed) -> float:
        """Current at which the machine waits for the signal."""
        return self.low_ma


class Multisine(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="multisine"
):
    """Equal sines at every multiple of 1 / period_s in a band, `periods` times.

    i(t) = mean + peak / max|x| x(t),   x(t) = sum_k cos(2 pi k t / period + phi_k)

    phi_k are Schroeder's, -pi n (n - 1) / N for the n-th of N lines, or random by seed.
    """

    mean_ma: Current
    peak_ma: Positive  # mA, greatest distance from the mean
    low_hz: Frequency
    high_hz: Frequency
    period_s: Positive  # s; its inverse is the resolution in Hz
    periods: Count
    phases: Literal["schroeder", "random"] = "schroeder"  # crest factor 1.7 to 1.9, random ones 2.5 to 4 (a sine: 1.41)

    def __post_init__(self) -> None:
        if not len(self._lines()):
            raise ValueError("no multiple of 1 / period_s lies between low_hz and high_hz; choose a longer period_s")
        if self.mean_ma < self.peak_ma:
            raise ValueError("peak_ma above mean_ma would reverse the machine")

    @property
    def range_ma(self) -> tuple[float, float]:
        """Least and greatest current."""
        return self.mean_ma - self.peak_ma, self.mean_ma + self.peak_ma

    def jump_ma(self, frame_s: float) -> float:
        """Greatest change from one frame to the next."""
        return 2.0 * math.pi * self.high_hz * self.peak_ma * frame_s  # Bernstein's bound on the slope, over one frame

    @property
    def duration_s(self) -> float:
        """Length of the signal itself."""
        return self.periods * self.period_s

    def lasting(self, seconds: float) -> "Multisine":
        """The same signal with another length, in whole periods."""
        return msgspec.structs.replace(self, periods=max(round(seconds / self.period_s), 1))

    def form(self, seed: Seed) -> Form:
        """The current as a function of the time since the signal began."""
        phases = self._phases(seed)
        radps = 2.0 * math.pi / self.period_s * self._lines()
        mean_ma, scale_ma = self.mean_ma, self.peak_ma / float(np.abs(self._dense(phases)).max())
        # Between the points of the dense grid the sum may be a trifle higher: clipped by less than 0.5 %.
        low_ma, high_ma = self.range_ma
        return lambda t_s: min(max(mean_ma + scale_ma * float(np.cos(radps * t_s + phases).sum()), low_ma), high_ma)

    def rest_ma(self, seed: Seed) -> float:
        """Current at which the machine waits for the signal."""
        return self.mean_ma

    def not_given(self, frame_s: float) -> str:
        """What of it frames of this length can't give, in words; empty where nothing."""
        shown_hz = SHOWN / frame_s
        if self.high_hz <= shown_hz * (1.0 + ROUNDING):
            return ""
        return (
            f"high_hz {self.high_hz:g} is more than frames of control.frame_s, {frame_s:g} s, can show: {shown_hz:g} Hz"
        )

    def _lines(self) -> FloatArray:
        first = math.ceil(self.low_hz * self.period_s - ROUNDING)
        last = math.floor(self.high_hz * self.period_s + ROUNDING)
        return np.arange(max(first, 1), last + 1, dtype=float)

    def _phases(self, seed: Seed) -> FloatArray:
        count = len(self._lines())
        if self.phases == "random":
            return np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, count)
        order = np.arange(1, count + 1)
        return -math.pi * order * (order - 1) / count

    def _dense(self, phases: FloatArray) -> FloatArray:
        """The sum of cosines (M,) over one period, on a grid of DENSE points per shortest sine."""
        lines = self._lines()
        points = 2 ** math.ceil(math.log2(DENSE * lines[-1]))
        spectrum = np.zeros(points // 2 + 1, complex)
        spectrum[lines.astype(int)] = 0.5 * points * np.exp(1j * phases)
        return np.fft.irfft(spectrum, points)


Kind = WhiteNoise | Steps | Ramp | Multisine


class Phase(IntEnum):
    """Where an experiment is."""

    LEADING_IN = 1
    EXCITING = 2
    LEADING_OUT = 3
    OVER = 4


@dataclass(frozen=True, slots=True)
class Excitation:
    """The whole current of one experiment; `form` acts from `begin_s` to `end_s`."""

    form: Form
    rest_ma: float
    lead_s: float
    begin_s: float
    end_s: float

    @classmethod
    def of(cls, kind: Kind, seed: Seed, lead_s: float, settle_s: float) -> "Excitation":
        """The signal with `lead_s` to its first current, `settle_s` of waiting there, and `lead_s` back to neutral."""
        begin_s = lead_s + settle_s
        return cls(kind.form(seed), kind.rest_ma(seed), lead_s, begin_s, begin_s + kind.duration_s)

    @property
    def over_s(self) -> float:
        """When the current is back in neutral."""
        return self.end_s + self.lead_s

    def phase(self, t_s: float) -> Phase:
        """Where the experiment is."""
        late_s = t_s + ROUNDING
        if late_s < self.begin_s:
            return Phase.LEADING_IN
        if late_s < self.end_s:
            return Phase.EXCITING
        return Phase.LEADING_OUT if late_s < self.over_s else Phase.OVER

    def current_ma(self, t_s: float) -> float:
        """The current at `t_s` since the experiment began."""
        match self.phase(t_s):
            case Phase.LEADING_IN:
                return self.rest_ma * min(max(t_s / self.lead_s, 0.0), 1.0)
            case Phase.EXCITING:
                return self.form(max(t_s - self.begin_s, 0.0))
            case Phase.LEADING_OUT:
                last_ma = self.form(self.end_s - self.begin_s - 0.5 * GRID_S)
                return last_ma * min(max((self.over_s - t_s) / self.lead_s, 0.0), 1.0)
            case Phase.OVER:
                return 0.0


def _no_multiple(what: str, seconds: float, frame_s: float) -> str:
    frames = seconds / frame_s
    fits = abs(frames - round(frames)) <= ROUNDING
    return "" if fits else f"{what} {seconds:g} s is no multiple of control.frame_s, {frame_s:g}"


def _check_range(low_ma: float, high_ma: float) -> None:
    if not low_ma < high_ma:
        raise ValueError("low_ma has to be below high_ma")
