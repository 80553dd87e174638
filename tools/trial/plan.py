"""Which trials are held: every one by kind, effects, size and seed.

What is counted within one size, or of drives with nothing or with several effects, is of different drives. The sizes of
one effect, and the trial that leaves it out of the table, share a drive in one seed, as its sizes are looked for along
it: a share over all sizes is known a little less well than its interval says.
"""

from collections.abc import Iterator, Sequence
from typing import Final, Literal

import msgspec
import numpy as np

from .draw import STREAM
from .effects import EFFECTS, UNLISTED, apart
from .trial import Tier

Kind = Literal["single", "nothing", "unlisted", "two", "three"]
KINDS: Final[tuple[Kind, ...]] = ("single", "nothing", "unlisted", "two", "three")
A_SEED: Final = {"nothing": 30, "two": 10, "three": 4}  # trials; 5 seeds make 150 without an effect
DRIVES: Final = {"single": 0, "nothing": 1_000_000, "two": 2_000_000, "three": 3_000_000}  # first seed of each kind
EFFECTS_OF: Final = {"two": 2, "three": 3}
NEXT_DRIVE: Final = 100_000  # added to the seed where an effect can't become as large on a drive as it should
PLACES: Final = 100  # seeds of the generator that belong to one seed of the plan


class Task(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One trial to be held. A left out effect is there, but stands in no table while the program searches."""

    tier: Tier
    kind: Kind
    effects: tuple[str, ...]  # that are to be found, or that nobody lists
    size: str
    seed: int  # of the generator

    @property
    def key(self) -> str:
        """Its name among all trials."""
        return f"{self.tier} {self.kind} {'+'.join(self.effects) or 'nothing'} {self.size} {self.seed}"


def plan(
    tier: Tier, kinds: Sequence[str], effects: Sequence[str], sizes: Sequence[str], seeds: Sequence[int]
) -> list[Task]:
    """All trials, seed by seed, so that a run that was stopped is a fair sample. The kinds, effects and sizes exist.

    single: every effect in every size. nothing: 30 a seed. unlisted: every effect of the table, left out of it, and
    those that were never in it, in one of the sizes each. two, three: 10 and 4 draws a seed.
    """
    return [task for seed in seeds for task in _round(tier, kinds, effects, sizes, seed)]


def _round(tier: Tier, kinds: Sequence[str], effects: Sequence[str], sizes: Sequence[str], seed: int) -> Iterator[Task]:
    listed = [name for name in effects if name in EFFECTS]
    if "single" in kinds:
        for size in sizes:
            for name in listed:
                yield Task(tier=tier, kind="single", effects=(name,), size=size, seed=_drive(name, seed))
    if "nothing" in kinds:
        for n in range(A_SEED["nothing"]):
            yield Task(tier=tier, kind="nothing", effects=(), size="", seed=DRIVES["nothing"] + PLACES * seed + n)
    if "unlisted" in kinds:
        for n, name in enumerate(effects):
            size = sizes[(n + seed) % len(sizes)]
            yield Task(tier=tier, kind="unlisted", effects=(name,), size=size, seed=_drive(name, seed))
    for kind in ("two", "three"):
        if kind in kinds:
            for n in range(A_SEED[kind]):
                drive = DRIVES[kind] + PLACES * seed + n
                names = together(listed, EFFECTS_OF[kind], drive)
                if names:
                    yield Task(tier=tier, kind=kind, effects=names, size=sizes[(n + seed) % len(sizes)], seed=drive)


def together(names: Sequence[str], count: int, seed: int) -> tuple[str, ...]:
    """So many effects, drawn from those that can be in one recording; none where there are not so many."""
    found: list[str] = []
    for name in np.random.default_rng([seed, STREAM]).permutation(np.array(names)).tolist():
        if len(found) < count and not any(apart(name, other) for other in found):
            found.append(name)
    return tuple(found) if len(found) == count else ()


def _drive(name: str, seed: int) -> int:
    return DRIVES["single"] + PLACES * seed + [*EFFECTS, *UNLISTED].index(name)
