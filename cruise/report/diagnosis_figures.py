"""A diagnosis in figures, under stable names: what `cruise diagnose --json` prints."""

import math
from typing import Any, Final

from cruise.recording import notes_of
from cruise.report import evidence
from cruise.report.curve import curve
from cruise.report.evidence import Number
from cruise.report.plain import plain
from cruise.validation.candidates import UNNAMED
from cruise.validation.diagnose import SEED, Diagnosis
from cruise.validation.numbers import numbers
from cruise.validation.tried import tried_in

CURVE_SHOWN: Final = 9  # points of a curve


def report(found: Diagnosis, model: str, structure: str) -> dict[str, Any]:
    """The verdict as the design has it, then what it rests on; what is no number is null, so that it is JSON."""
    final, base = found.final, found.base
    fitted = numbers(found.study, final)
    return {
        "verdict": found.verdict.value,
        "effects": list(found.effects),
        "signals": list(found.signals),
        "ranking": [
            {
                "effect": one.effect,
                "error_before_mps": plain(one.error_before_mps),
                "error_after_mps": plain(one.error_after_mps),
                "confidence": plain(one.confidence),
            }
            for one in found.ranking
        ],
        "look_alikes": [list(alike) for alike in found.look_alikes],
        "next_experiment": found.next_experiment,
        "confidence": plain(found.confidence),
        "beside": found.beside or None,
        "error_before_mps": plain(evidence.error_mps(base)),
        "error_after_mps": plain(evidence.error_mps(final)),
        "foretold": {
            "share": plain(found.left.hidden.share),
            "error_mps": plain(math.sqrt(found.left.hidden.loss)),
            "signals": list(found.left.hidden.signals),
        },
        "horizon_s": found.study.horizon_s,
        "model": model,
        "structure": structure,
        "recordings": [one.source for one in found.study.recordings],
        "samples": sum(len(one) for one in found.study.recordings),
        "judged_samples": int(found.study.search.scene.judged.sum()),
        "period_s": found.study.period_s,
        "notes": notes_of(found.study.recordings),
        "refused": [{"effect": one.effect, "reason": one.reason} for one in found.refused],
        "parameters": {
            name: [_figures(one) for one in evidence.numbers_of(name, fitted)]
            for name in evidence.members(final.explanation)
            if name not in evidence.members(base.explanation) and not name.startswith(UNNAMED)
        },
        "dead_time_s": {"model": found.study.delay_s, "found": plain(final.explanation.core.delay_s)},
        "dead_time_changes": found.left.dead_time
        and {
            "early_s": plain(found.left.dead_time.early_s),
            "late_s": plain(found.left.dead_time.late_s),
            "share": plain(found.left.dead_time.share),
            "signal": found.left.dead_time.signal or None,
        },
        "swing_s": plain(found.left.swing_s),
        "worth_adding": list(found.worth_adding),
        "moved": [
            {
                "of": one.before.owner,
                "name": one.before.name,
                "unit": one.before.unit,
                "before": plain(one.before.value),
                "before_standard_error": plain(one.before.std),
                "after": plain(one.after.value),
                "after_standard_error": plain(one.after.std),
            }
            for one in evidence.moved(numbers(found.study, base), fitted)
        ],
        "steps": [
            {
                "added": list(one.added),
                "dropped": list(one.dropped),
                "error_before_mps": plain(one.error_before_mps),
                "error_after_mps": plain(one.error_after_mps),
            }
            for one in evidence.rungs(found)
        ],
        "tried": [
            {
                "effect": one.name,
                "gain": plain(one.gain),
                "standard_errors": plain(one.sureness),
                "evidence": plain(one.evidence),
                "counts": one.credit,
            }
            for one in found.steps[0].tried
        ],
        "forces": [
            {
                "effect": step.taken,
                "error_before_mps": plain(evidence.error_mps(step.forces)) if step.forces else None,
                "error_after_mps": plain(evidence.error_mps(taken.compared)) if step.forces and taken else None,
                "refuted": list(step.refuted),
            }
            for step in found.steps
            if (taken := tried_in(step, step.taken)) is not None and (step.forces or step.refuted)
        ],
        "dependence": _dependence(found),
        "seed": SEED,
    }


def _figures(one: Number) -> dict[str, Any]:
    return {
        "name": one.name,
        "value": plain(one.value),
        "standard_error": plain(one.std),
        "unit": one.unit,
        "low": plain(one.low),
        "high": plain(one.high),
        "plausible": one.plausible,
        "remark": one.remark,
    }


def _dependence(found: Diagnosis) -> list[dict[str, Any]]:
    """The curve of every dependence that no effect describes."""
    result = []
    for name in evidence.members(found.final.explanation):
        if name.startswith(UNNAMED):
            drawn = curve(found.study, found.base, found.final, name)
            picked = slice(None, None, max(len(drawn.x) // CURVE_SHOWN, 1))
            std = drawn.std if drawn.std is not None else drawn.y * math.nan
            result.append(
                {
                    "signal": name.removeprefix(UNNAMED),
                    "of": drawn.y_words,
                    "values": drawn.x[picked].tolist(),
                    "curve": drawn.y[picked].tolist(),
                    "standard_error": [plain(value) for value in std[picked].tolist()],
                }
            )
    return result
