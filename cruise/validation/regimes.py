"""In which regimes the squared error stands: its share against the share of time, quantity by quantity and in pairs.

    excess(R) = sum_(k in R) e_k^2 / sum_k e_k^2  -  |R| / N

e error in m/s, R a regime: neighbouring bins of one quantity, or all beside such a middle (steep either way), chosen
for the greatest excess. That choice finds an excess in noise too; how much, the same choice shows on errors shifted in
time against the quantities (circularly, so that both keep their own correlation), the greatest over all quantities
counting. A regime is named where its excess stands out of that and its interval (block bootstrap) does not hold zero.
Of the pairs, the one wins whose cells, chosen on every other block, hold most excess on the blocks between. Sources: J.
P. Romano, J. Amer. Stat. Assoc. 85 (1990) 686 (randomisation); P. H. Westfall, S. S. Young, Resampling-Based Multiple
Testing, 1993 (greatest of all); H. R. Kuensch, Annals of Statistics 17 (1989) 1217 (block bootstrap).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from cruise.recording import Recording
from cruise.validation.blocks import block_numbers, block_sums, drawn
from cruise.validation.quantities import ACCELERATION, BRAKING, RATE, TURNS, Quantity, quantities

BINS: Final = 6  # of a quantity, about: edges are round numbers
LEAST_TIME: Final = 0.03  # share: a bin with less goes to its neighbour
SHIFTS: Final = 199
LEVEL: Final = 0.05  # chance that noise is named anything
FEWEST_BLOCKS: Final = 6  # a regime met in fewer blocks of time is a coincidence
SEED: Final = 2


@dataclass(frozen=True, eq=False)
class Table:
    """One quantity: shares of time and of squared error, RMS and mean error in m/s of each of its bins (M,)."""

    key: str
    words: str
    unit: str
    labels: tuple[str, ...]
    time_share: np.ndarray
    error_share: np.ndarray
    rmse_mps: np.ndarray
    mean_error_mps: np.ndarray


@dataclass(frozen=True, slots=True)
class Regime:
    """Where one quantity concentrates the error, and whether that is more than noise does (`named`)."""

    key: str
    where: str  # in words
    time_share: float
    error_share: float
    error_share_low: float  # 95 %
    error_share_high: float
    mean_error_mps: float
    p_value: float  # corrected for the choice of bins and of the quantity
    named: bool

    @property
    def sentence(self) -> str:
        """As an engineer would say it."""
        return (
            f"{100 * self.error_share:.0f} % of the squared error stands in {100 * self.time_share:.0f} % of the time: "
            f"{self.where}"
        )


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Shares of time and squared error (rows, columns) over two quantities, and the excess that holds out of sample."""

    rows: Table
    columns: Table
    time_share: np.ndarray
    error_share: np.ndarray
    rmse_mps: np.ndarray  # NaN where nothing was driven
    excess: float
    excess_low: float  # 95 %
    excess_high: float
    cell: np.ndarray  # (N,) of every sample with an error: row * number of columns + column, -1 where not known


@dataclass(frozen=True, eq=False)
class Regimes:
    """Every quantity's table and regime, the greatest excess first, and the pair that concentrates the error most."""

    tables: tuple[Table, ...]
    regimes: tuple[Regime, ...]
    heat_map: HeatMap | None  # None where fewer than two quantities move

    @property
    def named(self) -> tuple[Regime, ...]:
        """Those that noise does not explain."""
        return tuple(one for one in self.regimes if one.named)


@dataclass(frozen=True, eq=False)
class _Binned:
    quantity: Quantity
    labels: tuple[str, ...]
    edges: tuple[float, ...]  # between bins; empty for states
    number: np.ndarray  # (N,) of the bin of each sample; `len(labels)` where not known


