"""Known systems come back: parameters within their standard errors, and standard errors that are the spread.

    within = share of seeds with every |theta - theta_0| < 3 std,    ratio = RMS of std / standard deviation of theta

over seeds, theta_0 the truth. Systems are simulated by hand, without the model: 120 s at 5 Hz, random steps of current;
the filtered one 180 s at 20 Hz with noise of an AR(1) with pole 0.9, columns and target through the paper's filter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from cruise.effects.dead_zone import DeadZone
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.identification.armax import fit_armax
from cruise.identification.arx import fit_arx
from cruise.identification.families import Identified
from cruise.identification.output_error import fit_output_error
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

from .figures import Figure, Part

SEEDS = tuple(range(200))
PERIOD_S, SECONDS = 0.2, 120.0
FAST_S, FILTERED_SECONDS = 0.05, 180.0
WITHIN_AT_LEAST, RATIO_LOW, RATIO_HIGH = 0.95, 0.8, 1.2  # issue 3


@dataclass(frozen=True)
class System:
    """A truth: how a recording of it comes about from a seed, how it is fitted, and its parameters."""

    record: Callable[[int], Recording]
    fit: Callable[[Recording], Identified]
    truth: tuple[float, ...]


def currents(rng: np.random.Generator, samples: int) -> np.ndarray:
    """Random steps of current in mA, held one to eight samples."""
    held = np.repeat(rng.uniform(450.0, 1000.0, samples), rng.integers(1, 9, samples))
    return held[:samples]


def filtered(b: Sequence[float], a: Sequence[float], values: np.ndarray) -> np.ndarray:
    """`values` (N,) through B / A, from rest."""
    return np.asarray(signal.lfilter(b, a, values))


def recording(current_ma: np.ndarray, speed_mps: np.ndarray, period_s: float = PERIOD_S) -> Recording:
    """A recording of current and speed."""
    time_s = period_s * np.arange(len(current_ma))
    return Recording(time_s, {INPUT: current_ma, OUTPUT: speed_mps}, period_s, "simulated")


def _linear(a: Sequence[float], b: Sequence[float], c_0: float, delay: int, c: Sequence[float] = (), oe: bool = False):
    """A y = B u + c_0 + C e, or with `oe` A w = B u + c_0, y = w + e; e white, 0.03 m/s."""

    def record(seed: int) -> Recording:
        rng = np.random.default_rng(seed)
        count, warm_up = round(SECONDS / PERIOD_S), 100
        current = currents(rng, count + warm_up)
        noise = 0.03 * rng.standard_normal(count + warm_up)
        poles = [1.0, *(-value for value in a)]
        driven = filtered([*(0.0,) * delay, *b], poles, current) + filtered([1.0], poles, np.full(len(current), c_0))
        speed = driven + (noise if oe else filtered([1.0, *c], poles, noise))
        return recording(current[warm_up:], speed[warm_up:])

    return record


def _hammerstein(seed: int) -> Recording:
    """y = 0.7 y + 3e-4 v + 4e-4 v - 0.04 + e behind a dead zone of 500 mA and a curvature of 0.6."""
    rng = np.random.default_rng(seed)
    current = currents(rng, round(SECONDS / PERIOD_S) + 100)
    beyond = np.maximum(current - 500.0, 0.0)
    v = beyond * (1.0 + 0.6 * beyond / 1000.0)
    noise = 0.03 * rng.standard_normal(len(current))
    forced = filtered([0.0, 0.0, 3e-4, 4e-4], [1.0], v) - 0.04 + noise
    return recording(current[100:], filtered([1.0], [1.0, -0.7], forced)[100:])


FIR = (5e-4, 3e-4, 2e-4, -0.3)  # b_0, b_1, b_2 in m/s per mA, c_0 in m/s


def _filtered(seed: int) -> Recording:
    """White noise on the current, coloured noise on the speed, at 20 Hz."""
    rng = np.random.default_rng(seed)
    count = round(FILTERED_SECONDS / FAST_S)
    current = 700.0 + 150.0 * rng.standard_normal(count)
    noise = 0.03 * filtered([1.0], [1.0, -0.9], rng.standard_normal(count))
    speed = filtered(FIR[:3], [1.0], current) + FIR[3] + noise
    return recording(current, speed, FAST_S)


def _structure(na: int, nb: int, delay: int, *effects, period_s: float = PERIOD_S) -> Model:
    return Model(period_s, na, nb, delay, effects, (0.0,) * (na + nb + 1))


_A, _B, _C_0, _DELAY = (1.2, -0.35), (3e-4, 2e-4), -0.05, 2
_ARX = _structure(2, 2, _DELAY)
_CURVED = _structure(1, 2, 2, DeadZone(500.0), QuadraticGain(0.6))
_SMOOTH = smoother(PreparationSettings(period_s=FAST_S), FAST_S)
SYSTEMS = {
    "arx": System(_linear(_A, _B, _C_0, _DELAY), lambda part: fit_arx(_ARX, [part]), (*_A, *_B, _C_0)),
    "armax": System(
        _linear(_A, _B, _C_0, _DELAY, (0.6,)), lambda part: fit_armax(_ARX, 1, [part]), (*_A, *_B, _C_0, 0.6)
    ),
    "output_error": System(
        _linear(_A, _B, _C_0, _DELAY, oe=True), lambda part: fit_output_error(_ARX, [part]), (*_A, *_B, _C_0)
    ),
    "hammerstein": System(_hammerstein, lambda part: fit_arx(_CURVED, [part]), (0.7, 3e-4, 4e-4, -0.04)),
    "filtered_fir": System(_filtered, lambda part: fit_arx(_structure(0, 3, 0, period_s=FAST_S), [part], _SMOOTH), FIR),
}


@dataclass(frozen=True)
class Recovery:
    """What the fits of many seeds say together."""

    within: float  # share of seeds with all parameters within 3 standard errors
    ratios: np.ndarray  # (n,) RMS standard error over spread
    bias: np.ndarray  # (n,) mean error in standard deviations of the mean
    converged: float  # share of seeds


def recovered(system: System, seeds: Sequence[int]) -> Recovery:
    """Fit a known system on recordings of these seeds."""
    found = [system.fit(system.record(seed)) for seed in seeds]
    theta, std = np.array([fit.theta for fit in found]), np.array([fit.theta_std for fit in found])
    error, spread = theta - system.truth, theta.std(axis=0, ddof=1)
    return Recovery(
        within=float((np.abs(error) < 3.0 * std).all(axis=1).mean()),
        ratios=np.sqrt(np.mean(std**2, axis=0)) / spread,
        bias=error.mean(axis=0) / (spread / np.sqrt(len(seeds))),
        converged=float(np.mean([fit.converged for fit in found])),
    )


def measure(seeds: Sequence[int] = SEEDS) -> Part:
    """Every system."""
    figures = []
    for name, system in SYSTEMS.items():
        found = recovered(system, seeds)
        text = name.replace("_", " ")
        figures += [
            Figure(
                f"{name}_within", found.within, "1", f"{text}: seeds with all within 3 errors", at_least=WITHIN_AT_LEAST
            ),
            Figure(
                f"{name}_ratio_least",
                float(found.ratios.min()),
                "1",
                f"{text}: standard error over spread, least",
                at_least=RATIO_LOW,
            ),
            Figure(f"{name}_ratio_most", float(found.ratios.max()), "1", f"{text}: most", RATIO_HIGH),
            Figure(f"{name}_converged", found.converged, "1", f"{text}: searches that converged"),
        ]
    return Part(tuple(figures), tuple(seeds))
