"""Learning while the controller drives: half an hour of constant speed, and a hill while the gain drifts.

The whole service drives the virtual combine over the bus, in lockstep (cruise.service.demo). Offset, disturbance and
drifting parameters: with K the model's steady gain, the learned K must follow the machine's own (a hill
takes some of it too), hill and drift together must move K as much as each alone, and c_0 stands still while engaged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from msgspec import structs

from cruise import settings
from cruise.estimation.estimator import Estimator, EstimatorSettings
from cruise.estimation.gate import GateSettings
from cruise.model.model import Model
from cruise.plant import Combine, Inputs, PlantSettings
from cruise.service import demo
from cruise.service import settings as service_settings
from cruise.service.course import Drive, FieldRow, OperatorRow, value_at
from cruise.service.demo import Result
from cruise.service.figures import drive_figures
from cruise.signals import Sample

from .figures import Figure, Part
from .recordings import CONFIG

SEED = 0  # the drive as it is written here, without variation
LOW_MPS, HIGH_MPS = 1.2, 1.6
HOLD_S = 15.0  # s between setpoint changes
STEPS_S = 45.0  # s, first setpoint change: engaged and settled by then
CONSTANT_S = 1800.0  # issue 2: 30 minutes of constant speed
SETTLED_SHARE = 0.1  # of the step; 0.04 m/s, what hysteresis and noise leave at constant speed stays within
BOUNDED = 1.0 + 1e-6  # never less certain than the factory's model, up to rounding
DRIFT_S = (60.0, 150.0)  # s, between which the pump loses displacement
LOST_SHARE = 0.2  # of its displacement, so of the gain
HILL_S = (98.0, 128.0)  # s, up and down again, each between two setpoint changes
HILL_WITH_CHANGE_S = (105.0, 135.0)  # s, the worst case: each together with one, and the gate is open
HILL_OVER_S, HILL_DEG, HILL_ROLLING = 5.0, 4.0, 0.08
LEVEL_ROLLING = 0.05  # stubble
END_S = 195.0
CURRENT_MA, SMALL_STEP_MA = 900.0, 20.0  # where the true gain is taken: about 1.4 m/s in second gear
SETTLE_S = 12.0  # s, by then it stands still
CROSSTALK_PCT = 5.0  # of the gain; our own bound, half the overshoot that is allowed

START = (
    OperatorRow(at_s=0.5, cruise_enable=1.0),
    OperatorRow(at_s=2.0, over_s=5.0, lever_pct=60.0),
    OperatorRow(at_s=9.0, over_s=2.0, lever_pct=40.0),
    OperatorRow(at_s=13.0, over_s=2.0, lever_pct=55.0),
    OperatorRow(at_s=20.0, press="set"),
    OperatorRow(at_s=25.0, setpoint_mps=LOW_MPS),
)


def setpoints(from_s: float, until_s: float) -> tuple[OperatorRow, ...]:
    """Up and down by turns, ending low."""
    count = 2 * round((until_s - from_s) / HOLD_S / 2)
    return tuple(
        OperatorRow(at_s=from_s + i * HOLD_S, setpoint_mps=LOW_MPS if i % 2 else HIGH_MPS) for i in range(count)
    )


def response(result: Result, change_s: float) -> tuple[float, float]:
    """Overshoot in percent and settling time in s of one setpoint change."""
    period_s = result.node.period_s
    columns = result.trace.columns()
    window = (columns["time_s"] > change_s - 1.0) & (columns["time_s"] < change_s + HOLD_S - 0.5)
    part = {name: column[window] for name, column in columns.items()}
    overshoot_pct = drive_figures(part, period_s, 1.0)["overshoot_pct"]
    away = np.abs(part["true_speed_mps"] - part["setpoint_mps"]) > SETTLED_SHARE * (HIGH_MPS - LOW_MPS)
    away &= part["time_s"] > change_s
    return overshoot_pct, float(part["time_s"][away].max(initial=change_s)) - change_s


@dataclass
class Watch:
    """Looks on while driving: the samples, and how gain, offset and disturbance move while engaged."""

    plant: PlantSettings
    drifts: bool = False
    samples: list[Sample] = field(default_factory=list)
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def __call__(self, now_s: float, result: Result) -> None:
        """Once a second: write down time, gain relative to the factory's, c_0 and d; let the pump wear."""
        node = result.node
        if node.sample is not None and (not self.samples or node.sample is not self.samples[-1]):
            self.samples.append(node.sample)
        if node.ticks % round(1.0 / node.period_s):
            return
        model, factory = node.estimator.snapshot(), node.estimator.factory
        if node.engagement.state.controls:
            gain = model.dc_gain_mps_per_ma / factory.dc_gain_mps_per_ma
            self.rows.append((now_s, gain, model.theta[-1], node.command.disturbance_mps))
        if self.drifts:
            result.combine.change(worn(self.plant, now_s))

    def at(self, from_s: float, until_s: float) -> np.ndarray:
        """Means of gain, c_0 and d over a span of time; NaN where nothing was engaged."""
        rows = np.array([row[1:] for row in self.rows if from_s < row[0] <= until_s])
        return rows.mean(axis=0) if len(rows) else np.full(3, np.nan)


