"""Static curve from slow ramps of the current, up and down: dead zone, curvature, saturation and hysteresis loop.

    y = c + b x + q x^2,    x = min(max(e, u_0), u_1) - u_0,    e = u - sign(du/dt) w / 2 - (du/dt) T

y speed [m/s], u current [mA], e current that acts [mA], w width of the loop [mA] (a play operator on a ramp), T lag of
the drive [s] (on a steady ramp a linear drive is late by delay plus time constants), u_0 threshold and u_1 saturation
[mA], c [m/s], b [m/s per mA], q [m/s per mA^2]. Fitted to means over bins of the current; c, b, q by linear least
squares inside the search for u_0, u_1, w and T (separable: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413). T is
given, or found from ramps of different rates, or else 0: then w is gross. An end whose absence fits as well (F test) is
left out; one that stays is found again from the part of the curve near it, and c, b, q hold for these ends. Standard
errors allow for residuals that correlate from bin to bin.

Source: the paper, figure 4 and section IV.C; G.A.F. Seber, C.J. Wild, Nonlinear Regression (1989), sections 5.3, 6.6.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize, stats

from cruise.identification.explore.pieces import Estimate, NotPossible, Piece, pieces, unmoved
from cruise.identification.explore.ramps import Ramp, ramps_with_samples
from cruise.recording import Recording
from cruise.sampling import FloatArray

SETTLED: Final = 0.08  # of its span, after which a ramp has left the loop's turn and its own transient behind
BINS: Final = 40  # over the range of the current: 20 mA of 800
DIFFERENT_RATES: Final = 1.5  # ratio of two ramp rates that tells the lag from the loop
NEAR_END: Final = 0.4  # of the range of speed, from which an end of the curve is found
SIGNIFICANT_P: Final = 0.01
FEWEST_BINS: Final = 10


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """The curve (M,) by bins, NaN where no ramp of that direction went, and the shape fitted to it.

    Speeds are at the current that acts, corrected for the lag where it is known (`lag_s`, `lag_from`).
    speed = offset + slope (u - origin) + quadratic (u - origin)^2 between origin and saturation. None: not found.
    """

    ramps: tuple[Ramp, ...]
    current_ma: FloatArray
    rising_speed_mps: FloatArray
    falling_speed_mps: FloatArray
    threshold_ma: Estimate | None
    saturation_ma: Estimate | None
    origin_ma: float
    offset_mps: Estimate
    slope_mps_per_ma: Estimate
    quadratic_mps_per_ma2: Estimate
    quadratic_p_value: float
    gross_loop_width_ma: float | None
    loop_width_ma: Estimate | None
    lag_s: Estimate | None
    lag_from: str
    residual_std_mps: float

    @property
    def quadratic_needed(self) -> bool:
        """Whether a straight line is refused."""
        return self.quadratic_p_value < SIGNIFICANT_P

    def words(self) -> list[str]:
        """Return what the curve says, in sentences."""
        low_ma, high_ma = self.current_ma[0], self.current_ma[-1]
        up = sum(ramp.rate_ma_per_s > 0.0 for ramp in self.ramps)
        rates = [abs(ramp.rate_ma_per_s) for ramp in self.ramps]
        said = [f"{up} ramps up and {len(self.ramps) - up} down at {min(rates):.3g} to {max(rates):.3g} mA/s"]
        if self.threshold_ma is None:
            said.append(f"no dead zone above {low_ma:.0f} mA, the lowest current of the ramps")
        else:
            said.append(f"the drive starts to move at {self.threshold_ma.value:.0f} +- {self.threshold_ma.std:.1f} mA")
        if self.saturation_ma is None:
            said.append(f"no saturation below {high_ma:.0f} mA, the highest current of the ramps")
        else:
            said.append(f"the speed stops rising at {self.saturation_ma.value:.0f} +- {self.saturation_ma.std:.1f} mA")
        q, p = self.quadratic_mps_per_ma2, self.quadratic_p_value
        said.append(
            f"in between it is {'curved' if self.quadratic_needed else 'straight'}: quadratic term "
            f"{1e6 * q.value:.3g} +- {1e6 * q.std:.2g} m/s per A^2 (p = {p:.2g})"
        )
        if self.gross_loop_width_ma is None:
            said.append("no loop width: it needs ramps up and down; drive `cruise experiment ramp`")
        elif self.loop_width_ma is None:
            said.append(
                f"the loop is {self.gross_loop_width_ma:.0f} mA wide, hysteresis and lag together; ramps of two rates, "
                "or white noise beside the ramps, would tell them apart"
            )
        else:
            said.append(
                f"the loop is {self.gross_loop_width_ma:.0f} mA wide; net of the lag ({self.lag_from}) hysteresis has "
                f"{self.loop_width_ma.value:.1f} +- {self.loop_width_ma.std:.1f} mA of it"
            )
        return said


@dataclass(frozen=True, eq=False)
class _Data:
    """Bins of all ramps: mean current, mean speed, rate of the ramp and which ramp (N,)."""

    current_ma: FloatArray
    speed_mps: FloatArray
    rate_ma_per_s: FloatArray
    ramp: FloatArray

    def part(self, chosen: np.ndarray) -> "_Data":
        """Return the chosen bins."""
        return _Data(self.current_ma[chosen], self.speed_mps[chosen], self.rate_ma_per_s[chosen], self.ramp[chosen])


@dataclass(frozen=True, eq=False)
class _Fit:
    """Threshold, saturation, loop width and lag (4,), curve (3,), what was free, residuals (N,) and their sum."""

    shape: FloatArray
    curve: FloatArray
    free: tuple[bool, bool, bool, bool]
    residual_mps: FloatArray

    @property
    def loss(self) -> float:
        return float(self.residual_mps @ self.residual_mps)


def static_curve(recordings: Sequence[Recording], lag_s: Estimate | None = None) -> StaticCurve | NotPossible:
    """Fit the static curve to all ramps forward (current above 0); `lag_s` is the drive's, if it is known."""
    nothing = unmoved(pieces(recordings))
    if nothing is not None:
        return nothing
    found = ramps_with_samples(recordings)
    if not found:
        return NotPossible("no ramps in this recording: drive `cruise experiment ramp`")
    edges_ma = _edges(found)
    data = _binned(found, edges_ma)
    if len(data.speed_mps) < FEWEST_BINS or np.ptp(data.speed_mps) == 0.0:
        return NotPossible(
            "the ramps hold too little of a forward drive that moves: ramp from below the dead zone to full stroke "
            "with `cruise experiment ramp`"
        )
    rates = np.abs(data.rate_ma_per_s)
    both = bool(np.any(data.rate_ma_per_s > 0.0) and np.any(data.rate_ma_per_s < 0.0))
    lag_found = both and lag_s is None and float(np.max(rates)) > DIFFERENT_RATES * float(np.min(rates))
    known_lag_s = lag_s.value if lag_s is not None else 0.0
    whole = _chosen(data, (True, True, both, lag_found), known_lag_s)
    _, _, width_ma, fitted_lag_s = _estimates(whole.shape, _standard_errors(data, whole)[:4])
    threshold, saturation = _end(data, whole, 0), _end(data, whole, 1)
    shape = whole.shape.copy()
    shape[:2] = threshold.value if threshold else shape[0], saturation.value if saturation else shape[1]
    fit = _at(data, shape, (False, False, False, False))
    variance = _standard_errors(data, fit)[4:] ** 2
    for end, found_end in enumerate((threshold, saturation)):
        if found_end is not None:  # what a standard error of the end does to the curve adds to its own
            moved = shape + found_end.std * (np.arange(4) == end)
            variance += (_at(data, moved, fit.free).curve - fit.curve) ** 2
    offset, slope, quadratic = _estimates(fit.curve, np.sqrt(variance))
    used_lag_s = fitted_lag_s if lag_found else lag_s
    mean_rate = float(np.mean(rates))
    gross_ma = width_ma.value + 2.0 * mean_rate * (used_lag_s.value if used_lag_s else 0.0)
    net = None
    if both and used_lag_s is not None:
        from_lag_ma = 0.0 if lag_found else 2.0 * mean_rate * used_lag_s.std
        net = Estimate(width_ma.value, float(np.hypot(width_ma.std, from_lag_ma)))
    freedom = max(len(data.speed_mps) - 3 - sum(whole.free), 1)
    acting_ma = data.current_ma - data.rate_ma_per_s * fit.shape[3]
    centres_ma = 0.5 * (edges_ma[1:] + edges_ma[:-1])
    rising = data.rate_ma_per_s > 0.0
    return StaticCurve(
        ramps=tuple(ramp for _, ramp in found),
        current_ma=centres_ma,
        rising_speed_mps=_means(acting_ma[rising], data.speed_mps[rising], edges_ma),
        falling_speed_mps=_means(acting_ma[~rising], data.speed_mps[~rising], edges_ma),
        threshold_ma=threshold,
        saturation_ma=saturation,
        origin_ma=float(fit.shape[0]),
        offset_mps=offset,
        slope_mps_per_ma=slope,
        quadratic_mps_per_ma2=quadratic,
        quadratic_p_value=float(2.0 * stats.t.sf(abs(quadratic.value) / max(quadratic.std, 1e-300), freedom)),
        gross_loop_width_ma=gross_ma if both else None,
        loop_width_ma=net,
        lag_s=used_lag_s,
        lag_from="from ramps of different rates" if lag_found else "given" if lag_s is not None else "not known",
        residual_std_mps=float(np.sqrt(fit.loss / freedom)),
    )


