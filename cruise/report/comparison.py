"""A comparison of a model with measurements: everything that is asked of its errors, in figures and in words."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from cruise.recording import Recording, listed, notes_of
from cruise.report.plain import plain
from cruise.signals import SIGNALS
from cruise.validation.comparison import Comparison
from cruise.validation.failure_tree import FailureTree, failure_tree
from cruise.validation.noise_floor import Bound, NoiseFloor, causes_in, noise_floor
from cruise.validation.quantities import spoken
from cruise.validation.regimes import Regimes, Table, regimes
from cruise.validation.signatures import Signatures, signatures
from cruise.validation.worst_stretches import Stretch, worst_stretches

PROVENANCE: Final = re.compile(r"(?P<source>.+), (?P<start>\S+) to (?P<stop>\S+) s")
SAME_S: Final = 1.0  # s, by which the ends of one recording may differ at another period


@dataclass(frozen=True, eq=False)
class Findings:
    """All that there is to say of a comparison."""

    name: str  # of the model, as the user named it
    seen: tuple[str, ...]  # recordings that a model file was fitted to and is judged on
    comparison: Comparison
    floor: NoiseFloor
    regimes: Regimes
    tree: FailureTree
    stretches: tuple[Stretch, ...]
    signatures: Signatures

    @property
    def not_held_out(self) -> str:
        """What is to be said first where the model was fitted to what it is judged on; empty where it was not."""
        return f"it had been fitted to {', '.join(self.seen)}: what follows is not held out" if self.seen else ""


def seen(fitted_to: Sequence[str], recordings: Sequence[Recording]) -> tuple[str, ...]:
    """The recordings whose file name and time stand in a model's provenance ("monday/one.csv, 0 to 119.8 s")."""
    found = []
    for one in recordings:
        for told in filter(None, map(PROVENANCE.fullmatch, fitted_to)):
            apart_s = max(abs(float(told["start"]) - one.time_s[0]), abs(float(told["stop"]) - one.time_s[-1]))
            if Path(told["source"]).name == Path(one.source).name and apart_s < SAME_S:
                found.append(one.source)
                break
    return tuple(found)


def examined(name: str, fitted_to: Sequence[str], found: Comparison, show: Callable[[str], None]) -> Findings:
    """Ask everything of the errors of a comparison; `fitted_to` is the provenance of a model file."""
    show("looking for the noise floor")
    floor = noise_floor(found.native, found.recordings, found.ahead_mps, found.horizon)
    show("looking where it fails")
    return Findings(
        name=name,
        seen=seen(fitted_to, found.recordings),
        comparison=found,
        floor=floor,
        regimes=regimes(found.recordings, found.errors_mps, found.horizon),
        tree=failure_tree(found.recordings, found.errors_mps, found.horizon),
        stretches=worst_stretches(found.recordings, found.errors_mps),
        signatures=signatures(found),
    )