def worn(plant: PlantSettings, now_s: float) -> PlantSettings:
    """The machine with what its pump has lost by now."""
    lost = LOST_SHARE * float(np.interp(now_s, DRIFT_S, (0.0, 1.0)))
    pump = structs.replace(plant.pump, displacement_cm3=plant.pump.displacement_cm3 * (1.0 - lost))
    return structs.replace(plant, pump=pump)


def hill_rows(up_s: float, down_s: float) -> tuple[FieldRow, ...]:
    """Level, a hill of soft soil, level."""
    return (
        FieldRow(at_s=0.0, grade_deg=0.0, rolling_resistance=LEVEL_ROLLING),
        FieldRow(at_s=up_s, over_s=HILL_OVER_S, grade_deg=HILL_DEG, rolling_resistance=HILL_ROLLING),
        FieldRow(at_s=down_s, over_s=HILL_OVER_S, grade_deg=0.0, rolling_resistance=LEVEL_ROLLING),
    )


def true_gain_mps_per_ma(plant: PlantSettings, grade_deg: float, rolling_resistance: float) -> float:
    """Steady speed per current by a small step on the machine itself, without the loop of its hysteresis."""
    still = structs.replace(plant, effects=structs.replace(plant.effects, hysteresis=0.0))
    speeds = []
    for current_ma in (CURRENT_MA - SMALL_STEP_MA, CURRENT_MA + SMALL_STEP_MA):
        combine = Combine(still, SEED)
        combine.advance(Inputs(current_ma, grade_deg=grade_deg, rolling_resistance=rolling_resistance), SETTLE_S)
        speeds.append(combine.truth.ground_speed_mps)
    return (speeds[1] - speeds[0]) / (2.0 * SMALL_STEP_MA)


def ungated_std_ratio(factory: Model, samples: Sequence[Sample]) -> float:
    """Largest theta_std over the factory's when all parameters learn from all samples, excitation or not."""
    gate = GateSettings(excitation_min_mps=0.0)
    estimator = Estimator(factory, EstimatorSettings(gate=gate))
    largest = 0.0
    for sample in samples:
        estimator.learn(replace(sample, engaged=False))
        largest = max(largest, float(np.max(estimator.rls.std() / np.array(factory.theta_std))))
    return largest


def constant_speed(constant_s: float = CONSTANT_S) -> Part:
    """Half an hour at one speed, and the same setpoint change before and after."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    resumed_s = STEPS_S + 2 * HOLD_S + constant_s
    end_s = resumed_s + 2 * HOLD_S
    operator = (*START, *setpoints(STEPS_S, STEPS_S + 2 * HOLD_S), *setpoints(resumed_s, end_s))
    watch = Watch(plant)
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    result = demo.run(cruise, plant, Drive(seconds=end_s, operator=operator), SEED, end_s, show=watch)
    factory, learned = result.node.estimator.factory, result.node.estimator.snapshot()
    constant = [sample for sample in watch.samples if resumed_s - constant_s < sample.time_s <= resumed_s]
    columns = result.trace.columns()
    times_s = columns["time_s"]
    still = (times_s > resumed_s - constant_s + HOLD_S) & (times_s <= resumed_s)
    ratio = float(np.max(np.divide(learned.theta_std, factory.theta_std)))
    figures = [
        Figure("constant_speed_s", constant_s, "s", "time at constant speed"),
        Figure("gate_open_share", float(columns["gate_open"][still].mean()), "1", "share of it with the gate open"),
        Figure("std_ratio", ratio, "1", "largest theta_std over the factory's, after it", BOUNDED),
        Figure(
            "std_ratio_ungated",
            ungated_std_ratio(factory, constant),
            "1",
            "the same, gate open without excitation, largest on the way",
            BOUNDED,
        ),
    ]
    for name, offset_s in (("up", 0.0), ("down", HOLD_S)):
        before, after = response(result, STEPS_S + offset_s), response(result, resumed_s + offset_s)
        figures += [
            Figure(f"overshoot_{name}_before_pct", before[0], "%", f"overshoot {name}, before", 10.0),
            Figure(f"overshoot_{name}_after_pct", after[0], "%", f"overshoot {name}, after", 10.0),
            Figure(f"settling_{name}_before_s", before[1], "s", f"settling {name}, before"),
            Figure(f"settling_{name}_after_s", after[1], "s", f"settling {name}, after", before[1] + 0.5),
        ]
    return Part(tuple(figures), (SEED,))


@dataclass(frozen=True)
class Case:
    """One drive: where the hill is, and whether the pump wears."""

    field: tuple[FieldRow, ...]
    drifts: bool


CASES = {
    "hill": Case(hill_rows(*HILL_S), False),
    "hill_at_change": Case(hill_rows(*HILL_WITH_CHANGE_S), False),
    "drift": Case(hill_rows(*HILL_S)[:1], True),
    "both": Case(hill_rows(*HILL_S), True),
}


def true_gains(plant: PlantSettings, case: Case, times_s: np.ndarray) -> np.ndarray:
    """The machine's own gain at these times, relative to the first."""
    found = []
    for time_s in times_s.tolist():
        machine = worn(plant, time_s) if case.drifts else plant
        grade_deg = value_at(case.field, "grade_deg", 0.0, time_s)
        rolling_resistance = value_at(case.field, "rolling_resistance", LEVEL_ROLLING, time_s)
        found.append(true_gain_mps_per_ma(machine, grade_deg, rolling_resistance))
    return np.array(found) / found[0]