def regimes(recordings: Sequence[Recording], errors_mps: Sequence[np.ndarray], horizon: int) -> Regimes:
    """Sort the errors (N,) per recording by every quantity that moves; `horizon` in samples."""
    error = np.concatenate(errors_mps)
    known = np.isfinite(error)
    squared, error = error[known] ** 2, error[known]
    if not squared.sum() > 0.0:
        return Regimes((), (), None)
    blocks = block_numbers(recordings, horizon)[known]
    sorted_by = [_binned(one, known) for one in quantities(recordings)]
    sorted_by = [one for one in sorted_by if len(one.labels) > 1]
    if not sorted_by:
        return Regimes((), (), None)
    tables = [_table(one, error, squared) for one in sorted_by]
    chosen = [_best(t.error_share - t.time_share, bool(one.edges)) for one, t in zip(sorted_by, tables, strict=True)]
    p_values = _p_values(sorted_by, squared, [_excess(t, c) for t, c in zip(tables, chosen, strict=True)])
    found = [
        _regime(one, table, run, p_value, error, squared, blocks)
        for one, table, run, p_value in zip(sorted_by, tables, chosen, p_values, strict=True)
    ]
    order = sorted(range(len(found)), key=lambda i: found[i].time_share - found[i].error_share)
    pair = _pair(sorted_by, squared, blocks, {i for i, one in enumerate(found) if one.named})
    return Regimes(
        tables=tuple(tables[i] for i in order),
        regimes=tuple(found[i] for i in order),
        heat_map=_heat_map(pair, tables, sorted_by, squared, blocks) if pair else None,
    )


def round_edges(values: np.ndarray, bins: int = BINS) -> list[float]:
    """Round numbers, of the series 1, 2, 5, that cut the middle 98 % of `values` into about so many bins."""
    low, high = np.quantile(values, (0.01, 0.99))
    if not high > low:
        return []
    rough = (high - low) / bins
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= 0.999 * rough)
    edges = step * np.arange(math.floor(low / step) + 1, math.ceil(high / step))
    return [float(f"{edge:.6g}") for edge in edges]


def _binned(quantity: Quantity, known: np.ndarray) -> _Binned:
    values = quantity.values[known]
    measured = np.isfinite(values)
    if quantity.states:
        kept = [(value, words) for value, words in quantity.states if np.mean(values == value) >= LEAST_TIME]
        number = np.full(len(values), len(kept))
        for i, (value, _) in enumerate(kept):
            number[values == value] = i
        return _Binned(quantity, tuple(words for _, words in kept), (), number)
    edges = round_edges(values[measured]) if measured.any() else []
    least = LEAST_TIME * len(values)
    while edges:
        counts = np.bincount(np.digitize(values[measured], edges), minlength=len(edges) + 1)
        thin = int(np.argmin(counts))
        if counts[thin] >= least:
            break
        left = thin == len(edges) or (thin > 0 and counts[thin - 1] < counts[thin + 1])
        edges.pop(thin - 1 if left else thin)
    bounds = [None, *edges, None]
    labels = tuple(_label(low, high) for low, high in pairwise(bounds)) if edges else ()
    number = np.where(measured, np.digitize(values, edges), len(labels))
    return _Binned(quantity, labels, tuple(edges), number)


def _label(low: float | None, high: float | None) -> str:
    if low is None:
        return f"< {high:g}"
    return f"> {low:g}" if high is None else f"{low:g} to {high:g}"


def _table(one: _Binned, error: np.ndarray, squared: np.ndarray) -> Table:
    bins = len(one.labels)
    counts = np.bincount(one.number, minlength=bins + 1)[:bins]
    sums = np.bincount(one.number, squared, minlength=bins + 1)[:bins]
    means = np.bincount(one.number, error, minlength=bins + 1)[:bins]
    some = np.maximum(counts, 1)
    return Table(
        key=one.quantity.key,
        words=one.quantity.words,
        unit=one.quantity.unit,
        labels=one.labels,
        time_share=counts / len(error),
        error_share=sums / squared.sum(),
        rmse_mps=np.sqrt(sums / some),
        mean_error_mps=means / some,
    )


def _best(excess: np.ndarray, ordered: bool) -> tuple[int, int]:
    """First and one past the last bin of the neighbours (of states: the one) with the greatest excess, never all.

    Of ordered bins both ends may be it: then the first is that of the upper end, and beyond the last, of the lower.
    """
    gained = _gained(excess, ordered)
    first, last = np.unravel_index(int(np.argmax(gained)), gained.shape)
    return int(first), int(last)


