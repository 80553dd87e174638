"""Simulation of recordings by many explanations side by side, in segments that each start at a measured speed.

    y_k = pi_k [ a y_(k-1) + (1 - a)(K g_k w_k + l_k sum_m c_m phi_m,k + c_0) ] + (1 - pi_k) y_(k-1),   w = h * f(u)

Every segment starts `WARM_UP_S` before the first sample on which it is judged and ends `JUDGED_S` after it; the judged
parts of all segments tile what is recorded without a hole. None reaches over a hole: the next one starts behind it, so
that all explanations are judged on the same samples, however long they remember what the current was there. So every
error is that of a prediction at least 3 s ahead, no disturbance is dragged along for longer than a segment, and all
segments advance together as one array. What doesn't read the speed is computed ahead of the recursion, once for all
explanations that agree on it.
Loads that brakes hold are none where a machine stands held, as in `cruise.model.prediction`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cruise.effects import Effect, Stage
from cruise.effects.stroke import factor
from cruise.model.core import Core
from cruise.model.model import paces, stroke_pace, yields
from cruise.model.prediction import standing_held
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.explanation import Explanation
from cruise.validation.raw import Raw, alike, in_turn, rows
from cruise.validation.slope import PITCH, SLOPE, pitch_share, slope_deg

WARM_UP_S: Final = 3.0  # s, the paper's horizon: what a prediction at least has to reach, unless told otherwise
JUDGED_S: Final = 6.0  # s; longer costs more steps, shorter more starts; in proportion where the horizon is shorter
SETTLES_S: Final = 2.0  # s after a hole in the current until a drive has forgotten what it was; the same
RAN_AWAY_MPS: Final = 1e3  # m/s, a speed or an error beyond which no more is to be learned
CACHED_BYTES: Final = 24_000_000  # of what is kept; what was made first is forgotten first


def paced(span_s: float, horizon_s: float) -> float:
    """A span in s that suits the paper's horizon, as much shorter as a drive is quicker that is asked for less."""
    return span_s * min(horizon_s / WARM_UP_S, 1.0)