def report(found: Findings) -> dict[str, Any]:
    """All figures under stable names; what is no number is null, so that it is JSON."""
    compared, floor = found.comparison, found.floor
    heat_map = found.regimes.heat_map
    return plain(
        {
            "model": found.name,
            "structure": str(compared.structure),
            "how": compared.how,
            "fitted_to_some_of_these": list(found.seen),
            "recordings": [one.source for one in compared.recordings],
            "samples": sum(len(one) for one in compared.recordings),
            "period_s": compared.fitted.period_s,
            "notes": notes_of(compared.recordings),
            "horizon_s": compared.horizon_s,
            "input_filtered_for_validation": compared.smooth is not None,
            "ahead": asdict(compared.ahead),
            "free_run": asdict(compared.free_run),
            "persistence": asdict(compared.persistence),
            "noise_floor": {
                "white": floor.white and asdict(floor.white),
                "white_at_most_mps": floor.white_at_most_mps,
                "from_hz": floor.from_hz,
                "to_hz": floor.to_hz,
                "reached": floor.reached and asdict(floor.reached),
                "between_mps": floor.between_mps,
                "signals": list(causes_in(compared.recordings)),
            },
            "regimes": [
                {**asdict(one), "sentence": one.sentence, "bins": _bins(table)}
                for one, table in zip(found.regimes.regimes, found.regimes.tables, strict=True)
            ],
            "heat_map": heat_map
            and {
                "rows": heat_map.rows.key,
                "row_labels": heat_map.rows.labels,
                "columns": heat_map.columns.key,
                "column_labels": heat_map.columns.labels,
                "time_share": heat_map.time_share,
                "error_share": heat_map.error_share,
                "rmse_mps": heat_map.rmse_mps,
                "excess": heat_map.excess,
                "excess_low": heat_map.excess_low,
                "excess_high": heat_map.excess_high,
            },
            "tree": {
                "leaves": [{**asdict(leaf), "sentence": leaf.sentence} for leaf in found.tree.leaves],
                "explained": found.tree.explained,
                "offered": found.tree.shown,
            },
            "worst_stretches": [
                {**asdict(one), "source": compared.recordings[one.recording].source} for one in found.stretches
            ],
            "signatures": [{**asdict(one), "found": one.found} for one in found.signatures.tests],
            "standard_test": asdict(found.signatures.standard),
        }
    )


def _bins(table: Table) -> list[dict[str, Any]]:
    return [
        {
            "label": label,
            "time_share": float(table.time_share[i]),
            "error_share": float(table.error_share[i]),
            "rmse_mps": float(table.rmse_mps[i]),
            "mean_error_mps": float(table.mean_error_mps[i]),
        }
        for i, label in enumerate(table.labels)
    ]


def floor_in_words(floor: NoiseFloor, compared: Comparison) -> list[str]:
    """What was taken as the floor, on what assumption, and what could be gained."""
    said = []
    if floor.white is not None:
        white = floor.white
        said.append(
            f"No model errs by less than {_interval(white)} m/s: that much of the measured speed is white, judged by "
            f"its spectrum from {floor.from_hz:.2g} to {floor.to_hz:.2g} Hz, where the current explains nothing."
        )
    elif math.isfinite(floor.white_at_most_mps):
        said.append(
            "The spectrum of the speed does not end in white noise (the sensor filters, or the drive is as fast as "
            f"the samples): that is at most {floor.white_at_most_mps:.4f} m/s, and there is no floor from below."
        )
    if floor.reached is None:
        return [*said, "The recordings are too short for a floor from above."]
    aside = [name for name in compared.recordings[0].columns if name not in SIGNALS]
    names = ", ".join(("current", "speed", *(spoken(name)[0] for name in causes_in(compared.recordings))))
    said.append(
        f"{_interval(floor.reached)} m/s are reached {compared.horizon_s:g} s ahead by ridge regression and "
        f"gradient boosting over {names} and past errors, out of fold, or by the model itself."
    )
    if math.isfinite(floor.between_mps):
        said.append(
            f"Between the two lie {floor.between_mps:.4f} m/s of slow disturbance that nothing recorded announces, or "
            "of a dependence that boosting did not find."
        )
    if aside:
        it = "it" if len(aside) == 1 else "them"
        said.append(
            f"{listed(aside)}: left out, as nobody has said whether the drive moves {it}; diagnose looks at {it}."
        )
    gain = 1.0 - (floor.reached.value_mps / compared.ahead.rmse_mps) ** 2
    enough = floor.reached.high_mps < compared.ahead.rmse_mps
    said.append(
        f"So {100 * gain:.0f} % of the squared error of this model, at least, is not noise."
        if enough
        else f"So there is no sign that another model of {'those' if aside else 'these'} signals would be better."
    )
    return said


def _interval(bound: Bound) -> str:
    return f"{bound.value_mps:.4f} ({bound.low_mps:.4f} to {bound.high_mps:.4f})"