def _gained(excess: np.ndarray, ordered: bool) -> np.ndarray:
    """The excess (M + 1, M + 1) of every run from a first bin to one before a last; below the diagonal of both ends."""
    sums = np.concatenate([[0.0], np.cumsum(excess)])
    first, last = np.indices((len(sums), len(sums)))
    both = ordered & (last > 0) & (last < first) & (first < len(excess))  # each end holds a bin
    possible = both | ((first < last) & (last - first < len(excess)))  # and not all of it
    return np.where(possible, sums[last] - sums[first] + both * sums[-1], -np.inf)


def _inside(number: np.ndarray, run: tuple[int, int], bins: int) -> np.ndarray:
    """Which samples, or bins, lie in the run, or in either end."""
    first, last = run
    known = number < bins
    return known & ((number >= first) & (number < last) if first < last else (number < last) | (number >= first))


def _excess(table: Table, run: tuple[int, int]) -> float:
    inside = _inside(np.arange(len(table.labels)), run, len(table.labels))
    return float(np.sum((table.error_share - table.time_share)[inside]))


def _p_values(sorted_by: Sequence[_Binned], squared: np.ndarray, excess: Sequence[float]) -> np.ndarray:
    """Chance (Q,) of so great an excess of any quantity when errors have nothing to do with it."""
    count = len(squared)
    rng = np.random.default_rng(SEED)
    shifts = rng.integers(1, count, SHIFTS) if count > 1 else np.zeros(0, int)
    null = np.empty((len(shifts), len(sorted_by)))
    times = [np.bincount(one.number, minlength=len(one.labels) + 1)[:-1] / count for one in sorted_by]
    total = squared.sum()
    for row, shift in zip(null, shifts, strict=True):
        rolled = np.roll(squared, shift)
        for i, (one, time) in enumerate(zip(sorted_by, times, strict=True)):
            share = np.bincount(one.number, rolled, minlength=len(one.labels) + 1)[:-1] / total
            row[i] = _gained(share - time, bool(one.edges)).max()
    spread = null.std(axis=0)
    scale = np.where(spread > 0.0, spread, 1.0)
    standard = (null - null.mean(axis=0)) / scale
    greatest = standard.max(axis=1)
    mine = (np.asarray(excess) - null.mean(axis=0)) / scale
    return (1.0 + np.sum(greatest[:, None] >= mine, axis=0)) / (1.0 + len(shifts))


def _regime(
    one: _Binned,
    table: Table,
    run: tuple[int, int],
    p_value: float,
    error: np.ndarray,
    squared: np.ndarray,
    blocks: np.ndarray,
) -> Regime:
    inside = _inside(one.number, run, len(one.labels))
    sums, counts = block_sums(np.column_stack([squared, squared * inside, inside.astype(float)]), blocks)
    weights = drawn(len(counts))
    error_share = (weights @ sums[:, 1]) / (weights @ sums[:, 0])
    time_share = (weights @ sums[:, 2]) / (weights @ counts)
    low, high = np.quantile(error_share, (0.025, 0.975))
    excess_low = float(np.quantile(error_share - time_share, 0.025))
    return Regime(
        key=one.quantity.key,
        where=_where(one, run),
        time_share=float(np.mean(inside)),
        error_share=float(squared[inside].sum() / squared.sum()),
        error_share_low=float(low),
        error_share_high=float(high),
        mean_error_mps=float(error[inside].mean()),
        p_value=float(p_value),
        named=p_value <= LEVEL and excess_low > 0.0 and int(np.sum(sums[:, 2] > 0.0)) >= FEWEST_BLOCKS,
    )


def _where(one: _Binned, run: tuple[int, int]) -> str:
    if not one.edges:
        return " or ".join(_state_words(one.quantity, label) for label in one.labels[slice(*run)])
    bounds, (first, last) = [None, *one.edges, None], run
    said = partial(in_words, one.quantity.key, one.quantity.words, one.quantity.unit)
    if first < last:
        return said(bounds[first], bounds[last])
    return f"{said(None, bounds[last])}, or {said(bounds[first], None)}"


def _state_words(quantity: Quantity, label: str) -> str:
    if quantity.key == TURNS:
        return f"current {label}"
    return f"speed {label}" if quantity.key == BRAKING and label == "steady" else label


