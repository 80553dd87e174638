"""Learning while the controller drives: half an hour of constant speed, and a hill while the gain drifts.

The whole service drives the virtual combine over the bus, in lockstep (cruise.service.demo). Offset, disturbance and
drifting parameters: with d the observer's disturbance and K the model's steady gain, a hill alone must move d and not
K, a drift alone K, and both together must give the sum of the two; c_0 stands still while engaged.
"""

from dataclasses import dataclass, field

import numpy as np
from msgspec import structs

from cruise import settings
from cruise.control.engagement import State
from cruise.plant import Combine, Inputs, PlantSettings
from cruise.service import demo
from cruise.service import settings as service_settings
from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.demo import Result
from cruise.service.figures import drive_figures

from .figures import Figure, Part
from .recordings import CONFIG

SEED = 0  # the drive as it is written here, without variation
LOW_MPS, HIGH_MPS = 1.2, 1.6
HOLD_S = 15.0  # s between setpoint changes
STEPS_S = 45.0  # s, first setpoint change: engaged and settled by then
CONSTANT_S = 1800.0  # issue 2: 30 minutes of constant speed
SETTLED_SHARE = 0.1  # of the step; 0.04 m/s, what hysteresis and noise leave at constant speed stays within
DRIFT_S = (60.0, 180.0)  # s, between which the pump loses displacement
LOST_SHARE = 0.2  # of its displacement, so of the gain
HILL_S = (105.0, 150.0)  # s, up and down again
HILL_DEG = 4.0
END_S = 225.0
CURRENT_MA, SMALL_STEP_MA = 900.0, 20.0  # where the true gain is taken: about 1.4 m/s in second gear

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
    """Looks on while driving: how uncertain the parameters become, how gain, offset and disturbance move."""

    plant: PlantSettings
    drifts: bool = False
    std_ratio_max: float = 0.0
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def __call__(self, now_s: float, result: Result) -> None:
        """Once a second: write down time, gain relative to the factory's, c_0 and d; let the pump wear."""
        node = result.node
        if node.ticks % round(1.0 / node.period_s):
            return
        model, factory = node.estimator.snapshot(), node.estimator.factory
        self.std_ratio_max = max(self.std_ratio_max, *np.divide(model.theta_std, factory.theta_std).tolist())
        if node.engagement.state is State.ENGAGED:
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


def true_gain_mps_per_ma(plant: PlantSettings) -> float:
    """Steady speed per current by a small step on the machine itself, without the loop of its hysteresis."""
    still = structs.replace(plant, effects=structs.replace(plant.effects, hysteresis=0.0))
    speeds = []
    for current_ma in (CURRENT_MA - SMALL_STEP_MA, CURRENT_MA + SMALL_STEP_MA):
        combine = Combine(still, SEED)
        combine.advance(Inputs(current_ma), 20.0)
        speeds.append(combine.truth.ground_speed_mps)
    return (speeds[1] - speeds[0]) / (2.0 * SMALL_STEP_MA)


def constant_speed(constant_s: float = CONSTANT_S) -> Part:
    """Half an hour at one speed, and the same setpoint change before and after."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    resumed_s = STEPS_S + 2 * HOLD_S + constant_s
    end_s = resumed_s + 2 * HOLD_S
    operator = (*START, *setpoints(STEPS_S, STEPS_S + 2 * HOLD_S), *setpoints(resumed_s, end_s))
    watch = Watch(plant)
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    result = demo.run(cruise, plant, Drive(seconds=end_s, operator=operator), SEED, end_s, show=watch)
    figures = [
        Figure("constant_speed_s", constant_s, "s", "time at constant speed"),
        Figure("std_ratio_max", watch.std_ratio_max, "1", "largest theta_std over the factory's", 1.0 + 1e-6),
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


def together() -> Part:
    """Hill alone, drift alone, both: do offset, disturbance and drifting parameters explain the same thing twice?"""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    cruise = service_settings.load(CONFIG / "cruise.yaml")
    hill = (
        FieldRow(at_s=0.0, grade_deg=0.0, rolling_resistance=0.05),
        FieldRow(at_s=HILL_S[0], over_s=5.0, grade_deg=HILL_DEG, rolling_resistance=0.08),
        FieldRow(at_s=HILL_S[1], over_s=5.0, grade_deg=0.0, rolling_resistance=0.05),
    )
    operator = (*START, *setpoints(STEPS_S, END_S))
    watches = {}
    for name, rows, drifts in (("hill", hill, False), ("drift", hill[:1], True), ("both", hill, True)):
        watch = watches[name] = Watch(plant, drifts)
        demo.run(cruise, plant, Drive(seconds=END_S, field=rows, operator=operator), SEED, END_S, show=watch)
    times_s = np.arange(DRIFT_S[0], END_S + 1.0, HOLD_S)
    over = {
        name: np.array([watch.at(time_s - HOLD_S, time_s) for time_s in times_s]) for name, watch in watches.items()
    }
    fresh = true_gain_mps_per_ma(plant)
    true = np.array([true_gain_mps_per_ma(worn(plant, time_s - 0.5 * HOLD_S)) for time_s in times_s]) / fresh
    gain = {name: rows[:, 0] / rows[0, 0] for name, rows in over.items()}
    disturbance = {name: rows[:, 2] for name, rows in over.items()}
    during = (times_s > HILL_S[0] + HOLD_S) & (times_s <= HILL_S[1])
    offset = max(float(np.ptp([row[2] for row in watch.rows])) for watch in watches.values())
    crosstalk = float(np.abs(gain["both"] - gain["drift"] * gain["hill"]).max())
    return Part(
        (
            Figure("true_gain_end", float(true[-1]), "1", "true gain at the end, relative to the start"),
            Figure("learned_gain_end", float(gain["both"][-1]), "1", "learned gain at the end, relative to the start"),
            Figure("gain_error_end_pct", 100.0 * abs(float(gain["both"][-1] / true[-1]) - 1.0), "%", "its error"),
            Figure(
                "gain_moved_by_hill_pct", 100.0 * float(np.abs(gain["hill"] - 1.0).max()), "%",
                "learned gain moved with the hill alone, largest",
            ),
            Figure("crosstalk_pct", 100.0 * crosstalk, "%", "both at once against the product of each alone, largest"),
            Figure("c_0_moved_mps", offset, "m/s", "c_0 moved while engaged", 0.0),
            Figure(
                "hill_disturbance_mps", float(disturbance["hill"][during].mean()), "m/s", "observer's d on the hill, hill alone"
            ),
            Figure(
                "both_disturbance_mps", float(disturbance["both"][during].mean()), "m/s", "observer's d on the hill, both"
            ),
        ),
        (SEED,),
        series={
            "until_s": times_s.tolist(),
            "true_gain": true.tolist(),
            **{f"gain_{name}": values.tolist() for name, values in gain.items()},
            **{f"d_{name}_mps": values.tolist() for name, values in disturbance.items()},
        },
    )
