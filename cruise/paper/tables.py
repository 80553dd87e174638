"""Tables I to VI, computed from the recordings of one seed.

    explained = 1 - mean((y - y_hat)^2) / var(y)

y unfiltered measured speed, y_hat its prediction 3 s ahead. What we took where the paper leaves it open: the
Butterworth filter runs forward and back; the validation input is filtered like the training input, the measured speed
never is (unfiltered, the three-tap models would explain nothing); data are filtered at 20 Hz, then decimated to 5 Hz
behind an 8th-order Chebyshev filter without phase, as Matlab's decimate does (means over 0.2 s would fold current from
above 2.5 Hz back below 1 Hz); a delay of 0.5 s is 2 samples of 5 Hz (with 3, arx8 would explain as much there as arx7);
the transformation B is the static curve of the slow ramp, and it as well as the polynomials of Table IV are applied at
20 Hz, before filter and decimation; a bias counts as unexplained, so that models without feedback pay for it on steps;
the gain of Table VI is mean speed over mean current. "-" stands for a predictor with a pole on or outside the unit
circle, or one that explains less than nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import signal

from cruise.effects import Effect
from cruise.identification.accuracy import accuracy
from cruise.identification.families import Identified
from cruise.identification.identify import fit_family
from cruise.identification.output_error import OutputError
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.identification.regressors import Smooth
from cruise.identification.shapes import fit_shapes
from cruise.identification.structures import PRESETS, Family, Structure, parse
from cruise.identification.whiteness import Whiteness, whiteness
from cruise.model.prediction import lagged
from cruise.paper.hermite import Hermite, fit_hermite
from cruise.paper.published import Published
from cruise.paper.records import Records
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

RATES_HZ: Final = (20.0, 5.0)
HORIZON_S: Final = 3.0
RAMP_SHAPES: Final = (
    ("saturation", "full_stroke_ma"),
    ("dead_zone", "threshold_ma"),
    ("quadratic_gain", "curvature"),
)


@dataclass(frozen=True, slots=True)
class Cell:
    """One number of a table beside the published one; None is the paper's "-"."""

    table: str
    model: str
    rate_hz: float
    published: float | None
    ours: float | None

    @property
    def key(self) -> tuple[str, str, float]:
        """Which cell it is."""
        return self.table, self.model, self.rate_hz


@dataclass(frozen=True, eq=False)
class Fitted:
    """All models of one rate, and how recordings are made ready for them."""

    rate_hz: float
    models: Mapping[str, Identified | Hermite]
    effects: tuple[Effect, ...]  # the transformation B
    smooth: Smooth
    unseen: Recording
    steps: Recording

    def ready(self, name: str, recording: Recording) -> Recording:
        """A recording of 20 Hz as a model is judged on it: current transformed (B), at this rate and filtered."""
        return ready(recording, self.effects if PRESETS[name].effects else (), self.rate_hz, self.smooth)

    def ahead(self, name: str, recording: Recording, horizon_s: float = HORIZON_S) -> tuple[Recording, np.ndarray]:
        """The recording as it was judged, and its speeds (N,) in m/s as predicted before."""
        judged, model = self.ready(name, recording), self.models[name]
        horizon = max(round(horizon_s * self.rate_hz), 1)
        said = self._said(model, recording, judged, horizon)
        said[: 2 * horizon] = np.nan  # the same samples for all models, whatever they need to start
        return judged, said

    def _said(self, model: Identified | Hermite, recording: Recording, judged: Recording, horizon: int) -> np.ndarray:
        if isinstance(model, Hermite):
            drives = model.drives(recording, lambda one: ready(one, (), self.rate_hz, self.smooth))
            return model.ahead(drives, judged.output, horizon)
        seen = judged
        if isinstance(model, OutputError):  # it uses no measured speed but to start from: from rest about the mean
            rest = np.full(len(judged), judged.output.mean())
            seen = replace(judged, columns={**judged.columns, OUTPUT: rest})
        return model.ahead(seen, horizon)

    def explained_pct(self, name: str, recording: Recording) -> float | None:
        """Performance 3 s ahead on a recording of 20 Hz; None for an unstable predictor."""
        if self.models[name].unstable:
            return None
        explained = variation_explained_pct(*self.ahead(name, recording))
        return explained if explained >= 0.0 else None

    def residual_whiteness(self, name: str) -> Whiteness:
        """Of the one-step residuals on unseen noise."""
        judged, said = self.ahead(name, self.unseen, horizon_s=0.0)
        return whiteness([judged.output - said])


