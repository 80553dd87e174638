"""The current as it was measured: what reshapes it happens at that rate, not at the period of the search."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.effects import Effect
from cruise.effects.low_pass import held_over
from cruise.recording import Recording

SAME_TIME: Final = 0.01  # of a period: time stamps that differ by less are one


class Raw:
    """The current of one recording at the rate of its measurement, held through holes, and its means over periods."""

    def __init__(self, fine: Recording, coarse: Recording) -> None:
        self.dt_s = fine.dt_s
        self.current_ma = _held(fine.input)
        edges_s = np.concatenate([[coarse.time_s[0] - coarse.dt_s], coarse.time_s])
        places = (edges_s - fine.since_s[0]) / fine.dt_s  # of the edges of the periods, in samples
        whole = np.round(places)
        self.places = np.where(np.abs(places - whole) < SAME_TIME, whole, places)
        counts = np.diff(self.places)
        even = (self.places == whole).all() and (counts == counts[0]).all() and self.places[-1] <= len(fine)
        self.each = int(counts[0]) if even and self.places[0] >= 0 else 0  # samples in every period
        self.same = len(fine) == len(coarse)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Means (N,) over each period of `values` that are each held until the next."""
        if self.same:
            return values
        if self.each:
            first, last = int(self.places[0]), int(self.places[-1])
            return values[first:last].reshape(-1, self.each) @ np.full(self.each, 1.0 / self.each)
        total = np.concatenate([[0.0], np.cumsum(values)])
        within = np.clip(self.places, 0.0, len(values))
        return np.diff(np.interp(within, np.arange(len(total)), total)) / np.maximum(np.diff(within), SAME_TIME)


def alike(raws: Sequence[Raw]) -> list[list[int]]:
    """The places of recordings that are filtered together: of one rate, and none twice as long as another."""
    found: dict[tuple[float, int], list[int]] = {}
    for i, raw in enumerate(raws):
        found.setdefault((raw.dt_s, len(raw.current_ma).bit_length()), []).append(i)
    return list(found.values())


class InTurn:
    """The currents of all recordings of one rate, one behind the other: many short ones take no longer than a long one.

    Between any two is a hole, behind which whatever reshapes a current begins anew.
    """

    def __init__(self, raws: Sequence[Raw], places: Sequence[int]) -> None:
        self.dt_s, self.places = raws[places[0]].dt_s, places
        counts = [len(raws[i].current_ma) for i in places]
        ends = np.cumsum(np.add(counts, 1)) - 1
        self._parts = [slice(end - count, end) for end, count in zip(ends.tolist(), counts, strict=True)]
        self._holes = ends[:-1]
        self.current_ma = np.full(ends[-1], np.nan)
        for i, part in zip(places, self._parts, strict=True):
            self.current_ma[part] = raws[i].current_ma

    def reshaped(self, effects: Sequence[Effect]) -> dict[int, np.ndarray]:
        """f(u) of every recording by its place."""
        value, still = self.current_ma, np.zeros(len(self.current_ma))
        for effect in effects:
            value = np.array(effect.over(value, still, {}, self.dt_s)[0])
            value[self._holes] = np.nan
        return {i: value[part] for i, part in zip(self.places, self._parts, strict=True)}


def in_turn(raws: Sequence[Raw]) -> list[InTurn]:
    """Recordings of one rate each."""
    found: dict[float, list[int]] = {}
    for i, raw in enumerate(raws):
        found.setdefault(raw.dt_s, []).append(i)
    return [InTurn(raws, places) for places in found.values()]


def rows(values: Sequence[np.ndarray]) -> np.ndarray:
    """Values (N_r,) of R recordings as rows (R, N) from their beginnings on; what is behind a shorter one is zero."""
    together = np.zeros((len(values), max(map(len, values))))
    for row, one in zip(together, values, strict=True):
        row[: len(one)] = one
    return together


def _held(values: np.ndarray) -> np.ndarray:
    """Values (N,) whose holes hold what was last known; those at first what is known first, zero where nothing is."""
    known = values[np.isfinite(values)]
    return np.nan_to_num(held_over(values), nan=known[0] if len(known) else 0.0)
