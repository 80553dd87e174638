"""The residual against one signature per regressor: what would the error lose if the model had that term?

    e = G g + phi~ c + r ,    phi~_k = sum_(i<h) psi_i phi_(k-i) ,    A psi = 1

e (N,) residual h samples ahead in m/s; phi the regressor, entering where a term of the model would (current after the
delay, everything else now) and carried through the model's poles over the horizon, as the missing term was; G (N, n)
how the prediction answers to the model's own parameters, shapes among them. c is tested after G is projected out: what
the model would absorb itself counts for nothing. The test takes blocks longer than errors are correlated one by one,

    t = c sum_k phi~_k^2 / sqrt((B - 1) / B sum_j (R_j / (1 - h_j))^2) ,    t(B - 1),

R_j the sum of phi~ r over block j, h_j its share of the sum of phi~^2 (the jackknife over blocks), which holds for
coloured residuals and for regressors that hardly move within a block. The speed in y, y u and others is the model's own
in free run: the measured one holds the noise of the residual. The standard test, the cross-correlation of residual and
current over lags with nothing projected out, stands beside it. Sources: L. Ljung, System Identification, 2nd ed. 1999,
section 16.6; C. B. Hansen, J. Econometrics 141 (2007) 597 (t(B - 1) of block sums); A. C. Cameron, D. L. Miller, J.
Human Resources 50 (2015) 317 (jackknife over blocks); S. Holm, Scandinavian J. Statistics 6 (1979) 65 (correction for
the number of tests).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import signal, stats

from cruise.identification.families import Identified, Linear
from cruise.identification.identify import validation_filter
from cruise.identification.narx import Narx
from cruise.identification.structures import Family
from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.blocks import block_numbers, block_sums
from cruise.validation.comparison import Comparison, fitted_core
from cruise.validation.quantities import spoken

STEP: Final = 1e-4  # relative, of a parameter in a difference quotient: predictions are smooth in it
SAME: Final = 1e-3  # of a regressor's size; what is left beside the model's own regressors is less: it has that term
FLAT: Final = 1e-9  # of a regressor, about which it does not move but for rounding
LEVEL: Final = 0.05
STANDARD_LAGS_S: Final = 5.0  # s, over which the standard test looks, as 25 lags at 5 Hz do
BLOCKS: Final = 24  # of the test at most: each holds many correlation times, and t(23) is nearly normal
FEWEST_BLOCKS: Final = 6
GREATEST_SHARE: Final = 0.95  # of what is known of c, that one block may hold
KINKED: Final = 0.02  # share of samples of the other sign, from which |u| is not u


@dataclass(frozen=True, slots=True)
class Signature:
    """The test of one regressor. `share` of the squared error would go with it, as far as this data tells."""

    regressor: str
    correlation: float  # partial, with sign: + where more of it goes with a speed above the prediction
    share: float  # its square
    t: float
    p_value: float  # of this test alone
    p_corrected: float  # for the number of tests
    refused: str = ""  # why there is no test, such as "the model has this term"

    @property
    def found(self) -> bool:
        """Whether the residual depends on it beyond chance."""
        return self.p_corrected <= LEVEL


@dataclass(frozen=True, slots=True)
class Signatures:
    """All regressors, the most telling first, and the standard test of residual against current."""

    tests: tuple[Signature, ...]
    standard: Signature


def signatures(found: Comparison) -> Signatures:
    """Test the residual of the fitted model, `horizon_s` ahead, against every regressor of the list.

    Of the one fit to all recordings where it was fitted here: held-out residuals are of several fits, whose parameters
    differ, and that can't be projected out.
    """
    residual = _residual(found)
    known = np.isfinite(residual)
    error = residual[known]
    blocks = _long_blocks(found.recordings, found.horizon)
    offered, carry = regressors(found), _carrier(found)
    carried = {name: np.concatenate([carry(part) for part in parts])[known] for name, parts in offered.items()}
    own = _answers(found)[known]
    own = np.column_stack([own, np.ones(len(own))])
    usable = np.asarray(np.isfinite(own).all(axis=1))
    own[~usable] = 0.0
    basis = _basis(own[:, np.ptp(own, axis=0) + np.abs(own).max(axis=0) > 0.0])
    projected = error - basis @ (basis.T @ error)
    tests = _corrected(
        [
            _test(
                name, phi, [carried[part] for part in _factor(name, carried)], projected, basis, usable, blocks[known]
            )
            for name, phi in carried.items()
        ]
    )
    tests.sort(key=lambda one: (bool(one.refused), not one.found, -one.share))
    return Signatures(tuple(tests), _standard(found, residual))


def _residual(found: Comparison) -> np.ndarray:
    """Measured minus predicted by the one fitted model (N,), all recordings one after the other."""
    ahead = (found.fitted.ahead(one, found.horizon, found.smooth) for one in found.recordings)
    return np.concatenate([one.output - speed for one, speed in zip(found.recordings, ahead, strict=True)])


def regressors(found: Comparison) -> Mapping[str, Sequence[np.ndarray]]:
    """The list: name to values (N,) per recording. A signal is taken about its mean, which c_0 or the gain has;

    what it multiplies is not: a gain that follows the signal acts on the whole current and the whole speed.
    """
    recordings = found.recordings
    core = fitted_core(found.fitted)
    delay = core.delay + (max(core.nb, 1) - 1) // 2
    u = [lagged(one.input, delay) for one in recordings]
    middle, size = _centre(u)
    size = size or 1.0  # what never moves stays as it is, and is tested against nothing
    u = [(part - middle) / size for part in u]
    zero = -middle / size
    y = [lagged(one, 1) for one in _own_speeds(found)]
    slowest, span = _centre(y)
    span = span or 1.0
    y = [(part - slowest) / span for part in y]
    result: dict[str, Sequence[np.ndarray]] = {"u": u, "u²": [part**2 for part in u], "u³": [part**3 for part in u]}
    joined = np.concatenate(u)
    joined = joined[np.isfinite(joined)]
    if min(np.mean(joined > zero), np.mean(joined < zero)) > KINKED:
        result["|u|"] = [np.abs(part - zero) for part in u]
    result["sign of du/dt"] = [_last_turn(part) for part in u]
    result["y"] = y
    result["y²"] = [part**2 for part in y]
    result["y u"] = [a * b for a, b in zip(y, u, strict=True)]
    moving = np.concatenate(y) + slowest / span
    moving = moving[np.isfinite(moving)]
    if min(np.mean(moving > 0.0), np.mean(moving < 0.0)) > KINKED:
        result["sign of y"] = [np.sign(part + slowest / span) for part in y]
    for name in dict.fromkeys(name for one in recordings for name in one.columns):
        if name in (INPUT, OUTPUT):
            continue
        s = [one.columns.get(name, np.full(len(one), np.nan)) for one in recordings]
        mean, spread = _centre(s)
        if not spread > 0.0:
            continue
        s = [(part - mean) / spread for part in s]
        words, _ = spoken(name)
        result[words] = s
        result[f"{words} u"] = [a * (b - zero) for a, b in zip(s, u, strict=True)]
        result[f"{words} y"] = [a * (b + slowest / span) for a, b in zip(s, y, strict=True)]
    times = [one.time_s - one.time_s[0] for one in recordings]
    mean, spread = _centre(times)
    result["time"] = [(part - mean) / spread for part in times]
    return result


def _own_speeds(found: Comparison) -> list[np.ndarray]:
    """The model's own speeds, the measured one where it has none (before its first sample)."""
    return [
        np.where(np.isfinite(own := found.fitted.free_run(one, found.smooth)), own, one.output)
        for one in found.recordings
    ]


