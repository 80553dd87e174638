"""`cruise experiment`: an identification experiment, driven on the virtual combine or recorded on a real one."""

import difflib
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.progress import Progress as Bar
from rich.table import Table

from cruise import settings as strict
from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.cli.console import FIGURES, printer
from cruise.cli.places import CONFIG, OUT
from cruise.cli.reading import writable
from cruise.cli.run import Running
from cruise.control.commissioning import CommissioningSettings, Experiment
from cruise.control.excitation import Multisine
from cruise.csv_file import write_csv
from cruise.identification.preparation import PreparationSettings
from cruise.plant import PlantSettings
from cruise.recording import Recording
from cruise.service import experiments as service
from cruise.service import settings as service_settings
from cruise.service.loop import Lockstep, serve
from cruise.service.settings import CruiseSettings
from cruise.settings import SettingsError


def experiment(
    name: Annotated[str, typer.Argument(help="The experiment, see --list.", show_default=False)] = "",
    listed: Annotated[bool, typer.Option("--list", help="Show the experiments and their durations.")] = False,
    out: Annotated[Path | None, typer.Option(help="CSV file to write.", show_default="out/NAME.csv")] = None,
    mass: Annotated[float | None, typer.Option(min=5000, max=40000, help="Machine mass in kg.")] = None,
    slope: Annotated[float | None, typer.Option(min=-15, max=15, help="Slope in degrees, + uphill.")] = None,
    gear: Annotated[int | None, typer.Option(min=1, max=4, help="Gear.")] = None,
    rpm: Annotated[float | None, typer.Option(min=800, max=2600, help="Engine speed setpoint in 1/min.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Draws excitation and sensor noise.")] = None,
    seconds: Annotated[float | None, typer.Option(min=1, help="Length of the excitation, in whole periods.")] = None,
    rate: Annotated[
        float, typer.Option(min=1, max=100, help="Sampling rate of the recording in Hz.")
    ] = service.RATE_HZ,
    real: Annotated[
        bool, typer.Option("--real", help="Record it on the bus of the settings, where `cruise run` drives it.")
    ] = False,
    file: Annotated[
        Path | None,
        typer.Option("--experiments", help="File of experiments.", show_default="that of the settings, else ours"),
    ] = None,
    config: Annotated[Path, typer.Option(help="Settings of the service.")] = CONFIG / "cruise.yaml",
    plant: Annotated[Path, typer.Option(help="Settings of the virtual combine.")] = CONFIG / "plant.yaml",
) -> None:
    """Drive an experiment for identification and write what was heard on the bus as a recording."""
    settings = service_settings.load(config)
    commissioning = settings.commissioning
    file = file or (Path(commissioning.experiments) if commissioning else CONFIG / "experiments.yaml")
    known = service.load(file)
    if listed:
        printer(least=FIGURES).print(_table(known))
        return
    chosen = _chosen(known, name, file)
    path = out or OUT / f"{name}.csv"
    writable("--out", path, (".csv",))
    own = {"machine_mass_kg": mass, "grade_deg": slope, "gear": gear, "engine_speed_rpm": rpm}
    given = {key: value for key, value in own.items() if value is not None}
    if real:
        if given or seed is not None or seconds is not None:
            raise SettingsError(
                "experiment --real: mass, slope, gear, rpm, seed and seconds are those of the machine and of the "
                "experiments file; leave these options out"
            )
        _record(chosen, settings, path, rate)
        return
    _check_rate(rate)
    conditions = msgspec.structs.replace(chosen.conditions, **given)
    chosen = service.altered(chosen, conditions, seed, seconds)
    settings = msgspec.structs.replace(
        settings, commissioning=commissioning or CommissioningSettings(experiments=str(file))
    )
    combine = strict.load(plant, PlantSettings)
    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(chosen.name, total=service.STANDSTILL_S + chosen.duration_s)
        driven = service.drive_on_bus(
            chosen, settings, combine, rate, show=lambda now_s: bar.update(task, completed=now_s)
        )
    _finish(driven.recording, path, driven.ended_by)


