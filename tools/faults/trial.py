"""One trial: a fault at a random time in a random manoeuvre, and what became of it.

Detected: cruise lets go, or does not take over, while the fault is there or for a while after it. Harmless: until the
end the true speed stays within 0.3 m/s of what the operator asked for, as a machine can follow it, and the true
acceleration within 1.5 m/s2 while the machine does what a command of cruise says, or neither is more than the same
drive shows without the fault (a hill in a fast gear). After an exit no command may be active. A fault that is neither
is a silent failure. One that lasts beyond the end of the drive is given more time before it is called one: downhill in
a fast gear a drive line that is open shows only once the current has fallen for long.
"""

import math
from dataclasses import dataclass, replace
from random import Random
from typing import Any, Final

from .bed import Bed, Row
from .manoeuvres import SECONDS, manoeuvre
from .row import FaultRow

OVERSPEED_MPS: Final = 0.3
ACCEL_MPS2: Final = 1.5
AFTER_S: Final = 1.5  # s that a trial goes on after the exit: nothing may become active again
LINGER_S: Final = 3.0  # s after the fault in which an exit is still its work
LASTING_S: Final = 15.0  # s of a fault that lasts, before it is called silent
ACCEL_ROWS: Final = 4  # frames over which the acceleration is taken: 0.2 s, shorter ones are tyres
PERIOD_S: Final = {"DriveFeedback": 0.02, "EEC1": 0.02, "ETC2": 0.1, "MachineState": 0.05}
PANEL_PERIOD_S: Final = 0.1
PERIODS, LEAST_S = 3.0, 0.3  # a time-out acts within so many periods of its message, or so many seconds


@dataclass(frozen=True)
class Outcome:
    """What became of one fault. Times in s, NaN where there is none."""

    fault: str
    seed: int
    from_s: float
    to_s: float
    verdict: str  # detected, refused, harmless, bounded, silent, or void: an exit came before the fault
    how: str  # the exit's condition and reason, or the contradiction, or what stood in the way
    after_s: float  # from the fault to the exit
    silence_s: float  # from the last frame of the message that is silenced to the exit
    overspeed_mps: float
    accel_mps2: float
    active_after: bool  # a command after the exit
    crashed: bool = False  # the service was ended by an exception, and not because it refused to start

    @property
    def in_time(self) -> bool:
        """Whether a time-out acted in time; True where none had to."""
        return not self.silence_s > self.allowed_s + 1e-6

    @property
    def allowed_s(self) -> float:
        """What a time-out may take."""
        message = self.fault.removesuffix(" lost") if self.fault.endswith(" lost") else "CCVS"
        return max(LEAST_S, PERIODS * PERIOD_S.get(message, PANEL_PERIOD_S))

    @property
    def failed(self) -> bool:
        """Whether anything here must not be."""
        return self.verdict in ("silent", "void") or self.active_after or self.crashed or not self.in_time

    def as_json(self) -> dict[str, Any]:
        """By name; NaN becomes None."""
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in vars(self).items()
        }


@dataclass(frozen=True)
class Plan:
    """When a fault comes and goes, in which manoeuvre."""

    row: FaultRow
    seed: int
    from_s: float
    to_s: float
    seconds: float = SECONDS

    @classmethod
    def of(cls, row: FaultRow, seed: int) -> "Plan":
        """By the dice of the seed: one in six is there before the operator engages, half go away again after that."""
        rng = Random(f"{row.name} {seed}")
        engage_s = manoeuvre(seed).engage_s
        from_s = rng.uniform(2.5, engage_s) if rng.random() < 1.0 / 6.0 else rng.uniform(engage_s + 0.3, SECONDS - 5.0)
        to_s = math.inf if rng.random() < 0.5 or row.lasting else max(from_s, engage_s) + rng.uniform(0.2, 4.0)
        return cls(row, seed, 0.0, math.inf) if row.from_start else cls(row, seed, round(from_s, 2), to_s)


def run(plan: Plan) -> Outcome:
    """Drive it, and longer where it would be called silent while it lasts."""
    found = judge(plan, driven(plan))
    if found.verdict != "silent" or math.isfinite(plan.to_s):
        return found
    longer = replace(plan, seconds=max(plan.seconds, plan.from_s + LASTING_S))
    return judge(longer, driven(longer))


def driven(plan: Plan) -> Bed:
    """The drive itself."""
    fault = plan.row.make(Random(f"{plan.seed} {plan.row.name}"))
    return Bed(manoeuvre(plan.seed), fault).run(plan.seconds, plan.from_s, plan.to_s, AFTER_S)


def judge(plan: Plan, bed: Bed) -> Outcome:
    """What the drive shows."""
    exited = bed.exit
    exit_s = exited.time_s if exited is not None else math.nan
    took_over = bed.reference is not None
    within = plan.from_s <= exit_s <= plan.to_s + LINGER_S
    overspeed_mps, accel_mps2 = _harm([row for row in bed.rows if row.time_s >= plan.from_s])
    how = exited.how if exited is not None else bed.died or bed.node.engagement.refused
    harmless = overspeed_mps <= OVERSPEED_MPS and accel_mps2 <= ACCEL_MPS2
    if not harmless and took_over and not within:
        usual_mps, usual_mps2 = _harm_without(plan)
        harmless = overspeed_mps <= max(OVERSPEED_MPS, usual_mps) and accel_mps2 <= max(ACCEL_MPS2, usual_mps2)
    if exit_s < plan.from_s:
        verdict = "void"
    elif not took_over:
        verdict = "refused" if plan.from_s <= manoeuvre(plan.seed).engage_s else "silent"
    elif within:
        verdict = "detected"
    elif harmless:
        verdict = "harmless"
    else:
        verdict = "bounded" if plan.row.bounded and accel_mps2 <= ACCEL_MPS2 else "silent"
    silence_s = math.nan
    if plan.row.silences and verdict == "detected" and plan.to_s - plan.from_s > LEAST_S:
        assert exited is not None
        silence_s = exit_s - exited.intact_s.get(plan.row.silences, math.nan)
    active_after = any(active and time_s > bed.left_s - 1e-6 for time_s, active, _ in bed.commands)
    return Outcome(
        plan.row.name, plan.seed, plan.from_s, plan.to_s, verdict, how, exit_s - plan.from_s if within else math.nan,
        silence_s, overspeed_mps, accel_mps2, active_after, bool(bed.died) and bed.started,
    )  # fmt: skip


def _harm_without(plan: Plan) -> tuple[float, float]:
    """The same of the same drive without the fault."""
    bed = Bed(manoeuvre(plan.seed)).run(plan.seconds)
    return _harm([row for row in bed.rows if row.time_s >= plan.from_s])


def _harm(rows: list[Row]) -> tuple[float, float]:
    """Greatest overspeed, and greatest acceleration that a command can have caused."""
    overspeed = [row.speed_mps - row.allowed_mps for row in rows if math.isfinite(row.allowed_mps)]
    accels = [
        abs(sum(row.accel_mps2 for row in rows[i - ACCEL_ROWS : i])) / ACCEL_ROWS
        for i in range(ACCEL_ROWS, len(rows))
        if all(row.obeyed for row in rows[i - ACCEL_ROWS : i])
    ]
    return max(overspeed, default=0.0), max(accels, default=0.0)
