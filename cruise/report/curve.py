"""What an effect does as it was fitted, from its own code: over the current, over a signal, or over time.

    s(x)^2 = J(x) C J(x)^T

s standard deviation of the curve, J its derivative by the fitted numbers of its owner, C their covariance. Every other
input stays at the recorded value next to its median.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.effects import Effect, Stage
from cruise.model.model import Model
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.validation.candidates import UNNAMED, owner
from cruise.validation.explanation import Explanation
from cruise.validation.judged import Judged
from cruise.validation.study import Study
from cruise.validation.unnamed import SPEED, Unnamed, UnnamedDirection

POINTS: Final = 101  # of a curve
FEW_VALUES: Final = 6  # a signal with no more different values has states, such as gears
SETTLING_S, SETTLED_S = 0.5, 120.0  # step and time, after which an effect with a memory shows what it comes to
RAMP_S: Final = 120.0  # of the slow ramp through all currents
STILL: Final = 0.01  # of the current's range: a command effect that changes less over a slow ramp acts on changes only
BEFORE_S, AFTER_S = 1.0, 7.0  # of the response to a step
SPARE: Final = 1e-4  # of a number's scale, for the derivatives of a curve
SURE: Final = 2.0  # standard errors of a band
BESIDE: Final = 0.05  # of an axis, left free at both ends


@dataclass(frozen=True, eq=False)
class Curve:
    """What an effect does, from its own code as it was fitted: y over x, both (M,), its std, y without the effect."""

    x: np.ndarray
    y: np.ndarray
    std: np.ndarray | None
    without: np.ndarray
    x_name: str
    x_unit: str
    y_words: str
    driven: np.ndarray | None  # the recorded values of x

    @property
    def bands(self) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
        """x, y - 2 s and y + 2 s, one for each way where x runs up and back; none where s is not known."""
        if self.std is None:
            return ()
        low, high = self.y - SURE * self.std, self.y + SURE * self.std
        back = np.flatnonzero(np.diff(self.x) <= 0.0)[:1] + 1
        ways = np.split(np.arange(len(self.x)), back)
        return tuple((self.x[way], low[way], high[way]) for way in ways)

    @property
    def limits(self) -> tuple[float, float]:
        """The ends of an axis of y; a band is cut off where it reaches farther beyond the curves than they span."""
        curves = np.concatenate([self.y, self.without])
        edges = np.concatenate([curves, *(edge for _, *both in self.bands for edge in both)])
        span = np.ptp(curves)
        low, high = max(edges.min(), curves.min() - span), min(edges.max(), curves.max() + span)
        beside = BESIDE * (high - low) or BESIDE
        return float(low - beside), float(high + beside)


Evaluate = Callable[[Explanation], np.ndarray]


def curve(study: Study, before: Judged, after: Judged, name: str) -> Curve:
    """The curve of what matters most: over the current, over the signal that moves the effect most, or over time."""
    if name.startswith(UNNAMED):
        return _unnamed(study, before, after, name)
    effect = next((one for one in after.explanation.effects if one.name == name), None)
    if effect is None:
        return _response(study, before, after)
    if effect.acts_as is Stage.COMMAND:
        return _command(study, before, after, effect)
    return _static(study, before, after, effect)


def _command(study: Study, before: Judged, after: Judged, effect: Effect) -> Curve:
    """f(u) over a slow ramp through the recorded currents, up and down."""
    low, high = _range(study.search.scene.current_ma)
    up = np.linspace(low, high, POINTS)
    ramp = np.concatenate([up, up[::-1], up, up[::-1]])

    def f(one: Explanation) -> np.ndarray:
        mine = next(other for other in one.effects if other.name == effect.name)
        values, _ = mine.over(ramp, np.zeros(len(ramp)), {}, RAMP_S / POINTS)
        return np.asarray(values)[2 * POINTS :]  # the second way round: no trace of where it began

    y = f(after.explanation)
    if np.ptp(y - ramp[2 * POINTS :]) < STILL * (high - low):
        return _response(study, before, after)
    std = _std(study, after, (effect.name,), f)
    x, driven = ramp[2 * POINTS :], study.search.scene.current_ma
    return Curve(x, y, std, x, "current", "mA", "current that acts (mA)", driven)


def _static(study: Study, before: Judged, after: Judged, effect: Effect) -> Curve:
    """g or the load's speed over the input that moves it most, all others as they usually were."""
    usual = {name: _typical(values) for name, values in study.search.scene.signals.items()}
    usual[SPEED] = usual[OUTPUT]
    names = [name for name in (*((SPEED,) if effect.reads_speed else ()), *effect.uses) if name in usual]
    if not names:
        return _response(study, before, after)

    def over_input(name: str) -> tuple[np.ndarray, Evaluate]:
        x = _grid(_recorded(study, name))
        return x, lambda one: _settled(one, effect.name, usual, name, x)

    spans = {name: float(np.ptp(over_input(name)[1](after.explanation))) for name in names}
    name = max(spans, key=lambda one: spans[one])
    x, f = over_input(name)
    y = f(after.explanation)
    if not spans[name] > 0.0:
        return _response(study, before, after)
    gain = effect.acts_as is Stage.GAIN
    words = "gain of the drive g (-)" if gain else "change of the steady speed (m/s)"
    neutral = np.full(len(x), 1.0 if gain else 0.0)
    shown, unit = _spoken(name)
    return Curve(x, y, _std(study, after, (effect.name,), f), neutral, shown, unit, words, _recorded(study, name))