def in_words(key: str, words: str, unit: str, low: float | None, high: float | None) -> str:
    """A range of a quantity as it is spoken of: "uphill above 2 deg", "current from 400 to 600 mA"."""
    unit = f" {unit}" if unit else ""
    if key == "pitch_deg" and low is not None and low >= 0.0:
        words = "uphill"
    if key == "pitch_deg" and high is not None and high <= 0.0:
        words, low, high = "downhill", None if high == 0.0 else -high, None if low is None else -low
        if low is None and high is None:
            return words
    if low is None and high is None:
        return f"any {words}"
    if low is None:
        return f"{words} below {high:g}{unit}"
    return f"{words} above {low:g}{unit}" if high is None else f"{words} from {low:g} to {high:g}{unit}"


def _pair(
    sorted_by: Sequence[_Binned], squared: np.ndarray, blocks: np.ndarray, named: set[int]
) -> tuple[int, int] | None:
    """The two quantities whose cells hold most excess out of sample, named ones (their places) before others."""
    pairs = [
        pair for pair in combinations(range(len(sorted_by)), 2) if not _same(*(sorted_by[i].quantity.key for i in pair))
    ]
    most = max((len(named.intersection(pair)) for pair in pairs), default=0)
    best, greatest = None, -np.inf
    for i, j in (pair for pair in pairs if len(named.intersection(pair)) == most):
        cell = _cells(sorted_by[i], sorted_by[j])
        outside = _out_of_sample(cell, squared, blocks)
        if outside is not None and outside.mean() > greatest:
            best, greatest = (i, j), float(outside.mean())
    return best


def _same(one: str, other: str) -> bool:
    """Whether one is the sign of the other."""
    return {one, other} in ({RATE, TURNS}, {ACCELERATION, BRAKING})


def _cells(rows: _Binned, columns: _Binned) -> np.ndarray:
    """The number of the cell of each sample, -1 where one of both is not known."""
    known = (rows.number < len(rows.labels)) & (columns.number < len(columns.labels))
    return np.where(known, rows.number * len(columns.labels) + columns.number, -1)


def _out_of_sample(cell: np.ndarray, squared: np.ndarray, blocks: np.ndarray) -> np.ndarray | None:
    """Per sample, what it adds to the excess (its mean) of the cells that the other half of the blocks chose."""
    odd = blocks % 2 == 1
    if not odd.any() or odd.all():
        return None
    inside = np.zeros(len(cell))
    for half in (odd, ~odd):
        size = int(cell.max()) + 2
        time = np.bincount(cell[half] + 1, minlength=size) / half.sum()
        error = np.bincount(cell[half] + 1, squared[half], minlength=size) / max(squared[half].sum(), 1e-300)
        chosen = (error > time) & (time >= 0.005)  # fewer samples say nothing
        chosen[0] = False
        inside[~half] = chosen[cell[~half] + 1]
    return inside * (squared / squared.mean() - 1.0)


def _heat_map(
    pair: tuple[int, int],
    tables: Sequence[Table],
    sorted_by: Sequence[_Binned],
    squared: np.ndarray,
    blocks: np.ndarray,
) -> HeatMap:
    rows, columns = (sorted_by[i] for i in pair)
    cell = _cells(rows, columns)
    shape = len(rows.labels), len(columns.labels)
    size = shape[0] * shape[1] + 1
    counts = np.bincount(cell + 1, minlength=size)[1:].reshape(shape)
    sums = np.bincount(cell + 1, squared, minlength=size)[1:].reshape(shape)
    outside = _out_of_sample(cell, squared, blocks)
    assert outside is not None
    block, number = block_sums(np.column_stack([outside * squared.mean(), squared]), blocks)
    weights = drawn(len(number))
    draws = (weights @ block[:, 0]) / (weights @ block[:, 1])
    low, high = np.quantile(draws, (0.025, 0.975))
    with np.errstate(invalid="ignore", divide="ignore"):
        rmse = np.where(counts > 0, np.sqrt(sums / counts), np.nan)
    return HeatMap(
        rows=tables[pair[0]],
        columns=tables[pair[1]],
        time_share=counts / len(squared),
        error_share=sums / squared.sum(),
        rmse_mps=rmse,
        excess=float(outside.mean()),
        excess_low=float(low),
        excess_high=float(high),
        cell=cell,
    )
