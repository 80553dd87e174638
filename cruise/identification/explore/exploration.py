"""All analyses of one or several recordings together, in words and as JSON."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cruise.identification.explore.cross_correlation import CrossCorrelation, cross_correlation
from cruise.identification.explore.excitation import Excitation, excitation
from cruise.identification.explore.frequency_response import FrequencyResponse, frequency_response
from cruise.identification.explore.pieces import NotPossible
from cruise.identification.explore.quality import Quality, quality
from cruise.identification.explore.ramps import ramps
from cruise.identification.explore.static_curve import StaticCurve, static_curve
from cruise.recording import Recording, RecordingError
from cruise.sampling import FloatArray

ONLY_RAMPS: Final = NotPossible(
    "slow ramps excite too little for dynamics: explore a recording of `cruise experiment white_noise` with them"
)
ANALYSES: Final = ("quality", "excitation", "frequency_response", "cross_correlation", "static_curve")


@dataclass(frozen=True, eq=False)
class Exploration:
    """What recordings say before any model is fitted; an analysis that they don't allow says why."""

    recordings: tuple[str, ...]
    samples: int
    duration_s: float
    period_s: float
    quality: Quality | NotPossible
    excitation: Excitation | NotPossible
    frequency_response: FrequencyResponse | NotPossible
    cross_correlation: CrossCorrelation | NotPossible
    static_curve: StaticCurve | NotPossible

    def words(self) -> dict[str, list[str]]:
        """Return the sentences by analysis."""
        return {name: getattr(self, name).words() for name in ANALYSES}

    def report(self) -> dict[str, Any]:
        """Return everything as JSON allows it; an analysis that is not possible holds only `not_possible`."""
        return {**_plain(self), "words": self.words()}


def explore(recordings: Sequence[Recording], raw_times_s: Sequence[FloatArray] = ()) -> Exploration:
    """Analyse recordings, one experiment each; raises RecordingError where there is none or their periods differ.

    Ramps give the static curve; response and correlation come from the recordings that are not mostly ramps, and so
    does the lag that the loop is corrected for: on ramps alone hysteresis would pass for lag.
    """
    if not recordings:
        raise RecordingError("no recording to explore: give one or more")
    dynamic = [recording for recording in recordings if not _mostly_ramps(recording)]
    correlation: CrossCorrelation | NotPossible = ONLY_RAMPS
    response: FrequencyResponse | NotPossible = ONLY_RAMPS
    if dynamic:
        correlation = cross_correlation(dynamic)
        align_s = 0.0
        if isinstance(correlation, CrossCorrelation) and correlation.delay_s is not None:
            align_s = correlation.peak_lag_s
        response = frequency_response(dynamic, align_s)
    lag_s = response.lag_s if isinstance(response, FrequencyResponse) else None
    if lag_s is not None and not math.isfinite(lag_s.value):
        lag_s = None
    return Exploration(
        recordings=tuple(recording.source for recording in recordings),
        samples=sum(len(recording) for recording in recordings),
        duration_s=sum(len(recording) * recording.dt_s for recording in recordings),
        period_s=recordings[0].dt_s,
        quality=quality(recordings, correlation, raw_times_s),
        excitation=excitation(recordings),
        frequency_response=response,
        cross_correlation=correlation,
        static_curve=static_curve(recordings, lag_s),
    )


def _mostly_ramps(recording: Recording) -> bool:
    lasting_s = sum(ramp.stop_s - ramp.start_s for ramp in ramps([recording]))
    return lasting_s > 0.5 * len(recording) * recording.dt_s


def _plain(value: Any) -> Any:
    if isinstance(value, NotPossible):
        return {"not_possible": value.reason}
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return [_plain(one) for one in value.tolist()]
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
