"""Where fits of an effect begin: on the way from neutral to far, or where recordings say that it would act at all."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Parameter
from cruise.effects.effect import EMPTY_KG, GRAVITY_MPS2
from cruise.effects.power_limit import PowerLimit, demand_kw
from cruise.effects.rate_limit import RateLimit
from cruise.recording import Recording
from cruise.validation.line_pressure import force_of_a_bar
from cruise.validation.slope import PITCH

SHARES: Final = (0.03, 0.08, 0.18, 0.35, 0.55, 0.8, 0.93)  # of the way from a shape's neutral value to its far bound
RATES: Final = (0.85, 0.5, 0.3, 0.18, 0.11, 0.065, 0.04)  # of the fastest change of the current
ONSETS_PCT: Final = (65.0, 78.0, 88.0, 97.0)  # engine loads from which an electronic limit may cut the stroke,
DROOPS: Final = (((0.1, 1.0), (0.3, 1.0)), ((0.2, 40.0), (0.4, 60.0)))  # shares that engines lose, loads from which on,
DROOPING_S: Final = 0.5  # and how slowly
CUTS: Final = (0.003, 0.01, 0.03)  # and how fast, per percent and second
ROLLING: Final = 0.04  # resistance over weight of the ground where such fits start
AT_ONCE_S: Final = 0.1  # s in which a soft limit may be followed,
HOLDS: Final = ((("hold", 0.5), ("follow_s", AT_ONCE_S)), (("hold", 1.0),))  # and a hard one as the current is
# Shares of the powers that the ground asks for below such a limit.
DEMANDED: Final = (0.7, 0.8, 0.87, 0.91, 0.94, 0.96, 0.975, 0.985, 0.993)
CUT_OFFS: Final = (0.75, 0.9, 0.97)  # shares of the pressures below that from which a cut-off may destroke the pump,
BAR_CUTS: Final = (0.003, 0.01)  # and by how much, per bar
WIDE: Final = 5.0  # ratio of the bounds from which that way is walked in ratios

Shapes = tuple[tuple[str, float], ...]
Starts = tuple[Shapes, ...]


def _rates(recordings: Sequence[Recording]) -> tuple[Starts]:
    """Rates of the current that limit less and less of its changes: a limit above all of them leaves no trace."""
    bound = RateLimit.parameters["rate_ma_per_s"]
    moves = np.concatenate([np.abs(np.diff(one.input)) / one.dt_s for one in recordings])
    fastest = float(np.nanmax(moves, initial=0.0))
    return (tuple((("rate_ma_per_s", min(max(share * fastest, bound.low), bound.high)),) for share in RATES),)


def _falls(recordings: Sequence[Recording]) -> tuple[Starts, Starts]:
    """The paces of braking, and limits of how fast the drive may fall."""
    (rates,) = _rates(recordings)
    paces = tuple(walked("active_braking", share, "fall_ma_per_s") for share in SHARES)
    return paces, tuple((("fall_ma_per_s", rate),) for ((_, rate),) in rates)


def _oils(recordings: Sequence[Recording]) -> tuple[Starts, ...]:
    """Losses in hot oil, paces in cold, and drag in cold."""
    ways = ("loss_share", "pace_exponent", "drag_share")
    return tuple(
        tuple(walked("oil_temperature", share, *(one for one in ways if one != way)) for share in SHARES)
        for way in ways
    )


def _droops(recordings: Sequence[Recording]) -> tuple[Starts, ...]:
    """Engines that give way from no load on, and from a load on."""
    slow = ("filter_s", DROOPING_S)
    return tuple(tuple((("droop_share", share), ("onset_pct", onset), slow) for share, onset in way) for way in DROOPS)


def _leaks(recordings: Sequence[Recording]) -> tuple[Starts]:
    """Gaps, orifices, and gaps that the pressure widens."""
    return (tuple((("exponent", exponent),) for exponent in (1.0, 0.6, 1.4)),)


def _powers(recordings: Sequence[Recording]) -> tuple[Starts, ...]:
    """Powers that may be taken, loads of the engine from which an electronic limit cuts, and pressures of a cut-off."""
    others = ("follow_s", "onset_pct", "cut_per_pct_s", "release_s", "cutoff_bar", "cut_per_bar")
    soft = [(*walked("power_limit", share, *others), ("follow_s", AT_ONCE_S)) for share in SHARES]
    hard = [
        (("power_kw", power_kw), ("rolling_resistance", ROLLING), *shapes)
        for shapes in HOLDS
        for power_kw in _demands_kw(recordings)
    ]
    ways = [(*soft, *hard)]
    if all("engine_load_pct" in one.columns for one in recordings):
        ways.append(tuple((("onset_pct", onset), ("cut_per_pct_s", cut)) for onset in ONSETS_PCT for cut in CUTS))
    if all("line_pressure_bar" in one.columns for one in recordings):
        bound = PowerLimit.parameters["cutoff_bar"]
        pressures = np.concatenate([one.columns["line_pressure_bar"] for one in recordings])
        onsets = np.clip(np.nanquantile(pressures, CUT_OFFS), bound.low, bound.high).tolist()
        ways.append(tuple((("cutoff_bar", onset), ("cut_per_bar", cut)) for onset in onsets for cut in BAR_CUTS))
    return tuple(ways)


def _demands_kw(recordings: Sequence[Recording]) -> list[float]:
    """Powers that slope and ground ask for seldom, and more seldom, and that the pressure shows."""
    bound, rolling = PowerLimit.parameters["power_kw"], ROLLING
    asked = []
    for one in recordings:
        mass_kg = one.columns.get("machine_mass_kg", np.full(len(one), EMPTY_KG))
        pull_mps2 = GRAVITY_MPS2 * np.sin(np.radians(one.columns[PITCH]))
        asked.append(demand_kw(one.output, pull_mps2, rolling, {"machine_mass_kg": mass_kg}))
    powers_kw = np.nanquantile(np.concatenate(asked), DEMANDED)
    bar = force_of_a_bar(recordings)
    if bar is not None:
        shown = [bar.kn_per_bar * one.columns["line_pressure_bar"] * one.output for one in recordings]
        powers_kw = np.concatenate([powers_kw, np.nanquantile(np.concatenate(shown), DEMANDED)])
    return np.unique(np.clip(powers_kw, bound.low, 0.99 * bound.high)).tolist()


def walked(name: str, share: float, *neutral: str) -> Shapes:
    """Shapes so far on their way from neutral values to their far bounds, but for those that stay neutral."""
    kind = EFFECTS[name]
    still = {*neutral, *kind.spare}
    return tuple((one, _on_the_way(bound, share)) for one, bound in kind.parameters.items() if one not in still)


def _on_the_way(bound: Parameter, share: float) -> float:
    far = max((bound.low, bound.high), key=lambda value: abs(value - bound.neutral))
    if min(bound.low, bound.neutral) > 0.0 and bound.high > WIDE * bound.low:
        return bound.neutral * (far / bound.neutral) ** share
    return bound.neutral + share * (far - bound.neutral)


BEGIN: Final[Mapping[str, Callable[[Sequence[Recording]], tuple[Starts, ...]]]] = {
    "rate_limit": _rates,
    "active_braking": _falls,
    "power_limit": _powers,
    "oil_temperature": _oils,
    "leakage": _leaks,
    "engine_droop": _droops,
}
"""Effects of which the recordings say where they would act at all: where their fits start."""