def _edges(found: Sequence[tuple[Piece, Ramp]]) -> FloatArray:
    joined = np.concatenate([piece.current_ma for piece, _ in found])
    return np.linspace(max(float(np.min(joined)), 0.0), max(float(np.max(joined)), 1.0), BINS + 1)


def _binned(found: Sequence[tuple[Piece, Ramp]], edges_ma: FloatArray) -> _Data:
    """Return means over bins of the forward part of each ramp, after its settling."""
    rows = []
    for number, (piece, ramp) in enumerate(found):
        settled = slice(round(SETTLED * len(piece)), None)
        current_ma, speed_mps = piece.current_ma[settled], piece.speed_mps[settled]
        bins = np.digitize(current_ma, edges_ma)
        for one in range(1, BINS + 1):
            inside = bins == one
            if np.count_nonzero(inside) > 1:
                rows.append(
                    (np.mean(current_ma[inside]), np.mean(speed_mps[inside]), ramp.rate_ma_per_s, float(number))
                )
    table = np.array(rows).reshape(-1, 4)
    return _Data(table[:, 0], table[:, 1], table[:, 2], table[:, 3])


def _acting(data: _Data, shape: FloatArray) -> FloatArray:
    """Return x: the current that acts, between threshold and saturation, from the threshold on."""
    u_0, u_1, width_ma, lag_s = shape
    e = data.current_ma - np.sign(data.rate_ma_per_s) * 0.5 * width_ma - data.rate_ma_per_s * lag_s
    return np.clip(e, u_0, max(u_1, u_0)) - u_0


