"""What a found effect is worth beside general methods, on drives of the virtual combine with one hidden effect.

A drive of the blind trial (clean tier, medium size, 15 minutes) teaches, a second drive of the same machine judges,
3 s ahead at 5 Hz, everyone on the same samples. `base` is the model without the effect; `found` that with the effects
which the diagnosis chose by itself; `true` that with the hidden effect's own structure. The diagnosis reads the
recording at 20 Hz; what it chose is then fitted to means over 0.2 s, as `cruise add` does and as the others are taught.
`found_20hz` and `true_20hz` keep the current at 20 Hz, as the diagnosis itself does, which the others don't see: they
are judged on the same means, 3 s ahead or more.

- inside: all of the second drive. The first one's signals come from the same distribution.
- outside: the signal that the effect reads is averaged over 5 s. Where that lies in the middle 60 % of the first drive
  teaches, in stretches of 10 s or more; where it lies beyond in the second judges. Diagnosis, fits and choice of orders
  all see these stretches alone.

Everyone is given the current and all signals that can be a cause; load, line pressure and wheel speed answer to the
speed and would give it away. The slope is the pitch without acceleration. FROLS, SINDy and boosting (`missing_peers`)
choose orders on data that they left out.

Two effects of each of the stages command, gain and load, of those that can be of medium size in the trial; oil
temperature can't. Floor: white noise of 0.01 m/s a reading; in means by trapezoids over 5 readings (weights 1/2 1 1 1
1/2, over 4) 0.0047 m/s, under any prediction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.identification.preparation import at_period
from cruise.identification.structures import parse
from cruise.model.prediction import ahead, runs
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation import study as studies
from cruise.validation.explanation import Explanation
from cruise.validation.means import trailing_mean
from cruise.validation.simulation import Scene
from cruise.validation.slope import PITCH, SLOPE
from tools.trial.course import STREAM as COURSE
from tools.trial.draw import draw
from tools.trial.simulate import STREAM as NOISE
from tools.trial.simulate import simulate
from tools.trial.sizing import MODEL, MODEL_PERIOD_S, recording, with_truth
from tools.trial.trial import NOISE_MPS, PERIOD_S, Trial

from . import diagnosis_time
from .diagnosis_time import TIMES, Diagnosed, diagnosed
from .figures import Figure, Part
from .missing_peers import HORIZON, Answer, Samples, ask, boosting

SEED: Final = 1
READS: Final = {
    "dead_zone": INPUT,
    "hysteresis": INPUT,
    "engine_speed": "engine_speed_rpm",
    "speed_droop": OUTPUT,
    "grade": PITCH,
    "rolling_resistance": "machine_mass_kg",
}
"""The hidden effects, and the signal that each reads."""

CAUSES: Final = (
    "engine_speed_rpm",
    "gear",
    SLOPE,
    "machine_mass_kg",
    "oil_temperature_c",
    "header_height_mm",
    "tyre_pressure_bar",
)
"""Signals that everyone is given."""

READINGS: Final = round(MODEL_PERIOD_S / PERIOD_S)  # of a sample
FLOOR_MPS: Final = NOISE_MPS["clean"] * np.sqrt(READINGS - 0.5) / READINGS  # of means by trapezoids
AVERAGED: Final = round(5.0 / MODEL_PERIOD_S)  # samples over which a signal says where the machine operates
MIDDLE: Final = (0.2, 0.8)  # quantiles between which the outside cases are taught
SHORTEST: Final = round(10.0 / MODEL_PERIOD_S)  # samples of a stretch; of shorter ones the lags leave little
GAP: Final = 10 * HORIZON  # samples of nothing between two stretches: longer than anyone remembers
METHODS: Final = {
    "base": "model without the effect",
    "found": "model with what was diagnosed",
    "true": "model with the hidden effect",
    "frols": "SysIdentPy FROLS, degree 2",
    "sindy": "PySINDy, degree 2",
    "boosting": "base model and boosting",
    "base_20hz": "without the effect, current at 20 Hz",
    "found_20hz": "with what was diagnosed, 20 Hz",
    "true_20hz": "with the hidden effect, 20 Hz",
}


class Drive(Trial, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A trial's machine on another day, with another course and other noise, or for so many times as long."""

    day: int = 0
    times: int = 1

    @property
    def seconds(self) -> float:
        """Length of the recording."""
        return self.times * super().seconds

    def rng(self, stream: int) -> np.random.Generator:
        """That of the trial, except for what another day changes."""
        if stream in (COURSE, NOISE):
            return np.random.default_rng([self.seed, stream, self.day])
        return super().rng(stream)


