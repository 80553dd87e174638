"""A little of everything: how much of every other effect an explanation needs beside it until only noise is left.

    C = sum_k r_k^2 / s^2 + sum_i d_i^2 + sum_j b_j^2 / t_j^2 + ln det(1 + V X'X / s^2),   r = F (e - J d - Z b)
    t_j^2 = t^2 + (q a_j)^2,   s^2 = s_0^2 / w,   X = F [J, Z],   V = diag(1, t_j^2)
    evidence = C without - C with

e error of the explanation, J its derivatives by its own parameters in units of a typical change, or of half the way to
their nearest bound where that is less, d how far they move, z_j the error that effect j takes away, scaled to an RMS of
1, b_j how much of it there is in m/s, a_j how much of z_j is in what the explanation takes away, q how wrong its form
may be, s_0 the noise when everything may help, t what passes for little (one for effects that change the dynamics,
where no core is exact, one for all others), F whitens what nobody recorded. Real machines have a little of every
effect, and no form is exact: asked only which candidate leaves the smallest error, the data name the one that also
covers for the others' background. Here the right one wins because it leaves nothing large to anybody else; where
everything is small, nothing is missing. C is minus twice the log of the marginal likelihood with d from N(0, 1) and b
from N(0, t_j^2), up to a constant; t is where it is greatest.
Source: D. J. C. MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415-447.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from cruise.identification.structures import OF_THE_CORE
from cruise.validation.disturbance import Disturbance
from cruise.validation.fitting import Fit, bounded

WEIGHT: Final = 0.25  # w: no form is exact, so that one sample in four speaks
LITTLE: Final = (0.03, 0.06, 0.09, 0.13, 0.18, 0.25)  # t / s_0, up to what would be an effect of its own
MODEST: Final = 2.0  # C that a larger t has to save for every step of `LITTLE`
FORM: Final = 0.1  # q
ROOM: Final = 2.0  # standard deviations of a parameter that reach to its nearest bound, or further
LIKELIEST: Final = 4  # explanations beside which a second effect is looked for,
SECOND: Final = 20.0  # and C that it has to save
DYNAMICS: Final = frozenset({"hysteresis", "rate_limit", "transport_delay", "active_braking", "resonance"})
STRUCTURAL: Final = frozenset(OF_THE_CORE)  # effects that live in the core
NOTHING_MPS: Final = 1e-5  # RMS of what an effect moves, below which it is not there
LEAST_SPOKEN: Final = 0.5  # share of the judged time of which an effect's signals must be known


@dataclass(frozen=True, eq=False)
class Product:
    """X'X, X'e and e'e of an explanation, and a; the last columns of X are the directions of all effects."""

    squares: np.ndarray
    pull: np.ndarray
    left: float
    alike: np.ndarray