def _predicted(x: FloatArray, curve: FloatArray) -> FloatArray:
    return curve[0] + curve[1] * x + curve[2] * x**2


def _at(data: _Data, shape: FloatArray, free: tuple[bool, bool, bool, bool]) -> _Fit:
    """Return the curve that fits best for a given shape."""
    x = _acting(data, shape)
    scale = np.array([1.0, 1.0 / np.ptp(data.current_ma), 1.0 / np.ptp(data.current_ma) ** 2])
    basis = np.column_stack([np.ones_like(x), x, x**2])
    curve = np.linalg.lstsq(basis * scale, data.speed_mps, rcond=None)[0] * scale
    return _Fit(shape, curve, free, data.speed_mps - _predicted(x, curve))


def _fitted(data: _Data, free: tuple[bool, bool, bool, bool], held: FloatArray) -> _Fit:
    """Search the free ones of threshold, saturation, width and lag from several starts; the others are as `held`."""
    low_ma, high_ma = float(np.min(data.current_ma)), float(np.max(data.current_ma))
    range_ma = high_ma - low_ma
    lower = np.array([low_ma, low_ma + 0.3 * range_ma, -0.3 * range_ma, -1.0])
    upper = np.array([low_ma + 0.7 * range_ma, high_ma, 0.5 * range_ma, 5.0])
    scale = np.array([range_ma, range_ma, range_ma, 1.0])
    index = np.flatnonzero(free)

    def shape(p: FloatArray) -> FloatArray:
        full = held.copy()
        full[index] = p * scale[index]
        return full

    def residual(p: FloatArray) -> FloatArray:
        return _at(data, shape(p), free).residual_mps

    best = None
    for first in (0.05, 0.3, 0.55) if free[0] else (0.0,):
        for last in (0.7, 0.97) if free[1] else (1.0,):
            start = np.array([low_ma + first * range_ma, low_ma + last * range_ma, 0.02 * range_ma, 0.5])
            if not len(index):
                continue
            trial = optimize.least_squares(
                residual,
                (start / scale)[index],
                bounds=((lower / scale)[index], (upper / scale)[index]),
                diff_step=1e-4,  # of the range: less than a bin, more than where kinks make the loss rough
            )
            if best is None or trial.cost < best.cost:
                best = trial
    return _at(data, shape(best.x) if best is not None else held, free)


