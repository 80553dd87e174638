"""Recorded drives through the very same service: put on the bus as frames, sampled, learned from, judged on others.

A log of the bus is played as it is. A table of columns becomes the frames that a machine with these signals would send.
Nothing here learns or predicts by itself: the node does.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.messages import FAST_MESSAGE
from cruise.estimation.gate import Gate
from cruise.identification.least_squares import fit
from cruise.identification.shapes import ahead_rms_mps
from cruise.recording import Recording, RecordingError, too_slow
from cruise.service.combine_node import MESSAGES
from cruise.service.cruise_node import CruiseNode
from cruise.service.recordings import ReadingSettings, Told, frames_of_log, is_log, read_recordings
from cruise.service.settings import CruiseSettings
from cruise.signals import CONTEXT, INPUT, OUTPUT, SIGNALS, Sample

PAUSE_S: Final = 5.0  # s of silence between two files: longer than any signal stays fresh, so that nothing is joined
FAR: Final = 0.05  # of a signal's range: what is nearer to it is a sensor's noise or offset at its end
LEAD_S: Final = 0.01  # s, first frame after the start of its file


@dataclass(frozen=True, slots=True)
class Replayed:
    """The node that learned, each file as it sampled it, and how many samples were of which gate."""

    node: CruiseNode
    recordings: tuple[Recording, ...]
    gates: Mapping[Gate, int]

    @property
    def learned(self) -> bool:
        """Whether any sample taught: the parameters are those of the start else."""
        return self.gates.get(Gate.OPEN, 0) > 0

    @property
    def gate_share(self) -> dict[str, float]:
        """The share of the samples by gate, the commonest first."""
        samples = sum(self.gates.values())
        return {str(gate): count / samples for gate, count in Counter(self.gates).most_common()}


@dataclass(frozen=True, slots=True)
class Judged:
    """3 s ahead errors in m/s on recordings that taught nothing."""

    online_mps: float
    batch_mps: float
    factory_mps: float
    persistence_mps: float
    horizon_s: float
    samples: int


def replay(
    paths: Sequence[str | Path],
    settings: CruiseSettings,
    columns: ReadingSettings,
    told: Told | None = None,
) -> Replayed:
    """Play every file, one after the other, to one node; `told` as in `read_recordings`.

    Tables are counted from where the model is; what was sent on a bus, from 0.
    """
    tables = [path for path in paths if not is_log(path, columns)]
    node = CruiseNode.load(settings, told.rest_ma if told is not None and len(tables) == len(paths) else 0.0)
    node.plausibility = None  # what a log holds was commanded by another run than this one
    model = node.estimator.factory
    sender = Codec.load(settings.database, settings.can)
    recordings, start_s, gates = [], 0.0, Counter[Gate]()
    read = dict(zip(tables, read_recordings(tables, columns, told=told), strict=True))
    for path, table in read.items():
        _check_rate(path, table, model.period_s)
    for path in paths:
        frames, notes = _frames_of(path, read.get(path), sender)
        samples = list(_play(frames, node, start_s, gates))
        if not any(math.isfinite(sample.speed_mps) for sample in samples):
            raise RecordingError(
                f"{path}: holds no frame of {FAST_MESSAGE} that could be taken; "
                f"frame faults: {dict(node.hearing.faults)}; check the addresses and PGNs in the settings"
            )
        recording = _recording(samples, model.period_s, Path(path).name, tuple(notes))
        if path in read:
            table = read[path]
            recording = replace(recording, input_unit=table.input_unit, input_rest_ma=table.input_rest_ma)
        absent = model.missing(recording.columns)
        if absent:
            raise RecordingError(
                f"{path}: the model needs {', '.join(absent)}, which it does not hold; "
                "give a model file without the effects that need them (--model FILE)"
            )
        recordings.append(recording)
        start_s = node.ticks * node.period_s + PAUSE_S
        while node.ticks * node.period_s < start_s:
            node.tick((node.ticks + 1) * node.period_s)
    return Replayed(node, tuple(recordings), gates)


def _check_rate(path: str | Path, table: Recording, period_s: float) -> None:
    """RecordingError where a table has no row for each period of the model: it would teach nothing."""
    slow = too_slow(table.dt_s, period_s)
    if slow:
        raise RecordingError(
            f"{path} is {slow}: record faster, or give a model of {table.dt_s:g} s or more (--model FILE, from cruise "
            f"identify --period {table.dt_s:g})"
        )


def _frames_of(path: str | Path, table: Recording | None, sender: Codec) -> tuple[Iterator[Frame], list[str]]:
    """The frames of a file, times from zero: those of a log as they are, those of a table as a machine would send them.

    Beside them what was lost or mended, whole once the frames have been taken.
    """
    notes: list[str] = []
    if table is None:
        return frames_of_log(path, notes), notes
    notes += table.notes
    return _frames_of_table(_sendable(table, notes), sender), notes


def judge(taught: Replayed, unseen: Sequence[Recording], horizon_s: float = 3.0) -> Judged:
    """The online model beside batch least squares on the same samples, the factory model and persistence."""
    factory = taught.node.estimator.factory
    horizon = max(round(horizon_s / factory.period_s), 1)
    changes = [one.output[horizon:] - one.output[:-horizon] for one in unseen if len(one) > horizon]
    held = np.concatenate([np.zeros(0), *changes])
    held = held[np.isfinite(held)]
    if not held.size:
        seconds = sum(len(one) for one in unseen) * factory.period_s
        raise RecordingError(f"--test: {seconds:.1f} s are too short to judge {horizon_s:g} s ahead; drive a minute")
    return Judged(
        online_mps=ahead_rms_mps(taught.node.estimator.snapshot(), unseen, horizon_s),
        batch_mps=ahead_rms_mps(fit(factory, taught.recordings), unseen, horizon_s),
        factory_mps=ahead_rms_mps(factory, unseen, horizon_s),
        persistence_mps=float(np.sqrt(np.mean(held**2))),
        horizon_s=horizon_s,
        samples=len(held),
    )


def _play(frames: Iterable[Frame], node: CruiseNode, start_s: float, gates: Counter[Gate]) -> Iterator[Sample]:
    """Hand the frames to the node in time, give every sample that it takes, and count its gate."""
    for frame in frames:
        frame.timestamp += start_s
        # A frame counts for the tick at whose instant it is there, as it does on a bus.
        while (node.ticks + 1) * node.period_s < frame.timestamp - 1e-6:
            before = node.sample
            node.tick((node.ticks + 1) * node.period_s)
            if node.sample is not None and node.sample is not before:
                gates[node.learned.gate] += 1
                yield node.sample
        node.receive(frame)


def _sendable(recording: Recording, notes: list[str]) -> Recording:
    """The recording with what a controller would send: the nearest value there is, or none where that is far away."""
    columns = dict(recording.columns)
    for name in columns.keys() & SIGNALS.keys():
        low, high = SIGNALS[name].low, SIGNALS[name].high
        nearest = np.clip(columns[name], low, high)
        away = np.abs(columns[name] - nearest)
        if not (away > 0.0).any():
            continue
        columns[name] = np.where(away > FAR * (high - low), np.nan, nearest)
        notes.append(
            f"{name}: {int((away > 0.0).sum())} values are not within {low:g} to {high:g}; sent as the nearest that "
            f"is, those far away (more than {100 * FAR:g} % of it) as not available"
        )
    return replace(recording, columns=columns)


def _frames_of_table(recording: Recording, sender: Codec) -> Iterator[Frame]:
    context = recording.context()
    for k in range(len(recording)):
        time_s = k * recording.dt_s + LEAD_S
        fast = {INPUT: float(recording.input[k]), OUTPUT: float(recording.output[k])}
        yield sender.encode(FAST_MESSAGE, fast, time_s)
        for outgoing in MESSAGES:
            values = {name: float(context[name][k]) for name, _ in outgoing.signals if name in context}
            if values and not {INPUT, OUTPUT} & set(values):
                yield sender.encode(outgoing.message, values, time_s)


def _recording(samples: Sequence[Sample], period_s: float, source: str, notes: tuple[str, ...]) -> Recording:
    names = [name for name in CONTEXT if any(math.isfinite(sample.signals[name]) for sample in samples)]
    columns = {name: np.array([sample.signals[name] for sample in samples]) for name in names}
    columns[INPUT] = np.array([sample.current_ma for sample in samples])
    columns[OUTPUT] = np.array([sample.speed_mps for sample in samples])
    return Recording(period_s * np.arange(1, len(samples) + 1), columns, period_s, source, notes, averaged=True)