def _centre(parts: Sequence[np.ndarray]) -> tuple[float, float]:
    joined = np.concatenate(parts)
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        return 0.0, 0.0
    spread = float(joined.std())
    return float(joined.mean()), spread if spread > 1e-9 * float(np.abs(joined).max()) else 0.0


def _last_turn(values: np.ndarray) -> np.ndarray:
    """Sign (N,) of the last change, held while nothing changes: what a hysteresis remembers."""
    change = np.sign(np.diff(values, prepend=np.nan))
    last = np.maximum.accumulate(np.where(np.isfinite(change) & (change != 0.0), np.arange(len(values)), -1))
    return np.where(np.isfinite(values) & (last >= 0), change[np.maximum(last, 0)], np.nan)


def _carrier(found: Comparison) -> Callable[[np.ndarray], np.ndarray]:
    """What the prediction does to a term: 1 / A over the horizon, over all time for a predictor that sees no speed."""
    denominator = np.real(np.poly(found.fitted.poles)) if len(found.fitted.poles) else np.ones(1)
    length = found.horizon if found.structure.family is not Family.OUTPUT_ERROR else 50 * found.horizon
    impulse = np.asarray(signal.lfilter([1.0], denominator, np.eye(1, length)[0]))

    def carry(values: np.ndarray) -> np.ndarray:
        known = np.isfinite(values)
        carried = np.asarray(signal.lfilter(impulse, [1.0], np.where(known, values, 0.0)))
        holes = np.asarray(signal.lfilter(np.ones(min(found.horizon, length)), [1.0], (~known).astype(float))) > 0.5
        return np.where(holes, np.nan, carried)

    return carry


