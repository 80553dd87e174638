"""Power limit: where the demand of the ground exceeds what pump or engine can give, the swash plate is taken back.

    P_0 = m (p w + g_n c_r |w|) / 1000, or P_0 = kappa (dp w - p_0 |w|) through a low-pass where the pressure is known
    g = (1 - c) g_p g_c,   g_p = min(1, P_max (1 - a L / 100) / P_0)^h, the corner rounded off within +-1/8 of P_max
    w = v / s,   ds/dt = (g_p - s) / tau_v
    g_c = max(1 - b max(|dp| - p_c, 0), 0.2),   dc/dt = k max(L - L_0, 0) - c / tau_c,   c <= 0.8

P_0 power in kW that the drive would have to give if nothing were taken back: v speed one sample ago in m/s, s what of
it the limit has left, as the vehicle follows it within tau_v, so that w is the speed without the limit. m mass in kg
(15 000 kg where not measured), p pull of the slope in m/s2: 9.81 m/s2 times the sine of the pitch alpha, less r times
the acceleration dv/dt, which the pitch sensor takes for slope, through a low-pass of tau; what of it is acceleration
acts on the pump's pressure only as far as the control is as quick, so r and tau are found from the data; g_n = 9.81
m/s2, c_r rolling resistance (0.02 on concrete to 0.12 on soft soil, found from the data), P_max in kW. g_p is what this
limit leaves and g_c what the cut-off does. How hard it holds is h: 1 keeps the power, v = P_max / F with F the force,
less is a softer control. What else the engine drives leaves less of its power for the wheels: L engine load in percent,
a the share of P_max that a full load takes. dp line pressure in bar (+ driving forward), which shows soil and whatever
else holds the machine, p_0 in bar along the motion where nothing does, kappa in kN per bar: 0 leaves the pressure
alone. A pressure cut-off, which sees the higher one of the lines, destrokes the pump from p_c in bar on, by a share b
per bar (600 bar is never reached). An electronic limit, which keeps the engine from stalling, cuts a share c of the
stroke while the engine is overloaded, whatever loads it, and gives it back slowly: L_0 load from which it cuts (200 is
never reached), k share per second and percent, tau_c in s.

Source: data sheets of axial piston pumps with torque (power) control, pressure times displacement is held, and with
pressure cut-off; J.Y. Wong, Theory of Ground Vehicles (2008), ch. 2 (motion resistance of soil); section V.A of Coen et
al. 2005 (engine power).
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import (
    EMPTY_KG,
    GRAVITY_MPS2,
    About,
    Effect,
    Parameter,
    Stage,
    State,
    Value,
    anywhere,
    clip,
    where,
)
from cruise.effects.low_pass import followed, share
from cruise.effects.pull import pull, unknown
from cruise.signals import OUTPUT, Signals

UNLIMITED_KW: Final = 300.0  # kW: more than the drive line of any combine takes
NEVER_PCT: Final = 200.0  # %: more than any engine shows
NEVER_BAR: Final = 600.0  # bar: more than any hydrostatic drive stands
MOST_CUT: Final = 0.8  # share of the stroke
MOST_TIMES: Final = 10.0  # times the limit, beyond which nothing more is taken back
MOST_TAKEN: Final = 0.95  # of the power, by what else the engine drives
CORNER: Final = 0.125  # relative half width of the rounded corner: a fit by differences sees a slope on both sides


@dataclass(frozen=True, slots=True)
class PowerLimit(Effect):
    """g = (1 - c) min(1, P_max / P_0)^hold g_c, the corner rounded off; P_max what the load leaves.

    300 kW, 200 % and 600 bar are no limits.
    """

    name = "power_limit"
    stage = Stage.GAIN
    needs = ("pitch_deg",)
    helps = ("machine_mass_kg", "line_pressure_bar", "engine_load_pct", OUTPUT)
    reads_speed = True
    instead = (
        "kn_per_bar",
        "rest_bar",
        "load_share",
        "onset_pct",
        "cut_per_pct_s",
        "release_s",
        "cutoff_bar",
        "cut_per_bar",
    )
    told_by = ("line_pressure_bar", "engine_load_pct")
    parameters: ClassVar = {
        "power_kw": Parameter("kW", 5.0, UNLIMITED_KW, UNLIMITED_KW, "power that the drive may take; 300 is no limit"),
        "hold": Parameter(
            "-", 0.2, 1.0, 0.5, "how hard it holds: the gain falls with this power of the excess; 1 keeps it"
        ),
        "follow_s": Parameter("s", 0.0, 2.0, 0.3, "time constant in which the vehicle follows what is taken back"),
        "rolling_resistance": Parameter("-", 0.02, 0.12, 0.06, "resistance of the ground over the weight"),
        "acceleration_share": Parameter("-", 0.0, 1.0, 0.0, "how far what the pitch shows of acceleration is not felt"),
        "filter_s": Parameter("s", 0.0, 2.0, 0.0, "time constant through which slope or pressure is felt"),
        "kn_per_bar": Parameter("kN/bar", 0.0, 2.0, 0.0, "force that a bar is; 0: it goes by slope and mass alone"),
        "rest_bar": Parameter("bar", -200.0, 400.0, 0.0, "pressure while nothing holds the machine"),
        "load_share": Parameter("-", 0.0, 1.0, 0.0, "share of it that an engine load of 100 % takes from the drive"),
        "onset_pct": Parameter(
            "%", 65.0, NEVER_PCT, NEVER_PCT, "engine load from which the stroke is cut; 200 is never"
        ),
        "cut_per_pct_s": Parameter(
            "1/(% s)", 1e-3, 0.5, 0.01, "share of the stroke that is cut per second and percent"
        ),
        "release_s": Parameter("s", 0.1, 10.0, 2.0, "time constant with which it comes back"),
        "cutoff_bar": Parameter(
            "bar", 150.0, NEVER_BAR, NEVER_BAR, "pressure from which the pump destrokes; 600 is never"
        ),
        "cut_per_bar": Parameter("1/bar", 5e-4, 0.05, 5e-3, "share of the stroke that is taken back per bar beyond"),
    }
    about: ClassVar = About(
        physics="Torque control of the pump, or an electronic limit that keeps the diesel from stalling, takes the "
        "swash plate back as soon as pressure times flow exceeds the power that may be taken: the less, the more else "
        "the engine drives. The pressure follows the force at the wheels: mass times slope and rolling resistance. On "
        "level ground and at low speed nothing is felt; uphill with a full bin the machine refuses to go faster, "
        "whatever the current. Where a controller watches the engine's load, it cuts the stroke while the engine is "
        "overloaded and gives it back slowly. A pressure cut-off does the same from a pressure on, at any speed.",
        equation="g = min(1, P_max (1 - a L / 100) / P_0)^h,  P_0 = m (p w + 9.81 m/s2 c_r |w|),  "
        "p = 9.81 m/s2 sin(alpha) - r dv/dt, through a low-pass of tau; or P_0 = kappa (dp w - p_0 |w|); w = v / s, "
        "s is g within tau_v; or g = 1 - c,  dc/dt = k max(L - L_0, 0) - c / tau_c; or g = 1 - b max(|dp| - p_c, 0)",
        source="data sheets of pumps with torque control; Wong 2008, ch. 2; Coen et al. 2005, section V.A, Fig. 6",
        signature="the residual is negative where speed times slope is high, and there only: nothing downhill, nothing "
        "below a speed that falls as the slope and the mass rise; where a controller sees to it, it comes with an "
        "engine load near its end, whatever loads it, and goes within some seconds",
        look_alikes=("grade", "saturation", "engine_speed", "engine_droop", "speed_droop"),
        experiment="up a slope of at least 5 degrees at 0.5, 1, 1.5 and 2 m/s, 15 s each, and down again: grade takes "
        "the same speed away at every current and gives it back downhill, a power limit leaves the slow runs alone",
    )

    power_kw: float = UNLIMITED_KW
    hold: float = 0.5
    follow_s: float = 0.3
    rolling_resistance: float = 0.06
    acceleration_share: float = 0.0
    filter_s: float = 0.0
    kn_per_bar: float = 0.0
    rest_bar: float = 0.0
    load_share: float = 0.0
    onset_pct: float = NEVER_PCT
    cut_per_pct_s: float = 0.01
    release_s: float = 2.0
    cutoff_bar: float = NEVER_BAR
    cut_per_bar: float = 5e-3

    @property
    def idle(self) -> frozenset[str]:
        """The shapes of the power where it is not limited, and of the cuts where no load or pressure brings one."""
        by_load, by_bar = (
            frozenset({"onset_pct", "cut_per_pct_s", "release_s"}),
            frozenset({"cutoff_bar", "cut_per_bar"}),
        )
        by_power = frozenset(self.parameters) - by_load - by_bar
        without = [by_power] if self.power_kw >= UNLIMITED_KW else []
        without += [by_load] if self.onset_pct >= NEVER_PCT else []
        return frozenset().union(*without, *([by_bar] if self.cutoff_bar >= NEVER_BAR else []))

    def start(self, like: Value) -> State:
        """What `pull` remembers, the power in kW that the pressure has shown: nothing yet; what is cut and left."""
        return *unknown(like), like * math.nan, like * 0.0, like * 0.0 + 1.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, divided by a power of how many times the demand exceeds the limit."""
        *pulled, shown_kw, cut, left = state
        pressure_bar = signals.get("line_pressure_bar", math.nan)
        load_pct = signals.get("engine_load_pct", 0.0)
        held = 1.0
        if anywhere(self.power_kw < UNLIMITED_KW):
            pull_mps2, pulled = pull(signals, tuple(pulled), self.acceleration_share, self.filter_s, dt_s)
            without_mps = past_speed / left
            asked_kw = demand_kw(without_mps, pull_mps2, self.rolling_resistance, signals)
            if anywhere(self.kn_per_bar > 0.0):
                now_kw = self.kn_per_bar * (pressure_bar * without_mps - self.rest_bar * abs(without_mps))
                felt_kw = followed(shown_kw, now_kw, share(self.filter_s, dt_s))
                known = felt_kw == felt_kw  # NaN: not measured
                shown_kw = where(known, felt_kw, shown_kw)
                asked_kw = where(known * (self.kn_per_bar > 0.0), felt_kw, asked_kw)
            held = self._held(asked_kw, load_pct)
            known = held == held  # NaN: speed or slope not measured
            left = where(known, left + share(self.follow_s, dt_s) * (held - left), left)
        if anywhere(self.onset_pct < NEVER_PCT):
            over_pct = load_pct - self.onset_pct
            over_pct = where(over_pct > 0.0, over_pct, 0.0)  # NaN: not measured
            released = share(self.release_s, dt_s)
            cut = clip(cut + released * (self.release_s * self.cut_per_pct_s * over_pct - cut), 0.0, MOST_CUT)
        passed = 1.0
        if anywhere(self.cutoff_bar < NEVER_BAR):
            beyond_bar = abs(pressure_bar) - self.cutoff_bar
            over_bar = where((beyond_bar > 0.0) * (self.cutoff_bar < NEVER_BAR), beyond_bar, 0.0)  # NaN: not measured
            passed = clip(1.0 - self.cut_per_bar * over_bar, 1.0 - MOST_CUT, 1.0)
        return value * (1.0 - cut) * passed * held, (*pulled, shown_kw, cut, left)

    def _held(self, asked_kw: Value, load_pct: Value) -> Value:
        """g_p, of what is asked and what else the engine drives."""
        taken = where(load_pct == load_pct, self.load_share * load_pct / 100.0, 0.0)  # NaN: not measured
        most_kw = self.power_kw * (1.0 - clip(taken, 0.0, MOST_TAKEN))
        excess = asked_kw * (self.power_kw < UNLIMITED_KW) / most_kw - (1.0 - CORNER)
        rounded = clip(excess, 0.0, 2.0 * CORNER)
        times = 1.0 + rounded * rounded / (4.0 * CORNER) + clip(excess - 2.0 * CORNER, 0.0, MOST_TIMES)
        return times**-self.hold


def demand_kw(speed_mps: Value, pull_mps2: Value, rolling_resistance: Value, signals: Signals) -> Value:
    """P_0 in kW: what slope and rolling resistance take at this speed."""
    mass_kg = signals.get("machine_mass_kg", EMPTY_KG)
    mass_kg = where(mass_kg == mass_kg, mass_kg, EMPTY_KG)  # NaN: not measured
    return 1e-3 * mass_kg * (pull_mps2 * speed_mps + GRAVITY_MPS2 * rolling_resistance * abs(speed_mps))
