"""What many trials show, beside what is sought."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tools.benchmarks.figures import Figure

from .table import FAULTS
from .trial import ACCEL_MPS2, OVERSPEED_MPS, Outcome

LEAST_FAULTS, LEAST_TRIALS = 30, 3000


@dataclass(frozen=True)
class FaultScore:
    """All trials of one fault."""

    fault: str
    redundancy: str
    verdicts: Counter[str]
    how: Counter[str]  # what revealed it
    latest_s: float  # slowest exit
    overspeed_mps: float
    accel_mps2: float

    @classmethod
    def of(cls, fault: str, outcomes: Sequence[Outcome]) -> "FaultScore":
        """Counts and worst cases."""
        revealed = [one for one in outcomes if one.verdict in ("detected", "refused")]
        return cls(
            fault,
            FAULTS[fault].redundancy,
            Counter(one.verdict for one in outcomes),
            Counter(one.how for one in revealed),
            _worst(one.after_s for one in outcomes),
            _worst(one.overspeed_mps for one in outcomes),
            _worst(one.accel_mps2 for one in outcomes),
        )


def by_fault(outcomes: Sequence[Outcome]) -> list[FaultScore]:
    """One score a fault, in the order of the table."""
    return [FaultScore.of(name, found) for name in FAULTS if (found := [one for one in outcomes if one.fault == name])]


def figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Everything that is claimed of the faults."""
    count = Counter(one.verdict for one in outcomes)
    detected = [one for one in outcomes if one.verdict == "detected"]
    unrevealed = [one for one in outcomes if one.verdict == "harmless"]
    bounded = [one for one in outcomes if one.verdict == "bounded"]
    slowness = [round(one.silence_s / one.allowed_s, 6) for one in outcomes if math.isfinite(one.silence_s)]
    late = sum(one.overspeed_mps > OVERSPEED_MPS or one.accel_mps2 > ACCEL_MPS2 for one in detected)
    found = [
        Figure("faults", len({one.fault for one in outcomes}), "1", "faults", at_least=LEAST_FAULTS),
        Figure("trials", len(outcomes), "1", "trials", at_least=LEAST_TRIALS),
        Figure("silent", count["silent"], "1", "silent failures", 0.0),
        Figure("void", count["void"], "1", "exits before the fault came", 0.0),
        Figure("active_after", sum(one.active_after for one in outcomes), "1", "trials with a command after exit", 0.0),
        Figure("crashed", sum(one.crashed for one in outcomes), "1", "service ended by an exception", 0.0),
        Figure("detected", len(detected), "1", "detected"),
        Figure("refused", count["refused"], "1", "not engaged, because of the fault"),
        Figure("timeouts", len(slowness), "1", "time-outs that had to act"),
        Figure("timeout_slowness", _worst(slowness), "1", "slowest over 300 ms or 3 periods", 1.0),
        Figure("detected_late", late, "1", "detected only after more harm than is harmless"),
        *_harm("until detected", detected, None, None),
        *_harm("harmless by measure", unrevealed, OVERSPEED_MPS, ACCEL_MPS2),
        *_harm("no redundancy, within limits", bounded, None, ACCEL_MPS2),
    ]
    return [one for one in found if not math.isnan(one.value)]


def _harm(
    what: str, outcomes: Sequence[Outcome], overspeed_mps: float | None, accel_mps2: float | None
) -> list[Figure]:
    key = what.split(",")[0].replace(" ", "_")
    return [
        Figure(key, len(outcomes), "1", f"{what}: trials"),
        Figure(f"{key}_overspeed_mps", _worst(o.overspeed_mps for o in outcomes), "m/s", "overspeed", overspeed_mps),
        Figure(f"{key}_accel_mps2", _worst(o.accel_mps2 for o in outcomes), "m/s2", "acceleration", accel_mps2),
    ]


def _worst(values: Iterable[float]) -> float:
    return max((value for value in values if math.isfinite(value)), default=math.nan)
