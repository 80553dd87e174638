"""Draws trials: which effects, how large."""

from itertools import combinations
from typing import Final

import numpy as np

from .effects import EFFECTS, UNLISTED, Row, apart, ranges
from .trial import SIZES, Present, Tier, Trial

STREAM: Final = 4
SEEDS: Final = 2**31
KINDS: Final = {"one": 0.6, "nothing": 0.15, "unlisted": 0.1, "two": 0.1, "three": 0.05}
"""Shares of a mixture."""


def draw(tier: Tier, effect: str, size: str, seed: int) -> Trial:
    """The trial with one effect, listed or not, or with "nothing"; two or three effects are joined by "+".

    `size` is small, medium or large. Raises ValueError for what there is not.
    """
    if size not in SIZES:
        raise ValueError(f"no size {size}; there are {', '.join(SIZES)}")
    rng = np.random.default_rng([seed, STREAM])
    names = [] if effect == "nothing" else effect.split("+")
    unknown = [name for name in names if name not in EFFECTS and name not in UNLISTED]
    if unknown:
        raise ValueError(f"no effect {', '.join(unknown)}; there are nothing, {', '.join([*EFFECTS, *UNLISTED])}")
    for one, other in combinations(names, 2):
        if apart(one, other):
            raise ValueError(f"{one} and {other} can't be told apart in one recording")
    return Trial(
        tier=tier,
        seed=seed,
        effects=tuple(_present(name, EFFECTS[name], size, tier, rng) for name in names if name in EFFECTS),
        unlisted=tuple(_present(name, UNLISTED[name], size, tier, rng) for name in names if name in UNLISTED),
        background=0.0 if tier == "clean" else float(rng.uniform(0.05, 0.1)),
    )


def mixture(tier: Tier, count: int, seed: int) -> list[Trial]:
    """Trials of every kind in the shares of `KINDS`, with effects and sizes drawn at random."""
    rng = np.random.default_rng([seed, STREAM])
    return [draw(tier, _effects(rng), str(rng.choice(SIZES)), int(rng.integers(SEEDS))) for _ in range(count)]


def _effects(rng: np.random.Generator) -> str:
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    if kind == "nothing":
        return kind
    if kind == "unlisted":
        return str(rng.choice(list(UNLISTED)))
    wanted, names = {"one": 1, "two": 2, "three": 3}[kind], []
    for name in rng.permutation(list(EFFECTS)).tolist():
        if len(names) < wanted and not any(apart(name, other) for other in names):
            names.append(name)
    return "+".join(names)


def _present(name: str, row: Row, size: str, tier: Tier, rng: np.random.Generator) -> Present:
    low, high = ranges(row, size, tier)
    return Present(effect=name, size=float(np.exp(rng.uniform(np.log(low), np.log(high)))))