def _chosen(data: _Data, free: tuple[bool, bool, bool, bool], lag_s: float) -> _Fit:
    """Return the fit without the ends that it does not need: an F test for each, and two bins beyond it."""
    low_ma, range_ma = float(np.min(data.current_ma)), float(np.ptp(data.current_ma))
    held = np.array([low_ma, low_ma + 2.0 * range_ma, 0.0, lag_s])
    fit = _fitted(data, free, held)
    bin_ma = range_ma / BINS
    for end in (0, 1):
        tried = (end == 1 and fit.free[0], end == 0 and fit.free[1], *fit.free[2:])
        without = _fitted(data, tried, held)
        freedom = len(data.speed_mps) - 3 - sum(fit.free)
        ratio = (without.loss - fit.loss) / max(fit.loss / freedom, 1e-300)
        beyond_ma = fit.shape[0] - np.min(data.current_ma) if end == 0 else np.max(data.current_ma) - fit.shape[1]
        if stats.f.sf(ratio, 1, freedom) > SIGNIFICANT_P or beyond_ma < 2.0 * bin_ma:
            fit = without
    return fit


def _end(data: _Data, whole: _Fit, end: int) -> Estimate | None:
    """Return threshold (end 0) or saturation (1) from the bins near it alone, None where the whole fit has none.

    The middle of a real curve is no exact parabola, and would move an end that has to make up for it.
    """
    if not whole.free[end]:
        return None
    rises = np.sign(data.speed_mps[np.argmax(data.current_ma)] - data.speed_mps[np.argmin(data.current_ma)])
    height = (data.speed_mps if end == 0 else -data.speed_mps) * rises
    near = data.part(height - np.min(height) <= NEAR_END * np.ptp(height))
    held = whole.shape.copy()
    if end == 0:
        held[1] = held[0] + 2.0 * float(np.ptp(data.current_ma))
    fit = whole
    if len(near.speed_mps) >= FEWEST_BINS:
        fit = _fitted(near, (end == 0, end == 1, False, False), held)
    return _estimates(fit.shape, _standard_errors(near if fit is not whole else data, fit)[:4])[end]


def _estimates(values: FloatArray, std: FloatArray) -> list[Estimate]:
    return [Estimate(float(value), float(error)) for value, error in zip(values, std, strict=True)]


def _standard_errors(data: _Data, fit: _Fit) -> FloatArray:
    """Return the standard errors of threshold, saturation, width, lag and curve (7,); NaN for what was held."""
    range_ma = float(np.ptp(data.current_ma))
    free = np.flatnonzero([*fit.free, True, True, True])
    both = np.concatenate([fit.shape, fit.curve])
    steps = np.array([1e-3 * range_ma] * 3 + [1e-3] + [1.0, 1.0 / range_ma, 1.0 / range_ma**2])

    def predicted(p: FloatArray) -> FloatArray:
        return _predicted(_acting(data, p[:4]), p[4:])

    jacobian = np.column_stack(
        [(predicted(both + step) - predicted(both - step)) / 2.0 for step in (np.diag(steps)[k] for k in free)]
    )
    follows = data.ramp[1:] == data.ramp[:-1]
    e = fit.residual_mps
    energy = float(e @ e)
    rho = float(np.sum((e[1:] * e[:-1])[follows])) / energy if energy > 0.0 else 0.0
    inflation = (1.0 + max(rho, 0.0)) / (1.0 - min(max(rho, 0.0), 0.95))  # of a mean of first-order correlated errors
    variance = energy / max(len(e) - len(free), 1) * inflation
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    std = np.full(7, np.nan)
    std[free] = np.sqrt(np.diag(covariance)) * steps[free]
    return std


def _means(current_ma: FloatArray, speed_mps: FloatArray, edges_ma: FloatArray) -> FloatArray:
    bins = np.digitize(current_ma, edges_ma) - 1
    inside = (bins >= 0) & (bins < BINS)
    count = np.bincount(bins[inside], minlength=BINS)
    total = np.bincount(bins[inside], speed_mps[inside], minlength=BINS)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