def together(end_s: float = END_S) -> Part:
    """Hill alone, drift alone, both: do offset, disturbance and drifting parameters explain the same thing twice?"""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    operator = (*START, *setpoints(STEPS_S, end_s))
    times_s = np.arange(DRIFT_S[0], end_s + 1.0, HOLD_S)
    learned, true, disturbance, offset_moved = {}, {}, {}, 0.0
    for name, case in CASES.items():
        watch = Watch(plant, case.drifts)
        demo.run(cruise, plant, Drive(seconds=end_s, field=case.field, operator=operator), SEED, end_s, show=watch)
        rows = np.array([watch.at(time_s - HOLD_S, time_s) for time_s in times_s.tolist()])
        learned[name], disturbance[name] = rows[:, 0] / rows[0, 0], rows[:, 2]
        true[name] = true_gains(plant, case, times_s - 0.5 * HOLD_S)
        offset_moved = max(offset_moved, float(np.ptp([row[2] for row in watch.rows])))
    on_hill = (times_s > HILL_S[0] + HOLD_S) & (times_s <= HILL_S[1])
    figures = [Figure("c_0_moved_mps", offset_moved, "m/s", "c_0 moved while engaged, all cases", 0.0)]
    for name in CASES:
        off_pct = 100.0 * np.abs(learned[name] / true[name] - 1.0)
        mean_d_mps = float(disturbance[name][on_hill].mean())
        figures += [
            Figure(f"{name}_gain_error_pct", float(off_pct.max()), "%", f"{name}: learned gain off, largest"),
            Figure(f"{name}_gain_error_end_pct", float(off_pct[-1]), "%", f"{name}: learned gain off, at the end"),
            Figure(f"{name}_d_mps", mean_d_mps, "m/s", f"{name}: mean d in the time of the hill"),
        ]
    crosstalk = Figure(
        "crosstalk_pct",
        100.0 * float(np.abs(learned["both"] - learned["drift"] * learned["hill"]).max()),
        "%",
        "both: learned gain against the product of hill and drift alone",
        CROSSTALK_PCT,
    )
    late_pct = 100.0 * abs(float(learned["hill"][-1] / true["hill"][-1]) - 1.0)
    taken_pct = 100.0 * (1.0 - float(true["hill"].min()))
    since_s = float(times_s[-1]) - HILL_S[1]
    note = (
        f"c_0 moved by {offset_moved:.2g} m/s; hill and drift at once give the gain of the two alone within "
        f"{crosstalk.value:.1f} %. The hill takes {taken_pct:.0f} % of the machine's own gain; {since_s:.0f} s later "
        f"the learned gain is still {late_pct:.0f} % off: that error is too small to shorten the memory."
    )
    columns = {"until_s": times_s.tolist()}
    for name in CASES:
        columns |= {
            f"true {name}": true[name].tolist(),
            f"learned {name}": learned[name].tolist(),
            f"d {name}": disturbance[name].tolist(),
        }
    return Part((*figures, crosstalk), (SEED,), (note,), columns)
