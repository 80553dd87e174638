"""The picture of an effect: its own code, run over what it depends on, and in time where it has a memory."""

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cruise.cli.effects_courses import COURSES, SPEED, Course
from cruise.effects import Effect, Parameter, Stage
from cruise.model.model import Model
from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED
from cruise.signals import SIGNALS

MODERATE, STRONG = 0.25, 0.5  # of the way from a parameter's neutral value to its farther bound
HELD_BACK: Final = (  # all strong but one parameter
    {"color": GREEN, "ls": "-."},
    {"color": RED, "ls": ":"},
    {"color": GREEN, "ls": (0, (1, 1))},
    {"color": RED, "ls": "--"},
    {"color": GREEN, "ls": "--"},
    {"color": RED, "ls": "-."},
)
PERIOD_S: Final = 0.05  # s
TITLE_WIDTH, NARROW = 88, "\u00a0"  # characters over a panel; the space at which no line ends
DELAY, TIME_CONSTANT_S, GAIN_MPS_PER_MA = 8, 0.6, 2.5e-3  # of the machine that answers: 0.4 s, 2.5 m/s at 1000 mA
RINGING_HZ, DAMPING = 0.7, 0.2  # of a pair of poles that an effect adds: tyres under a combine
SETTLING_S, SETTLED_S = 0.5, 120.0  # step and time in s, after which an effect with a memory shows what it comes to

RANGES: Final = {  # lowest, usual and highest value at work
    SPEED: (-3.0, 2.0, 3.0),
    "engine_speed_rpm": (1300.0, 2100.0, 2300.0),
    "gear": (0.0, 3.0, 5.0),
    "pitch_deg": (-15.0, 10.0, 15.0),
    "machine_mass_kg": (12000.0, 20000.0, 25000.0),
    "oil_temperature_c": (10.0, 70.0, 100.0),
    "engine_load_pct": (0.0, 70.0, 120.0),
    "line_pressure_bar": (-150.0, 150.0, 400.0),
    "wheel_speed_mps": (0.0, 2.1, 3.0),
    "ground_speed_mps": (0.0, 2.0, 3.0),
}


class Curve(NamedTuple):
    """An effect of one shape, and how it is drawn."""

    effect: Effect
    label: str
    style: dict[str, Any]


Panel = Callable[[Any, Sequence[Curve]], None]