def _record(chosen: Experiment, settings: CruiseSettings, path: Path, rate_hz: float) -> None:
    """Listen to the bus until the experiment that the operator begins there has ended. It sends nothing."""
    if settings.commissioning is None:
        raise SettingsError(
            "experiment --real: the settings have no commissioning; add it for as long as it is needed:\n"
            "  commissioning:\n    experiments: experiments.yaml"
        )
    if settings.can.bus == "virtual":
        raise SettingsError("experiment --real: can.bus is virtual; set it to socketcan, or leave --real out")
    if path.exists():
        raise SettingsError(f"{path}: is there already and is not overwritten; give another name with --out")
    recorder = service.Recorder(Codec.load(settings.database, settings.can), chosen.number, rate_hz)
    gear, speed_max_mps = chosen.conditions.gear, chosen.speed_max_mps
    print(
        f"{chosen.name}: {chosen.duration_s:.0f} s in gear {gear}, up to {speed_max_mps:g} m/s; track free and level?\n"
        f"On the machine, with `cruise run` on the bus: lever at rest, pedals free, gear {gear}, cruise enabled; hold "
        f"the request for experiment {chosen.number} and press set. Brake, clutch, lever or letting go of the request "
        "ends it."
    )
    running = Running()
    with open_bus(settings.can) as bus, Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("waiting", total=chosen.excitation.duration_s)

        def show(now_s: float) -> None:
            said = recorder.progress.name.lower().replace("_", " ")
            bar.update(task, completed=len(recorder.rows) * recorder.period_s, description=said)

        serve(recorder, bus, lambda: running() and not recorder.ended, show)
    if not recorder.begun:
        raise SettingsError(
            f"{chosen.name}: was not begun on {settings.can.channel}; "
            "the status of `cruise run` says what was in the way"
        )
    _finish(recorder.recording(f"{chosen.name} on {settings.can.channel}"), path, recorder.ended_by)


def _check_rate(rate_hz: float) -> None:
    """SettingsError where a sample does not last whole steps of the virtual bus, with the rates whose samples do."""
    finest_hz = round(1.0 / Lockstep.step_s)
    if not math.isclose(finest_hz / rate_hz, round(finest_hz / rate_hz)):
        *most, last = (str(whole) for whole in range(1, finest_hz + 1) if finest_hz % whole == 0)
        raise SettingsError(
            f"--rate {rate_hz:g}: a sample has to last whole steps of {Lockstep.step_s:g} s; "
            f"give {', '.join(most)} or {last}"
        )


def _chosen(known: Mapping[str, Experiment], name: str, file: Path) -> Experiment:
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
    said = f"no experiment {name!r} in {file}" if name else f"which experiment of {file}?"
    raise SettingsError(f"experiment: {said}; {hint}; see `cruise experiment --list`")


def _table(known: Mapping[str, Experiment]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("no.", "name", "excitation", "mA", "gear", "in all", "at most"):
        words = heading in ("name", "excitation")
        table.add_column(heading, justify="left" if words else "right", no_wrap=heading != "excitation")
    for one in known.values():
        signal, (low_ma, high_ma) = one.excitation, one.excitation.range_ma
        kind = str(type(signal).__struct_config__.tag).replace("_", " ")
        if isinstance(signal, Multisine):
            kind += f" to {signal.high_hz:g} Hz"
        table.add_row(
            str(one.number),
            one.name,
            kind,
            f"{low_ma:.0f}-{high_ma:.0f}",
            str(one.conditions.gear),
            f"{one.duration_s:.0f} s",
            f"{one.speed_max_mps:g} m/s",
        )
    return table


def _finish(recording: Recording, path: Path, ended_by: str) -> None:
    write_csv(recording, path)
    lost = int(np.sum(np.isnan(recording.input) | np.isnan(recording.output)))
    print(f"{recording.source}")
    print(
        f"{len(recording)} samples at {1.0 / recording.dt_s:g} Hz, {len(recording) * recording.dt_s:.1f} s, in {path}"
    )
    for what, values, unit, digits in (
        ("pump current", recording.input, "mA", 0),
        ("ground speed", recording.output, "m/s", 2),
    ):
        mean, low, high = (
            (float(how(values)) for how in (np.nanmean, np.nanmin, np.nanmax)) if lost < len(values) else [math.nan] * 3
        )
        print(f"{what}: mean {mean:.{digits}f}, {low:.{digits}f} to {high:.{digits}f} {unit}")
    if lost:
        print(f"{lost} samples without current or speed")
    slow = f" --period {recording.dt_s:g}" if recording.dt_s > PreparationSettings().period_s else ""
    print(f"next: cruise explore {path}\n      cruise identify {path} --model arx10B{slow} -o model.yaml")
    if ended_by:
        print(f"cruise: {recording.source}: ended early: {ended_by}", file=sys.stderr)
        raise typer.Exit(1)