def _answers(found: Comparison) -> np.ndarray:
    """How the prediction answers to each parameter of the model, linear and shape: columns (N, n), by differences."""
    smooth = found.smooth

    def ahead(fitted: Identified) -> np.ndarray:
        return np.concatenate([fitted.ahead(one, found.horizon, smooth) for one in found.recordings])

    base = ahead(found.fitted)
    columns = [ahead(other) - base for other in _neighbours(found)]
    return np.column_stack(columns) if columns else np.empty((len(base), 0))


def _neighbours(found: Comparison) -> list[Identified]:
    """The model with one parameter after the other moved by a little."""
    fitted = found.fitted
    if isinstance(fitted, Narx):
        return [replace(fitted, theta=theta) for theta in _moved(fitted.theta)]
    assert isinstance(fitted, Linear)
    model = fitted.model
    result: list[Identified] = [replace(fitted, model=model.with_theta(theta)) for theta in _moved(model.theta)]
    for i, effect in enumerate(model.effects):
        for name, bound in effect.parameters.items():
            step = 1e-3 * (bound.high - bound.low)
            value = float(getattr(effect, name))
            other = effect.reshaped(**{name: value + step if value + step <= bound.high else value - step})
            effects = (*model.effects[:i], other, *model.effects[i + 1 :])
            result.append(replace(fitted, model=replace(model, effects=effects)))
    filtered = found.smooth is not None
    return [one for one in result if not filtered or validation_filter(fitted_core(one), found.smooth)]


def _moved(theta: Sequence[float]) -> list[tuple[float, ...]]:
    steps = [STEP * abs(value) or STEP * 1e-3 for value in theta]
    return [tuple(value + steps[i] * (i == k) for i, value in enumerate(theta)) for k in range(len(theta))]