def draw(subject: Effect, path: Path) -> Path:
    """What the effect does, without it, moderate and strong; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    panels, drawn = panels_of(subject), curves(subject)
    figure, axes = plt.subplots(1, len(panels), figsize=(6.5 * len(panels), 5.0), layout="constrained", squeeze=False)
    for axis, panel in zip(axes[0], panels, strict=True):
        panel(axis, drawn)
        axis.grid(alpha=0.3)
    lines = {line.get_label(): line for axis in axes[0] for line in axis.get_lines()}
    figure.legend(handles=list(lines.values()), loc="outside lower left", fontsize="small")
    figure.suptitle(title_of(subject, len(panels)), x=0.01, ha="left", fontsize="medium")
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def title_of(subject: Effect, panels: int) -> str:
    """Name and equation; a line ends only between two parts of the equation, which stand two spaces apart."""
    parts = f"{subject.name}:  {subject.about.equation}".split("  ")
    lines = textwrap.wrap(
        "  ".join(part.replace(" ", NARROW) for part in parts), TITLE_WIDTH * panels, break_on_hyphens=False
    )
    return "\n".join(lines).replace(NARROW, " ")


def panels_of(subject: Effect) -> list[Panel]:
    """One panel for each thing that it depends on, one in time, and its answer to a step where that changes shape."""
    panels: list[Panel] = []
    if subject.acts_as is Stage.COMMAND:
        panels += [_loop, _steps, _stop]
    elif subject.acts_as in (Stage.GAIN, Stage.LOAD):
        course = COURSES.get(subject.name)
        inputs = [name for name in inputs_of(subject) if course is None or name not in course.instead]
        panels += [lambda axis, drawn, name=name: _static(axis, drawn, name) for name in inputs]
        if course is not None:
            panels.append(lambda axis, drawn: _in_time(axis, drawn, course))
    if type(subject).pace is not Effect.pace or type(subject).restructured is not Effect.restructured:
        panels.append(_response)
    return panels


def inputs_of(subject: Effect) -> tuple[str, ...]:
    """What a gain or a load depends on: the signals by name, and SPEED; not those that may tell it in their place."""
    signals = ((SPEED,) if subject.reads_speed else ()) + subject.needs + subject.helps
    return tuple(name for name in signals if name not in subject.told_by)


def curves(subject: Effect) -> list[Curve]:
    """The effect with neutral, moderate and strong shape; one curve where it has no shape.

    Where several parameters differ, one curve more for each but the first: strong, with only that one neutral, or with
    the other of two kinds.
    """
    if not subject.parameters:
        return [Curve(subject, subject.name, {"color": BLUE})]
    styles = {0.0: {"color": GREY, "ls": "--"}, MODERATE: {"color": BLUE}, STRONG: {"color": ORANGE}}
    drawn = [
        Curve(effect := subject.reshaped(**shape(subject, share)), _label(effect, share), style)
        for share, style in styles.items()
    ]
    unlike = {name: bound for name, bound in subject.parameters.items() if name not in _alike(subject)}
    others = [(name, bound) for name, bound in unlike.items() if name not in subject.instead][1:]
    for (name, bound), style in zip(others, HELD_BACK, strict=False):
        other = _moved(bound, 1.0 if _ascends(bound) else -1.0) if name == subject.kind else bound.neutral
        effect = drawn[2].effect.reshaped(**{name: other})
        drawn.append(Curve(effect, _label(effect, STRONG), style))
    return drawn


def _alike(subject: Effect) -> list[str]:
    """Its parameters of one kind, where there are several such."""
    bounds = list(subject.parameters.values())
    return [name for name, bound in subject.parameters.items() if bounds.count(bound) > 1]


def shape(subject: Effect, share: float) -> dict[str, float]:
    """The parameters `share` of the way from neutral to the farther bound.

    Several that are alike are spread out, the first towards its low bound, the last towards its high one: gears that
    are all the same are no gears.
    """
    alike = _alike(subject)
    sides = {name: share if _ascends(bound) else -share for name, bound in subject.parameters.items()}
    sides |= dict.fromkeys((*subject.instead, subject.kind), 0.0)
    sides |= dict(zip(alike, np.linspace(-share, share, len(alike)).tolist(), strict=True))
    return {name: _moved(bound, sides[name]) for name, bound in subject.parameters.items()}


def _ascends(bound: Parameter) -> bool:
    """Whether the high bound is the farther one: in ratio where only positive values are plausible."""
    if bound.low > 0.0:
        return bound.high / bound.neutral > bound.neutral / bound.low
    return bound.high - bound.neutral >= bound.neutral - bound.low


def _moved(bound: Parameter, side: float) -> float:
    """From neutral towards the high bound by the share `side`, towards the low one where it is negative."""
    target = bound.high if side > 0.0 else bound.low
    if bound.low > 0.0:
        return bound.neutral * (target / bound.neutral) ** abs(side)
    return bound.neutral + abs(side) * (target - bound.neutral)


def _label(effect: Effect, share: float) -> str:
    told = [
        f"{name} = {getattr(effect, name):.4g}{'' if bound.unit == '-' else f' {bound.unit}'}"
        for name, bound in effect.parameters.items()
        if name not in effect.instead
    ]
    return ", ".join(told) + ("" if share else " (neutral)")


def usual() -> dict[str, float]:
    """Every signal at its usual value."""
    return {name: span(name)[1] for name in SIGNALS}


def span(name: str) -> tuple[float, float, float]:
    """Lowest, usual and highest value of a signal; those that can be believed where nothing closer is known."""
    if name in RANGES:
        return RANGES[name]
    signal = SIGNALS[name]
    return signal.low, 0.5 * (signal.low + signal.high), signal.high


def _loop(axis: Any, drawn: Sequence[Curve]) -> None:
    """A slow ramp of 100 mA/s up to full current forward, down to full current backward, and up again."""
    up = np.arange(0.0, 1200.0, 5.0)
    current_ma = np.concatenate([up, 1200.0 - up, -up, up - 1200.0, up])
    for one in drawn:
        output, _ = one.effect.over(current_ma, np.zeros(len(current_ma)), {}, PERIOD_S)
        axis.plot(current_ma, output, label=one.label, lw=1.5, **one.style)
    axis.set_title("over a slow ramp of 100 mA/s, up and down", loc="left", fontsize="medium")
    axis.set_xlabel("current (mA)")
    axis.set_ylabel("current that acts (mA)")


def _steps(axis: Any, drawn: Sequence[Curve]) -> None:
    """A great step and a small one, each up and down."""
    time_s = np.arange(0.0, 8.0, 0.02)
    current_ma = np.select(
        [time_s < 1.0, time_s < 3.0, time_s < 5.0, time_s < 6.5], [500.0, 950.0, 500.0, 600.0], 500.0
    )
    _over_time(axis, drawn, time_s, current_ma, "over steps of 450 and 100 mA")


def _stop(axis: Any, drawn: Sequence[Curve]) -> None:
    """A ramp down to no current, a stop, and a small step off again."""
    time_s = np.arange(0.0, 8.0, 0.02)
    current_ma = np.interp(time_s, [1.0, 3.0, 5.0, 5.02, 6.0, 7.0], [300.0, 0.0, 0.0, 100.0, 100.0, 0.0])
    _over_time(axis, drawn, time_s, current_ma, "over a ramp to a stop, and a step of 100 mA")


def _over_time(axis: Any, drawn: Sequence[Curve], time_s: np.ndarray, current_ma: np.ndarray, title: str) -> None:
    axis.plot(time_s, current_ma, color=GREY, lw=0.8, label="current")
    for one in drawn:
        output, _ = one.effect.over(current_ma, np.zeros(len(time_s)), {}, time_s[1])
        axis.plot(time_s, output, label=one.label, lw=1.5, **one.style)
    axis.set_title(title, loc="left", fontsize="medium")
    axis.set_xlabel("time (s)")
    axis.set_ylabel("current that acts (mA)")


def _static(axis: Any, drawn: Sequence[Curve], name: str) -> None:
    """What the effect comes to over one of its inputs, the others at their usual values."""
    low, _, high = span(name)
    whole = name == "gear"
    x = np.arange(low, high) if whole else np.linspace(low, high, 301)
    for one in drawn:
        y = settled(one.effect, name, x)
        marks = {"marker": "o", "lw": 0.8} if whole else {"lw": 1.5}
        axis.plot(x, y, label=one.label, **marks, **one.style)
    effect = drawn[0].effect
    others = [other for other in inputs_of(effect) if other != name]
    held = ", ".join(f"{_named(other)[0]} {span(other)[1]:g} {_named(other)[1]}" for other in others)
    axis.set_title(f"at {held}" if held else "", loc="left", fontsize="medium")
    axis.set_xlabel("{} ({})".format(*_named(name)))
    axis.set_ylabel(_answering(effect))


def _in_time(axis: Any, drawn: Sequence[Curve], course: Course) -> None:
    """What the effect gives over a course of its inputs, those not in it at their usual values."""
    past_mps = np.concatenate([course.speed_mps[:1], course.speed_mps[:-1]])
    signals = {name: np.full(len(past_mps), value) for name, value in usual().items()} | dict(course.signals)
    value = 1.0 if drawn[0].effect.acts_as is Stage.GAIN else 0.0
    if course.shown is not None:
        axis.plot(course.time_s, course.shown, color=GREY, lw=0.8, label=course.shows)
    for one in drawn:
        output, _ = one.effect.over(value, past_mps, signals, course.period_s)
        axis.plot(course.time_s, output, label=one.label, lw=1.5, **one.style)
    axis.set_title(course.title, loc="left", fontsize="medium")
    axis.set_xlabel("time (s)")
    axis.set_ylabel(_answering(drawn[0].effect))


def _answering(effect: Effect) -> str:
    """What is written at the axis of a gain or a load."""
    return "gain g (-)" if effect.acts_as is Stage.GAIN else "force term phi, times its coefficient"


def _named(name: str) -> tuple[str, str]:
    """What is written at an axis: name and unit."""
    return ("speed one sample before", "m/s") if name == SPEED else (name, SIGNALS[name].unit)


def settled(effect: Effect, name: str, x: np.ndarray) -> np.ndarray:
    """The output (N,) over the values `x` (N,) of one input, once it has been held for long enough."""
    signals = {key: np.full(len(x), value) for key, value in usual().items()}
    if name != SPEED:
        signals[name] = x
    speed = x if name == SPEED else np.full(len(x), RANGES[SPEED][1])
    value, state = (1.0 if effect.acts_as is Stage.GAIN else 0.0), effect.start(np.zeros(len(x)))
    result, state = effect.step(value, speed, signals, state, SETTLING_S)
    if state is not None:
        for _ in range(round(SETTLED_S / SETTLING_S)):
            result, state = effect.step(value, speed, signals, state, SETTLING_S)
    return np.broadcast_to(result, len(x))


def _response(axis: Any, drawn: Sequence[Curve]) -> None:
    """The speed of a first-order machine after a step up, a short dip and a step down, without the effect and with."""
    time_s = np.arange(0.0, 16.0, PERIOD_S)
    current_ma = np.select(
        [time_s < 1.0, time_s < 6.0, time_s < 6.5, time_s < 11.0], [400.0, 800.0, 400.0, 800.0], 400.0
    )
    axis.plot(time_s, answer(None, current_ma), color=GREY, ls=":", lw=2.0, label="without")
    for one in drawn:
        axis.plot(time_s, answer(one.effect, current_ma), label=one.label, lw=1.5, **one.style)
    orders = drawn[0].effect.restructured(1, 1, DELAY, PERIOD_S)
    extra = f", poles of {RINGING_HZ:g} Hz added" if orders[0] > 1 else ""
    axis.set_title(f"current from 400 to 800 mA, a dip of 0.5 s, and back{extra}", loc="left", fontsize="medium")
    axis.set_xlabel("time (s)")
    axis.set_ylabel("speed (m/s)")


def answer(effect: Effect | None, current_ma: np.ndarray) -> np.ndarray:
    """Speeds (N,) in m/s of the machine at rest in its first current; `effect` may change its structure."""
    na, nb, delay = (1, 1, DELAY) if effect is None else effect.restructured(1, 1, DELAY, PERIOD_S)
    denominator = np.array([1.0, -np.exp(-PERIOD_S / TIME_CONSTANT_S)])
    radps = 2.0 * np.pi * RINGING_HZ
    pole = np.exp(radps * PERIOD_S * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2)))
    for _ in range((na - 1) // 2):
        denominator = np.convolve(denominator, [1.0, -2.0 * pole.real, abs(pole) ** 2])
    drive = GAIN_MPS_PER_MA * float(np.sum(denominator))
    theta = (*(-denominator[1:]).tolist(), drive, *(0.0,) * nb)
    model = Model(PERIOD_S, na, nb, delay, () if effect is None else (effect,), theta)
    signals, first = usual(), [float(current_ma[0])] * round(20.0 / PERIOD_S)
    state = model.start(0.0, first[0], signals)
    currents = [*first, *current_ma.tolist()]
    return np.array(model.predict(state, currents, [signals] * len(currents))[len(first) :])