def _settled(one: Explanation, effect_name: str, usual: dict[str, float], name: str, x: np.ndarray) -> np.ndarray:
    """The effect's output over the values `x` of one input, times its coefficient where it is a load."""
    place = next(i for i, other in enumerate(one.effects) if other.name == effect_name)
    effect = one.effects[place]
    signals = {key: np.full(len(x), value) for key, value in usual.items() if key != SPEED}
    if name != SPEED:
        signals[name] = x
    speed = x if name == SPEED else np.full(len(x), usual[SPEED])
    value, state = (1.0 if effect.acts_as is Stage.GAIN else 0.0), effect.start(np.zeros(len(x)))
    result, state = effect.step(value, speed, signals, state, SETTLING_S)
    if state is not None:
        for _ in range(round(SETTLED_S / SETTLING_S)):
            result, state = effect.step(value, speed, signals, state, SETTLING_S)
    factor = one.loads[one.at(Stage.LOAD).index(place)] if effect.acts_as is Stage.LOAD else 1.0
    return factor * np.broadcast_to(np.asarray(result, float), len(x))


def _unnamed(study: Study, before: Judged, after: Judged, name: str) -> Curve:
    """What the dependence does to the steady speed, over its signal, at the usual current."""
    mine = [effect for effect in after.explanation.effects if owner(effect) == name]
    parts = tuple(effect.name for effect in mine)
    signal = next((effect.signal for effect in mine if isinstance(effect, Unnamed)), INPUT)  # may be derived from it
    current_ma = _typical(study.search.scene.current_ma)
    usual = {key: _typical(values) for key, values in study.search.scene.signals.items()}
    usual[SPEED] = usual[OUTPUT]
    shown, unit = _spoken(signal)
    driven = _recorded(study, signal)
    x = _grid(driven)
    if signal == INPUT:
        up_and_down = np.concatenate([x, x[::-1]])
        rising = np.where(np.arange(len(up_and_down)) < len(x), 1.0, -1.0)

        def steady(one: Explanation) -> np.ndarray:
            total = one.offset_mps * np.ones(len(up_and_down))
            for i, effect in enumerate(one.effects):
                if owner(effect) == name and effect.acts_as is Stage.COMMAND:
                    total += one.core.gain_mps_per_ma * np.asarray(effect.step(up_and_down, 0.0, {}, None, 1.0)[0])
                elif isinstance(effect, UnnamedDirection):
                    total += one.loads[one.at(Stage.LOAD).index(i)] * rising
                elif effect.acts_as is Stage.LOAD:
                    total += _settled(one, effect.name, usual, signal, up_and_down)
            return total

        straight = before.explanation.core.gain_mps_per_ma * up_and_down + before.explanation.offset_mps
        y, std = steady(after.explanation), _std(study, after, parts, steady)
        return Curve(up_and_down, y, std, straight, shown, unit, "steady speed (m/s)", driven)

    def change(one: Explanation) -> np.ndarray:
        total = np.zeros(len(x))
        for effect in one.effects:
            if owner(effect) == name:
                output = _settled(one, effect.name, usual, signal, x)
                gain = effect.acts_as is Stage.GAIN
                total += one.core.gain_mps_per_ma * current_ma * (output - 1.0) if gain else output
        return total

    y, std = change(after.explanation), _std(study, after, parts, change)
    words = f"change of the steady speed at {current_ma:.0f} mA (m/s)"
    return Curve(x, y, std, np.zeros(len(x)), shown, unit, words, driven)