class Scene:
    """Recordings of one period, laid out for simulation. `judged` (N,) says which samples have an error.

    `raw` are the same recordings as they were measured, or None: what reshapes the current happens at their rate, for
    the mean of a reshaped current is not the reshaped mean.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        signals: Sequence[str],
        raw: Sequence[Recording] | None = None,
        horizon_s: float = WARM_UP_S,
    ) -> None:
        self.period_s, self.horizon_s = recordings[0].dt_s, horizon_s
        self.recordings = tuple(recordings)
        self.raw = [Raw(fine, one) for fine, one in zip(raw or recordings, recordings, strict=True)]
        self._alike, self._in_turn = alike(self.raw), in_turn(self.raw)
        self.speed_mps = np.concatenate([one.output for one in recordings])
        self.current_ma = np.concatenate([one.input for one in recordings])
        self.signals = {
            name: np.concatenate([one.output if name == OUTPUT else one.columns[name] for one in recordings])
            for name in signals
        }
        if PITCH in self.signals:
            self.signals[SLOPE] = np.concatenate([slope_deg(one, pitch_share(recordings)) for one in recordings])
        ends = np.cumsum([len(one) for one in recordings])
        self.parts = [slice(int(end) - len(one), int(end)) for end, one in zip(ends, recordings, strict=True)]
        self.held = np.concatenate([standing_held(one.input, one.output, self.period_s) for one in recordings])
        self._lay_out()
        self._cache: dict[Any, Any] = {}
        self._cached_bytes = 0

    def __len__(self) -> int:
        return len(self.speed_mps)

    def _lay_out(self) -> None:
        spans_s = self.horizon_s, paced(JUDGED_S, self.horizon_s)
        warm_up, judged = (max(round(span_s / self.period_s), 1) for span_s in spans_s)
        starts, stops = [], []
        for whole in self._whole():
            first = whole.start + 1
            while first + warm_up - 1 < whole.stop:
                starts.append(first)
                stops.append(min(first + warm_up + judged, whole.stop))
                first += judged
        self.steps = np.array(starts, int)[None, :] + np.arange(warm_up + judged)[:, None]  # (T, S)
        inside = self.steps < np.array(stops, int)[None, :]
        self.steps = np.minimum(self.steps, max(len(self) - 1, 0))
        self.shown = inside & (np.arange(warm_up + judged) >= warm_up - 1)[:, None]
        # The last warm-up sample is a prediction 3 s ahead already; the next segment begins to be judged where this
        # one ends, so one sample in each segment would be judged twice.
        self.shown[-1] = False
        self.judged = np.zeros(len(self), dtype=bool)
        self.judged[self.steps[self.shown]] = True
        self._place = np.zeros(len(self), dtype=int)  # among all steps, of the one that judges a sample
        self._place[self.steps[self.shown]] = np.flatnonzero(self.shown)
        past = self.speed_mps[self.steps[0] - 1] if len(starts) else np.zeros(0)
        self.start_mps = past

    def _whole(self) -> list[slice]:
        """The stretches of the recordings without a hole, none over two of them."""
        settles = round(paced(SETTLES_S, self.horizon_s) / self.period_s)
        found = []
        for part in self.parts:
            hole = np.isnan(self.current_ma[part])
            unsettled = np.convolve(hole, np.ones(settles + 1))[: len(hole)] > 0.5
            known = np.isfinite(self.speed_mps[part]) & ~unsettled
            edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]))) + part.start
            found += [slice(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]
        return found

    # -- what does not depend on the speed, computed once

    def _kept(self, key: Any, make: Any) -> Any:
        if key in self._cache:
            return self._cache[key]
        made = make()
        self._cache[key] = made
        self._cached_bytes += _bytes(made)
        while self._cached_bytes > CACHED_BYTES and len(self._cache) > 1:
            self._cached_bytes -= _bytes(self._cache.pop(next(iter(self._cache))))
        return made

    def over(self, effect: Effect, values: Any, key: Any) -> tuple[Any, Any]:
        """An effect over all recordings, (N,) and its state: begun anew in each."""

        def make() -> tuple[Any, Any]:
            results, states = [], []
            for part in self.parts:
                now = {name: column[part] for name, column in self.signals.items() if name in effect.uses}
                value = values[part] if isinstance(values, np.ndarray) else values
                past = self.speed_mps[part]
                result, state = effect.over(value, past, now, self.period_s)
                results.append(np.broadcast_to(result, len(past)))
                states.append(state)
            return np.concatenate(results), _joined(states)

        return self._kept((effect, key), make)

    def drive(self, effects: Sequence[Effect]) -> np.ndarray:
        """f(u) (N,) in mA."""

        def make() -> np.ndarray:
            parts = [raw.means(values) for raw, values in zip(self.raw, self._reshaped(effects), strict=True)]
            return np.concatenate(parts)

        return self._kept((tuple(effects), "drive"), make)

    def _reshaped(self, effects: Sequence[Effect]) -> list[np.ndarray]:
        """f(u) of every recording at the rate of its measurement."""

        def make() -> list[np.ndarray]:
            parts: dict[int, np.ndarray] = {}
            for one in self._in_turn:
                parts |= one.reshaped(effects)
            return [parts[i] for i in range(len(self.raw))]

        return self._kept((tuple(effects), "reshaped"), make)

    def felt(self, core: Core, effects: Sequence[Effect]) -> np.ndarray:
        """w (N,) in mA: means of what arrives at the vehicle, lagged and delayed at the rate of the measurement."""
        shape = replace(core, gain_mps_per_ma=0.0, time_constant_s=1.0, stroke_share=0.0)

        def make() -> np.ndarray:
            values, parts = self._reshaped(effects), {}
            for places in self._alike:
                dt_s = self.raw[places[0]].dt_s
                together = shape.felt(rows([values[i] for i in places]), dt_s)
                parts |= {i: self.raw[i].means(row[: len(values[i])]) for i, row in zip(places, together, strict=True)}
            return np.concatenate([parts[i] for i in range(len(self.raw))])

        return self._kept((shape, tuple(effects), "felt"), make)

    def _pace(self, effect: Effect, command: Sequence[Effect]) -> Any:
        driven = effect.stage is Stage.DYNAMICS
        state = self.over(effect, self.drive(command), (command, "paced"))[1] if driven else None
        return effect.pace(self.signals, state)

    # -- the recursion

    def simulate(self, batch: Sequence[Explanation]) -> np.ndarray:
        """Speeds (P, N) in m/s by P explanations with the same kinds of effects; NaN where nothing is judged."""
        first = batch[0]
        effects = first.effects
        chain = [i for i, effect in enumerate(effects) if effect.stage in (Stage.COMMAND, Stage.DYNAMICS)]
        reading = [i for i, effect in enumerate(effects) if effect.reads_speed]
        forced = np.empty((len(batch), len(self)))
        gained = np.empty_like(forced)  # K g w without the gains that read the speed
        paced: list[np.ndarray | None] = []
        yieldings: list[Any] = []
        for row, one in enumerate(batch):
            command = tuple(one.effects[i] for i in chain if one.effects[i].stage is Stage.COMMAND)
            felt = self.felt(one.core, command)
            pace = None
            for i in range(len(effects)):
                effect = one.effects[i]
                if paces(effect, one.core.stroke_share):
                    mine = self._kept((effect, command, "pace"), lambda e=effect, c=command: self._pace(e, c))
                    pace = mine if pace is None else pace * mine
            gain = one.core.gain_mps_per_ma * felt
            yielding: Any = 1.0
            if one.core.stroke_share:
                yielding = factor(one.core.stroke_share, gain)
                for effect in filter(yields, one.effects):
                    yielding = yielding * effect.yielding(self.signals)
                slowed = stroke_pace(one.core.pole(self.period_s), yielding)
                pace = slowed if pace is None else pace * slowed
            paced.append(pace)
            yieldings.append(yielding)
            load = np.full(len(self), one.offset_mps)
            place = 0
            for i in range(len(effects)):
                effect = one.effects[i]
                if effect.acts_as is Stage.GAIN and i not in reading:
                    gain = gain * self.over(effect, 1.0, "gain")[0]
                elif effect.acts_as is Stage.LOAD:
                    if i not in reading:
                        phi = self.over(effect, 0.0, "load")[0]
                        phi = np.where(self.held, 0.0, phi) if effect.brakes_hold else phi
                        load += one.loads[place] * yielding * phi
                    place += 1
            gained[row], forced[row] = gain, load
        poles = np.array([one.core.pole(self.period_s) for one in batch])[:, None]
        known = [np.broadcast_to(one, len(self)) for one in paced if one is not None]
        pace = np.array(known) if known else None
        yielding = np.array([np.broadcast_to(one, len(self)) for one in yieldings]) if first.core.stroke_share else None
        return self._recursion(batch, poles, gained, forced, pace, yielding, reading)

    def _recursion(
        self,
        batch: Sequence[Explanation],
        poles: np.ndarray,
        gained: np.ndarray,
        forced: np.ndarray,
        pace: np.ndarray | None,
        yielding: np.ndarray | None,
        reading: Sequence[int],
    ) -> np.ndarray:
        if not self.steps.size:
            return np.full((len(batch), len(self)), np.nan)
        effects = batch[0].effects
        places = {i: place for place, i in enumerate(batch[0].at(Stage.LOAD))}
        stacked = {i: _stacked([one.effects[i] for one in batch]) for i in reading}
        loads = {i: np.array([one.loads[places[i]] for one in batch])[:, None] for i in reading if i in places}
        needed = {name for i in reading for name in effects[i].uses}
        signals = {name: self.signals[name][self.steps] for name in needed if name in self.signals}
        speed = np.broadcast_to(self.start_mps, (len(batch), self.steps.shape[1]))
        memory = {i: stacked[i].start(np.zeros(speed.shape)) for i in reading}
        moved = None if pace is None else pace.take(self.steps, axis=1)
        forces = None if yielding is None or not loads else yielding.take(self.steps, axis=1)
        if reading:
            gains, speeds = gained.take(self.steps, axis=1), forced.take(self.steps, axis=1)  # (P, T, S)
        else:  # nothing reads the speed: one sum drives it
            gains, speeds = None, ((1.0 - poles) * (gained + forced)).take(self.steps, axis=1)
        for step in range(len(self.steps)):
            now_mps = speeds[:, step]  # what drives it; then, in its place, the speed
            if gains is not None:
                now = {name: column[step] for name, column in signals.items()}
                gain, load = gains[:, step], now_mps
                for i in reading:
                    if i in loads:
                        phi, memory[i] = stacked[i].step(0.0, speed, now, memory[i], self.period_s)
                        load = load + loads[i] * (phi if forces is None else forces[:, step] * phi)
                    else:
                        gain, memory[i] = stacked[i].step(gain, speed, now, memory[i], self.period_s)
                fresh = poles * speed + (1.0 - poles) * (gain + load)
                np.clip(fresh, -RAN_AWAY_MPS, RAN_AWAY_MPS, out=now_mps)  # further on there is no number any more
            else:
                now_mps += poles * speed
            if moved is not None:
                now_mps[:] = speed + moved[:, step] * (now_mps - speed)
            speed = now_mps
        result = speeds.reshape(len(batch), -1).take(self._place, axis=1)
        result[:, ~self.judged] = np.nan
        return result

    def errors(self, batch: Sequence[Explanation]) -> np.ndarray:
        """Measured minus simulated speed (P, N) in m/s, NaN where nothing is judged."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.speed_mps - self.simulate(batch)


def _stacked(effects: Sequence[Effect]) -> Effect:
    """One effect of P that step together: a shape parameter is a column (P, 1), or a number where all have the same."""
    first = effects[0]
    if all(effect == first for effect in effects):
        return first
    shape = {name: [getattr(effect, name) for effect in effects] for name in first.parameters}
    different = {name: values for name, values in shape.items() if values.count(values[0]) < len(values)}
    return first.reshaped(**{name: np.array(values)[:, None] for name, values in different.items()})


def _bytes(made: Any) -> int:
    """Size of arrays, however they are nested."""
    return sum(map(_bytes, made)) if isinstance(made, list | tuple) else getattr(made, "nbytes", 0)


def _joined(states: Sequence[Any]) -> Any:
    if states[0] is None:
        return None
    if isinstance(states[0], tuple):
        return tuple(np.concatenate(parts) for parts in zip(*states, strict=True))
    return np.concatenate(states)