def ready(
    recording: Recording, effects: tuple[Effect, ...], rate_hz: float, smooth: Smooth, output: bool = False
) -> Recording:
    """A recording of 20 Hz, its current transformed, then filtered, then at `rate_hz`; with `output` the speed as well.

    The speed of a recording that is judged is only decimated. The decimation's filter has a gain of 0.989 at 0 Hz, on
    current and speed alike.
    """
    drive, speed = recording.input, lagged(recording.output, 1)
    for effect in effects:
        drive, _ = effect.over(drive, speed, {}, recording.dt_s)
    filtered = {INPUT: smooth(drive), OUTPUT: smooth(recording.output) if output else recording.output}
    factor = round(1.0 / (rate_hz * recording.dt_s))
    if factor > 1:
        filtered = {name: signal.decimate(values, factor) for name, values in filtered.items()}
    columns = {**{name: values[::factor] for name, values in recording.columns.items()}, **filtered}
    return Recording(recording.time_s[::factor], columns, factor * recording.dt_s, recording.source, recording.notes)


def variation_explained_pct(recording: Recording, predicted_mps: np.ndarray) -> float:
    """The percentage of the variation that a prediction (N,) explains; a bias counts as unexplained."""
    judged = accuracy([recording.output], [predicted_mps])
    return 100.0 * (1.0 - (1.0 - 0.01 * judged.nrmse_pct) ** 2)


def static_effects(ramp: Recording, delay_s: float) -> tuple[Effect, ...]:
    """The transformation B: dead zone, quadratic middle and saturation that the slow ramp shows (section IV.C)."""
    structure = parse("arx:na=0,nb=1,delay_s=0+" + "+".join(PRESETS["arx10B"].effects))
    model = replace(structure.model(ramp.dt_s), delay=round(delay_s / ramp.dt_s))
    return fit_shapes(model, [ramp], RAMP_SHAPES, HORIZON_S).effects


def fit_all(records: Records, rate_hz: float, effects: tuple[Effect, ...]) -> Fitted:
    """Every model of Tables I to IV, and the ARMAX model of the text, at one rate."""
    smooth = smoother(PreparationSettings(), records.noise.dt_s)
    assert smooth is not None
    plain, transformed = (ready(records.noise, chain, rate_hz, smooth, output=True) for chain in ((), effects))

    def fit(structure: Structure) -> Identified | Hermite:
        if structure.family is Family.NARX:
            return fit_hermite(
                structure,
                records.noise,
                lambda one: ready(one, (), rate_hz, smooth, output=True),
                1.0 / rate_hz,
                round(HORIZON_S * rate_hz),
            )
        model = replace(structure.model(1.0 / rate_hz), effects=())
        return fit_family(structure, model, [transformed if structure.effects else plain], _as_it_is)

    models = {name: fit(structure) for name, structure in PRESETS.items()}
    return Fitted(rate_hz, models, effects, smooth, records.unseen, records.steps)


def _as_it_is(values: np.ndarray) -> np.ndarray:
    """The filter of data that are filtered already: the fits then know that columns are nearly collinear."""
    return values


def cells(records: Records, fitted: Mapping[float, Fitted], published: Published) -> Iterator[Cell]:
    """All cells of Tables I to VI."""
    for table, rows in published.explained_pct.items():
        for name, printed in rows.items():
            for rate_hz, value in zip(RATES_HZ, printed, strict=True):
                judged = fitted[rate_hz]
                yield Cell(table, name, rate_hz, value, judged.explained_pct(name, judged.unseen))
    first = fitted[RATES_HZ[0]]
    for name, value in published.steps_explained_pct.items():
        yield Cell("V", name, RATES_HZ[0], value, first.explained_pct(name, first.steps))
    gains = [float(np.mean(record.output) / np.mean(record.input)) for _, record in records.gains]
    level = next(
        gain
        for (row, _), gain in zip(records.gains, gains, strict=True)
        if row.gain_pct == 100.0 and row.grade_deg == 0.0
    )
    for (row, _), gain in zip(records.gains, gains, strict=True):
        name = f"{row.grade_deg:+.1f} deg, {row.machine_mass_kg:g} kg"
        yield Cell("VI", name, RATES_HZ[0], row.gain_pct, 100.0 * gain / level)