@dataclass(frozen=True, eq=False)
class Case:
    """One effect, inside or outside: what was diagnosed, and predictions (N,) of the second drive by method."""

    effect: str
    where: str
    told: Diagnosed
    train: Samples
    test: Samples
    judged: np.ndarray
    predicted_mps: dict[str, np.ndarray]

    @property
    def known(self) -> np.ndarray:
        """The judged samples (N,) that every method predicts."""
        return self.judged & np.isfinite(list(self.predicted_mps.values())).all(axis=0)

    def errors_mps(self) -> dict[str, float]:
        """RMS in m/s by method, all on the same samples."""
        measured, known = self.test.speed_mps, self.known
        return {
            name: float(np.sqrt(np.mean((measured - speed)[known] ** 2))) for name, speed in self.predicted_mps.items()
        }


def measure(effects: Sequence[str] = tuple(READS), peers: bool = True, times: int = TIMES) -> Part:
    """Diagnose, fit, let the others fit, judge; then the time of the diagnoses, and of one `times` as long.

    `peers`: whether SysIdentPy and PySINDy are to be had, installed if need be.
    """
    cases = [one for effect in effects for one in both(effect)]
    asked = ask([(one.train, one.test) for one in cases]) if peers else "SysIdentPy and PySINDy were left out"
    answers: list[dict[str, Answer]] = [{} for _ in cases] if isinstance(asked, str) else asked
    notes = [asked] if isinstance(asked, str) else []
    for case, told in zip(cases, answers, strict=True):
        told["boosting"] = boosting(case.train, case.test)
        case.predicted_mps.update({name: answer.predicted_mps for name, answer in told.items()})
    long = diagnosed([drive(effects[0], times=times)])
    ordinary = [one.told for one in cases if one.where == "inside"]
    errors = [one.errors_mps() for one in cases]
    notes += [_words(number, case, told) for number, (case, told) in enumerate(zip(cases, answers, strict=True), 1)]
    names = [name for name in METHODS if name in errors[0]]
    return Part(
        (*_ratios(cases, errors, names), *diagnosis_time.figures(ordinary, long, ordinary[0])),
        (SEED,),
        (f"errors in m/s, medians above; floor {FLOOR_MPS:.4f}, one reading {NOISE_MPS['clean']:g} m/s", *notes),
        {
            "case": [float(number) for number in range(1, len(cases) + 1)],
            **{name: [one[name] for one in errors] for name in names},
        },
    )


def drive(effect: str, day: int = 0, times: int = 1) -> Recording:
    """What is recorded of the machine with the effect."""
    trial = draw("clean", effect, "medium", SEED)
    return recording(simulate(Drive(tier="clean", seed=SEED, effects=trial.effects, day=day, times=times)))


def both(effect: str) -> list[Case]:
    """The cases of one effect, without the peers."""
    first, second = drive(effect), drive(effect, day=1)
    stretches, beyond = outside(first, second, READS[effect])
    return [
        case_of(effect, "inside", [first], second, np.ones(len(beyond), dtype=bool)),
        case_of(effect, "outside", stretches, second, beyond),
    ]