def _response(study: Study, before: Judged, after: Judged) -> Curve:
    """The speed after a step of current over the middle half of those recorded, up, without the effect and with it."""
    period_s, scene = study.period_s, study.search.scene
    time_s = np.arange(-BEFORE_S, AFTER_S, period_s)
    low, high = np.nanquantile(scene.current_ma, (0.25, 0.75))
    current_ma = np.where(time_s < 0.0, low, high)
    signals = {name: _typical(values) for name, values in scene.signals.items()}
    with_it, without = (_answer(one.explanation.model(period_s), current_ma, signals) for one in (after, before))
    words = f"speed after {low:.0f} to {high:.0f} mA (m/s)"
    return Curve(time_s, with_it, None, without, "time after the step", "s", words, None)


def _answer(model: Model, current_ma: np.ndarray, signals: dict[str, float]) -> np.ndarray:
    """Speeds (M,) in m/s of a machine that came to rest in its first current."""
    first = [float(current_ma[0])] * round(SETTLED_S / model.period_s)
    currents = [*first, *current_ma.tolist()]
    state = model.start(0.0, first[0], signals)
    return np.array(model.predict(state, currents, [signals] * len(currents))[len(first) :])


def _std(study: Study, judged: Judged, owners: Sequence[str], f: Evaluate) -> np.ndarray:
    """Standard deviation (M,) of a curve from the covariance of what was fitted for its owners."""
    plan, vector = judged.fit.layout, judged.fit.vector
    covariance = study.search.covariance(judged.fit)
    mine = [i for i, slot in enumerate(plan.slots) if slot.owner in owners]
    _, high = plan.bounds
    here, slopes = f(plan.explanation(vector)), []
    for i in mine:
        size = SPARE * plan.slots[i].scale
        step = -size if vector[i] + size > high[i] else size
        slopes.append((f(plan.explanation(vector + step * np.eye(len(vector))[i])) - here) / step)
    if not slopes:
        return np.zeros(len(here))
    jacobian = np.column_stack(slopes)
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", jacobian, covariance[np.ix_(mine, mine)], jacobian), 0.0))


def _recorded(study: Study, name: str) -> np.ndarray:
    return study.search.scene.signals[OUTPUT if name == SPEED else name]


def _range(values: np.ndarray) -> tuple[float, float]:
    low, high = np.nanquantile(values, (0.01, 0.99))
    return float(low), float(high)


def _grid(values: np.ndarray) -> np.ndarray:
    """Values (M,) over the range of those recorded; the recorded ones where they are few, such as gears."""
    different = np.unique(values[np.isfinite(values)])
    return different if len(different) <= FEW_VALUES else np.linspace(*_range(values), POINTS)


def _typical(values: np.ndarray) -> float:
    """The recorded value next to the median: a gear between two gears is none."""
    known_values = values[np.isfinite(values)]
    if not len(known_values):
        return np.nan
    return float(known_values[np.argmin(np.abs(known_values - np.median(known_values)))])


def _spoken(name: str) -> tuple[str, str]:
    if name == SPEED:
        return "speed one sample before", "m/s"
    return (name, SIGNALS[name].unit) if name in SIGNALS else (name, "")
