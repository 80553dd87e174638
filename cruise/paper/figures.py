"""What the text states of Figures 2 to 7, measured on the recordings of one seed. Curves of the figures are not known.

Rpm (section V.A): predicted speed times P(n) / P(2100 rpm), P the engine's maximum power; beside it times n / 2100 rpm.
Gears (section V.C, equations 10 to 12): predicted change of speed times v_max,i / v_max,2, and for gears 3 and 4 the
acceleration times alpha = (v_max,2 / v_max,i)^2 as well. Predictions are made 3 s ahead by the arx10B of second gear at
20 Hz, whose constant stands for standstill and isn't scaled.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.effects.effect import RATED_RPM
from cruise.effects.gear_ratio import GearRatio
from cruise.identification.arx import Arx
from cruise.identification.explore import (
    CrossCorrelation,
    FrequencyResponse,
    NotPossible,
    StaticCurve,
    cross_correlation,
    frequency_response,
    static_curve,
)
from cruise.model.model import Model
from cruise.paper.records import GEARS, Records
from cruise.paper.tables import HORIZON_S, RATES_HZ, Fitted, variation_explained_pct
from cruise.plant.engine import RADPS_PER_RPM, EngineSettings, full_load_torque_nm
from cruise.recording import Recording

TOP_SPEED_S: Final = 1.0  # s, over which a top speed is a mean
STEPPED: Final = ("arx7", "arx10", "arx7B", "arx10B")  # the models of Fig. 5
NEARLY_THERE: Final = 0.95  # of the top speed: reached


@dataclass(frozen=True, slots=True)
class Statement:
    """One number that the text states, or that bears on what it states, and whether ours agrees."""

    figure: str
    about: str
    published: str
    ours: float  # NaN where it could not be found
    unit: str
    agrees: bool | None  # None: the text gives nothing to hold it against


@dataclass(frozen=True, eq=False)
class Pictures:
    """What Figures 2 to 7 of ours are drawn from."""

    response: FrequencyResponse | NotPossible
    correlation: CrossCorrelation | NotPossible
    curve: StaticCurve | NotPossible
    steps_mps: Mapping[str, np.ndarray]  # prediction of each model of Fig. 5 on the steps
    gears_mps: Mapping[int, tuple[np.ndarray, np.ndarray]]  # rescaled, and acceleration rescaled, per gear


def pictures_and_statements(
    records: Records, fitted: Mapping[float, Fitted], engine: EngineSettings
) -> tuple[Pictures, list[Statement]]:
    """Everything that the text states of the figures, in its order."""
    noise = [records.noise, records.unseen]
    correlation = cross_correlation(noise)
    response = frequency_response(noise, correlation.peak_lag_s if isinstance(correlation, CrossCorrelation) else 0.0)
    curve = static_curve([*noise, records.ramp])
    judged = fitted[RATES_HZ[0]]
    model = judged.models["arx10B"]
    assert isinstance(model, Arx)
    tops_mps = {gear: top_speed_mps(record) for gear, record in records.gears.items()}
    steps = {name: judged.ahead(name, judged.steps)[1] for name in STEPPED}
    gears = {
        gear: (
            _ahead(scaled(model.model, tops_mps[gear] / tops_mps[2]), record, judged),
            _ahead(in_gears(model.model, tops_mps), record, judged),
        )
        for gear, record in records.gears.items()
    }
    statements = [
        *_exploration(response, correlation, curve),
        *_whiteness(fitted),
        *_armax(fitted),
        *_engine_speeds(model.model, records, judged, engine),
        *_gears(records, gears, tops_mps),
    ]
    pictures = Pictures(response, correlation, curve, steps, gears)
    return pictures, statements


def _exploration(
    response: FrequencyResponse | NotPossible,
    correlation: CrossCorrelation | NotPossible,
    curve: StaticCurve | NotPossible,
) -> list[Statement]:
    cutoff_hz = bump_hz = bump_db = peak_s = low_ma = high_ma = p_value = math.nan
    if isinstance(response, FrequencyResponse) and response.cutoff:
        cutoff_hz = response.cutoff.frequency_hz
    if isinstance(response, FrequencyResponse) and response.bump:
        bump_hz, bump_db = response.bump.frequency_hz, response.bump.height_db
    if isinstance(correlation, CrossCorrelation):
        peak_s = correlation.peak_lag_s
    if isinstance(curve, StaticCurve):
        low_ma, high_ma = (end.value if end else math.nan for end in (curve.threshold_ma, curve.saturation_ma))
        p_value = curve.quadratic_p_value
    return [
        Statement("2", "cut-off frequency", "at 1 Hz", cutoff_hz, "Hz", abs(cutoff_hz - 1.0) <= 0.15),
        Statement("2", "frequency of the bump", "between 1 and 2 Hz", bump_hz, "Hz", 1.0 <= bump_hz <= 2.0),
        Statement("2", "height of the bump", "visible", bump_db, "dB", bump_db > 0.0),
        Statement("3", "peak of the cross-correlation", "about 0.75 s", peak_s, "s", abs(peak_s - 0.75) <= 0.05),
        Statement("4", "end of the dead zone at small currents", "visible", low_ma, "mA", math.isfinite(low_ma)),
        Statement("4", "begin of the dead zone at large currents", "visible", high_ma, "mA", math.isfinite(high_ma)),
        Statement("4", "p of a straight line in between", "quadratic", p_value, "-", p_value < 0.01),
    ]


def _whiteness(fitted: Mapping[float, Fitted]) -> list[Statement]:
    """The text calls arx10 and arx10B nearly white and arx7 not: held is that theirs are the whiter ones."""
    first = fitted[RATES_HZ[0]]
    found = {name: first.residual_whiteness(name).largest for name in STEPPED}
    rows = []
    for plain, fed_back, said in (("arx7", "arx10", "almost white"), ("arx7B", "arx10B", "practically white")):
        whiter = found[fed_back] < found[plain]
        about = "greatest autocorrelation of the residuals of "
        rows.append(Statement("5", about + plain, "not white", found[plain], "-", whiter))
        rows.append(Statement("5", about + fed_back, said, found[fed_back], "-", whiter))
    return rows


def _armax(fitted: Mapping[float, Fitted]) -> list[Statement]:
    rows = []
    for rate_hz in RATES_HZ:
        judged = fitted[rate_hz]
        armax, arx = (judged.explained_pct(name, judged.unseen) for name in ("armax", "arx7"))
        gain = (armax if armax is not None else math.nan) - (arx or 0.0)
        about = f"ARMAX (0, 3, 0.5 s) over arx7, {rate_hz:g} Hz"
        rows.append(Statement("IV.B.2", about, "no improvement", gain, "points", bool(gain <= 1.0)))
    return rows


def top_speed_mps(record: Recording) -> float:
    """Greatest mean speed over a second."""
    width = round(TOP_SPEED_S / record.dt_s)
    return float(np.convolve(record.output, np.full(width, 1.0 / width), "valid").max())


def in_gears(model: Model, tops_mps: Mapping[int, float]) -> Model:
    """The model of second gear for all gears, its acceleration rescaled too (equation 12)."""
    return replace(model, effects=(*model.effects, GearRatio(*(tops_mps[gear] for gear in GEARS))))


def _ahead(model: Model, record: Recording, judged: Fitted) -> np.ndarray:
    return Arx(model, "").ahead(judged.ready("arx10B", record), round(HORIZON_S * judged.rate_hz))


def _gears(
    records: Records, predicted: Mapping[int, tuple[np.ndarray, ...]], tops_mps: Mapping[int, float]
) -> list[Statement]:
    rows = []
    for gear, said in predicted.items():
        record = records.gears[gear]
        verdict = "very well" if gear < 4 else "acceptable"
        least = 90.0 if gear < 4 else 75.0
        rows += [
            Statement("7", f"gear {gear}: top speed", "-", tops_mps[gear], "m/s", None),
            Statement(
                "7", f"gear {gear}: time to top speed", "1st as 2nd" if gear < 3 else "-", rise_s(record), "s", None
            ),
        ]
        for name, one, bound in zip(("rescaled", "acceleration rescaled"), said, (None, least), strict=True):
            explained = variation_explained_pct(record, one)
            agrees = None if bound is None else bool(explained >= bound)
            rows.append(
                Statement("7", f"gear {gear}: {name} arx10B", verdict if bound else "-", explained, "%", agrees)
            )
    return rows


def rise_s(record: Recording) -> float:
    """Time in s from the step to full current until 95 % of the top speed; NaN without such a step."""
    top_mps, full_ma = top_speed_mps(record), float(np.nanmax(record.input))
    at_full = record.input >= full_ma - 0.02 * full_ma
    begins = np.flatnonzero(at_full[1:] & ~at_full[:-1]) + 1
    times = []
    for begin in begins:
        reached = np.flatnonzero(record.output[begin:] >= NEARLY_THERE * top_mps)
        if len(reached):
            times.append(record.dt_s * float(reached[0]))
    return float(np.median(times)) if times else math.nan


def power_share(engine: EngineSettings, rpm: np.ndarray) -> np.ndarray:
    """Maximum power of the engine relative to that at 2100 rpm (Fig. 6)."""

    def power(speed_rpm: float) -> float:
        return full_load_torque_nm(engine, speed_rpm * RADPS_PER_RPM) * speed_rpm

    return np.array([power(float(one)) for one in np.ravel(rpm)]) / power(RATED_RPM)


def _engine_speeds(model: Model, records: Records, judged: Fitted, engine: EngineSettings) -> list[Statement]:
    """Explained 3 s ahead by scaling the speed with the power, and with the engine speed itself."""
    rows = []
    for rpm, record in records.engine_speeds.items():
        shares = {"power curve": float(power_share(engine, np.array([rpm]))[0]), "proportional": rpm / RATED_RPM}
        for name, share in shares.items():
            explained = variation_explained_pct(record, _ahead(scaled(model, share), record, judged))
            published = "remains valid" if name == "power curve" else "-"
            rows.append(Statement("6", f"{rpm:g} rpm: scaled by the {name}", published, explained, "%", None))
    return rows


def scaled(model: Model, share: float) -> Model:
    """The model whose speeds are `share` of what they were, for every current: its drive is scaled."""
    a, b, loads, c_0 = model.split(model.theta)
    return model.with_theta((*a, *(share * value for value in b), *loads, c_0))