def outside(first: Recording, second: Recording, signal: str) -> tuple[list[Recording], np.ndarray]:
    """The stretches of the first drive that teach, and the samples of the second that are beyond them."""
    known, unseen = (trailing_mean(one.columns[signal], AVERAGED) for one in at_period([first, second], MODEL_PERIOD_S))
    low, high = np.quantile(known, MIDDLE)
    stretches = [
        first[READINGS * run.start : READINGS * run.stop + 1]
        for run in runs((known >= low) & (known <= high))
        if run.stop - run.start >= SHORTEST
    ]
    return stretches, (unseen < low) | (unseen > high)


def case_of(effect: str, where: str, taught: Sequence[Recording], second: Recording, judged: np.ndarray) -> Case:
    """Diagnose, fit to means, and predict the second drive."""
    structure = parse(MODEL)
    fine = studies.study(taught, structure, None, MODEL_PERIOD_S)
    coarse = studies.study(taught, structure, None, MODEL_PERIOD_S, at_their_rate=False).search
    told = diagnosed(taught)
    explained = {
        "base": fine.base.explanation,
        "found": told.final,
        "true": with_truth(fine, [effect]).explanation,
    }
    scene = Scene(at_period([second], MODEL_PERIOD_S), list(coarse.scene.recordings[0].columns), [second])
    fitted = {name: coarse.fitted(one).explanation for name, one in explained.items()}
    predicted_mps = {name: predicted(one, scene) for name, one in fitted.items()}
    predicted_mps |= {f"{name}_20hz": scene.simulate([one])[0] for name, one in explained.items()}
    train, test = (samples(one, predicted(fitted["base"], one)) for one in (coarse.scene, scene))
    return Case(effect, where, told, train, test, judged, predicted_mps)


def predicted(explanation: Explanation, scene: Scene) -> np.ndarray:
    """Speeds (N,) in m/s by the discrete model, 3 s ahead."""
    model = explanation.model(scene.period_s)
    parts = []
    for part in scene.parts:
        signals = {name: scene.signals[name][part] for name in model.uses if name in scene.signals}
        parts.append(ahead(model, scene.current_ma[part], scene.speed_mps[part], signals, HORIZON))
    return np.concatenate(parts)


def samples(scene: Scene, base_mps: np.ndarray) -> Samples:
    """What the others are given of recordings, one after the other with a gap between."""

    def joined(values: np.ndarray) -> np.ndarray:
        first, *others = (values[part] for part in scene.parts)
        return np.concatenate([first, *(piece for one in others for piece in (np.full(GAP, np.nan), one))])

    signals = np.array([joined(scene.signals[name]) for name in CAUSES])
    return Samples(joined(scene.current_ma), joined(scene.speed_mps), signals, joined(base_mps))


def _ratios(cases: Sequence[Case], errors: Sequence[dict[str, float]], names: Sequence[str]) -> list[Figure]:
    """Medians over the effects, and how often the hidden effect was named."""
    found = []
    for where in ("inside", "outside"):
        here = [one for one, case in zip(errors, cases, strict=True) if case.where == where]
        right = [case.told.effects == (case.effect,) for case in cases if case.where == where]
        meaning = f"{where}: diagnoses that name the hidden effect alone, of {len(right)}"
        found.append(Figure(f"named_{where}", float(sum(right)), "1", meaning))
        for name in names:
            true = "true_20hz" if name.endswith("_20hz") else "true"
            over_floor = float(np.median([one[name] / FLOOR_MPS for one in here]))
            over_true = float(np.median([one[name] / one[true] for one in here]))
            meaning = f"{where}: {METHODS[name]}: error over floor"
            found.append(Figure(f"{name}_over_floor_{where}", over_floor, "1", meaning))
            if name != true:
                found.append(Figure(f"{name}_over_true_{where}", over_true, "1", "over that with the hidden effect"))
    return found


def _words(number: int, case: Case, answers: dict[str, Answer]) -> str:
    named = " and ".join(case.told.effects) or "no effect of the table"
    chosen = "; ".join(f"{name}: {answer.chosen}" for name, answer in answers.items())
    return f"{number}: {case.effect}, {case.where}, {case.known.sum()} samples: {case.told.verdict}, {named}; {chosen}"