def _basis(columns: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the columns (N, n); directions that only rounding makes are left out."""
    size = np.linalg.norm(columns, axis=0)
    u, values, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return u[:, values > 1e-6 * values[0]]


def _long_blocks(recordings: Sequence[Recording], horizon: int) -> np.ndarray:
    """Blocks (N,) of all recordings: those of the bootstrap, neighbours joined until at most `BLOCKS` are left."""
    blocks = block_numbers(recordings, horizon)
    count = int(blocks[-1]) + 1
    return blocks * min(count, BLOCKS) // count


def _factor(name: str, offered: Collection[str]) -> list[str]:
    """The current or the speed of a regressor that is a product with it; none for one that is no product."""
    *first, last = name.split(" ")
    return [last] if last in ("u", "y") and " ".join(first) in offered else []


def _test(
    name: str,
    phi: np.ndarray,
    factors: Sequence[np.ndarray],
    error: np.ndarray,
    basis: np.ndarray,
    usable: np.ndarray,
    blocks: np.ndarray,
) -> Signature:
    """`factors` (N,), the current or the speed in a product, are projected out too."""
    known = np.isfinite(phi) & usable
    if not known.any():
        return _refused(name, "not measured")
    size = float(np.linalg.norm(phi[known] - phi[known].mean()))
    if not size > FLAT * float(np.linalg.norm(phi[known])):
        return _refused(name, "it never moves")
    extra, length = np.zeros((len(phi), 0)), 0.0
    for column in (*factors, phi):
        column = np.where(known, column, 0.0)
        for _ in range(2):  # again: rounding
            column = column - basis @ (basis.T @ column) - extra @ (extra.T @ column)
        length = float(np.linalg.norm(column))
        if length > SAME * size:
            extra = np.column_stack([extra, column / length])
    if not length > SAME * size:
        return _refused(name, "the model has this term")
    rest, phi = error - extra[:, :-1] @ (extra[:, :-1].T @ error), extra[:, -1]
    return _by_blocks(name, phi, np.where(known, rest, 0.0), blocks)


def _by_blocks(name: str, phi: np.ndarray, error: np.ndarray, blocks: np.ndarray) -> Signature:
    correlation = float(phi @ error / np.sqrt((phi @ phi) * (error @ error)))
    coefficient = float(phi @ error / (phi @ phi))
    sums, _ = block_sums(np.column_stack([phi * error, phi * phi]), blocks)
    count = len(sums)
    if count < FEWEST_BLOCKS:
        return _refused(name, "too few blocks of time")
    share = np.minimum(sums[:, 1] / sums[:, 1].sum(), GREATEST_SHARE)  # a block that decides c alone hides its noise
    rest = (sums[:, 0] - coefficient * sums[:, 1]) / (1.0 - share)
    spread = np.sqrt((count - 1) / count * np.sum(rest**2))
    t = float(sums[:, 0].sum() / spread) if spread > 0.0 else 0.0
    p_value = float(2.0 * stats.t.sf(abs(t), count - 1))
    return Signature(name, correlation, correlation**2, t, p_value, p_value)


def _refused(name: str, reason: str) -> Signature:
    return Signature(name, np.nan, 0.0, np.nan, np.nan, np.nan, reason)


def _corrected(tests: Sequence[Signature]) -> list[Signature]:
    """Holm: the i-th smallest of n p-values times n - i, never falling."""
    order = sorted((i for i, one in enumerate(tests) if not one.refused), key=lambda i: tests[i].p_value)
    result, least = list(tests), 0.0
    for rank, i in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * tests[i].p_value))
        result[i] = replace(tests[i], p_corrected=least)
    return result


def _standard(found: Comparison, residual: np.ndarray) -> Signature:
    """Residual against the current as it is, at the lag where they go together most; corrected for the lags."""
    lags = range(round(STANDARD_LAGS_S / found.fitted.period_s) + 1)
    blocks = _long_blocks(found.recordings, found.horizon)
    best = _refused("u, as it is", "too short")
    for lag in lags:
        u = np.concatenate([lagged(one.input, lag) for one in found.recordings])
        known = np.isfinite(u) & np.isfinite(residual)
        if not known.any() or not np.ptp(u[known]) > 0.0:
            continue
        one = _by_blocks(
            "u, as it is", u[known] - u[known].mean(), residual[known] - residual[known].mean(), blocks[known]
        )
        if not one.refused and (best.refused or one.p_value < best.p_value):
            best = one
    return best if best.refused else replace(best, p_corrected=min(1.0, len(lags) * best.p_value))