class Background:
    """Evidence of explanations of the same recordings, each beside a little of every effect in `effects`."""

    def __init__(
        self,
        present: Fit,
        effects: Mapping[str, Fit],
        disturbance: Disturbance,
        sources: Sequence[str] = (),
        seen: tuple[float, frozenset[str]] = (0.0, frozenset()),
    ) -> None:
        """`present` is what all are compared with; `sources` are those of `effects` that may be in the background.

        `seen` is the RMS in m/s of what a measurement of its own shows, and the effects that show there; all other
        explanations have it in their background.
        """
        self.disturbance = disturbance
        self.seen_mps, self.showing = seen
        judged = np.isfinite(disturbance.whiten(present.error_mps))
        spoken = {name: judged & np.isfinite(disturbance.whiten(one.error_mps)) for name, one in effects.items()}
        speaking = [
            name
            for name, one in effects.items()
            if spoken[name].sum() > LEAST_SPOKEN * judged.sum() and one.cost <= present.cost
        ]  # a fit that went astray shows nothing
        self.known = np.all([judged, *(spoken[name] for name in speaking)], axis=0)
        self.directions: dict[str, np.ndarray] = {}
        self.sizes_mps: dict[str, float] = {}  # that they have alone
        self.error_mps = present.error_mps
        for name in (name for name in sources if name in speaking):
            moved = present.error_mps - effects[name].error_mps
            size = float(np.sqrt(np.mean(bounded(moved[self.known]) ** 2)))
            if size > NOTHING_MPS:
                self.directions[name] = self._white(moved / size)
                self.sizes_mps[name] = size
        self.present = self._product(present)
        best = np.linalg.lstsq(self.present.squares, self.present.pull, rcond=1e-6)[0]
        self.noise = max(
            (self.present.left - float(best @ self.present.pull)) / max(int(self.known.sum()), 1), 1e-12
        )  # s_0^2
        self.own = {name: self._product(effects[name]) for name in speaking}
        self.little = (LITTLE[0], LITTLE[0])

    def settle(self, causes: Collection[str]) -> None:
        """Choose both t: where the best explanation by one of the `causes` is likeliest, or by two of them.

        The second is about as large as it is alone. Two that are missing would else pass for a large background, beside
        which neither is more than a little.
        """
        named = [name for name in causes if name in self.own]

        def likelihood(little: tuple[float, float]) -> float:
            self.little = little
            alone = {name: self.evidence(name) for name in named}
            likeliest = sorted(named, key=lambda name: alone[name], reverse=True)[:LIKELIEST]
            two = [alone[name] + self._second(name, named) - SECOND for name in likeliest]
            best = max([0.0, *alone.values(), *two])
            return best - self._cost(self.present) - MODEST * sum(LITTLE.index(t) for t in little)

        self.little = max(product(LITTLE, LITTLE), key=likelihood)

    def _second(self, name: str, causes: Collection[str]) -> float:
        """C that the best second effect beside an explanation saves."""
        one = self.own[name]
        without_it = self._cost(one, name)
        others = [other for other in self.directions if other != name and other in causes]
        return max((without_it - self._cost(one, name, large=other) for other in others), default=0.0)

    def evidence(self, name: str) -> float:
        """C without minus C with the effect; 0 for one that can say nothing of most of the time, or went astray."""
        if name not in self.own:
            return 0.0
        return self._cost(self.present) - self._cost(self.own[name], name)

    def evidence_of(self, one: Fit, names: Sequence[str]) -> float:
        """The same for any explanation, which holds the effects `names`."""
        return self._cost(self.present) - self._cost(self._product(one), *names)

    def _white(self, errors: np.ndarray) -> np.ndarray:
        return bounded(self.disturbance.whiten(errors)[..., self.known])

    def _product(self, one: Fit) -> Product:
        error = self._white(one.error_mps)
        taken = self._white(self.error_mps) - error
        moves = np.minimum(one.layout.scale, one.room / ROOM)
        slopes = self._white(bounded(one.jacobian.T * moves[:, None]))
        columns = np.vstack([slopes, *self.directions.values()])
        alike = np.array([float(z @ taken) / max(float(z @ z), 1e-12) for z in self.directions.values()])
        return Product(columns @ columns.T, columns @ error, float(error @ error), alike)

    def _cost(self, one: Product, *names: str, large: str = "") -> float:
        """C of an explanation with the effects `names`; beside it `large` may be as much as alone, or as noise is."""
        noise = self.noise / WEIGHT
        little = np.array([self.noise * self._little(name) ** 2 for name in self.directions])
        if large:
            little[list(self.directions).index(large)] = max(self.sizes_mps[large] ** 2, self.noise)
        width = np.concatenate([np.ones(len(one.pull) - len(little)), little + (FORM * one.alike) ** 2])
        squares = one.squares * np.sqrt(np.outer(width, width)) / noise + np.eye(len(width))
        pull = one.pull * np.sqrt(width) / noise
        fitted = float(pull @ np.linalg.solve(squares, pull))
        seen = 0.0 if self.showing & set(names) else self.seen_mps**2 / (self.noise * LITTLE[-1] ** 2)
        return one.left / noise - fitted + seen + float(np.linalg.slogdet(squares)[1])

    def _little(self, name: str) -> float:
        """t / s_0 of an effect: of those that change the dynamics, or of the others."""
        return self.little[0 if name in DYNAMICS else 1]
