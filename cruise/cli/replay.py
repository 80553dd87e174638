"""`cruise replay`: recorded drives through the service."""

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich import box
from rich.table import Table

from cruise.cli.console import FIGURES, bold, printer
from cruise.cli.places import CONFIG, REPLAY
from cruise.cli.reading import (
    AsJson,
    Columns,
    InputName,
    OutputName,
    Recordings,
    columns_of,
    count_of,
    told_by,
    writable,
)
from cruise.model import files
from cruise.recording import input_rest_of, input_unit_of
from cruise.report.plain import plain
from cruise.service import replay as service
from cruise.service import settings as service_settings
from cruise.service.recordings import Told


def replay(
    recordings: Recordings,
    test: Annotated[list[Path] | None, typer.Option(help="Recordings to judge on; they teach nothing.")] = None,
    config: Annotated[Path, typer.Option(help="Settings of the service.")] = CONFIG / "cruise.yaml",
    model_file: Annotated[Path | None, typer.Option("--model", help="Model file to start from.")] = None,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    save: Annotated[Path | None, typer.Option(help="Model file to write what was learned to.")] = None,
    as_json: AsJson = False,
) -> None:
    """Put recordings on the bus as frames, let the service learn from them, and judge what it learned on others."""
    if save is not None:
        writable("--save", save)
    read = columns_of(columns, input_name, output_name)
    loaded = service_settings.load(config)
    if model_file is not None:
        loaded = msgspec.structs.replace(loaded, model=str(model_file))
    taught = service.replay(recordings, loaded, read, told_by(loaded.model))
    like = Told(input_unit_of(taught.recordings), input_rest_of(taught.recordings), "those that taught")
    model = taught.node.estimator.factory
    status = taught.node.status(taught.node.ticks * taught.node.period_s)
    report = {
        "recordings": [str(path) for path in recordings],
        "samples": sum(len(one) for one in taught.recordings),
        "notes": [f"{one.source}: {note}" for one in taught.recordings for note in one.notes],
        "learned": taught.learned,
        "gate_share": taught.gate_share,
        "parameters": dict(zip(model.parameter_names, status.learned.theta, strict=True)),
        "standard_errors": dict(zip(model.parameter_names, status.learned.theta_std, strict=True)),
        "error_ahead_mps": {name: value for name, value in status.rms_ahead_mps.items() if math.isfinite(value)},
        "frame_faults": {name: count for name, count in sorted(status.faults.items()) if name != "unknown"},
    }
    if test:
        unseen = service.replay(test, loaded, read, like)
        report["test"] = {
            "recordings": [str(path) for path in test],
            **plain(asdict(service.judge(taught, unseen.recordings))),
        }
    if save is not None and taught.learned:
        note = f"learned online by cruise replay, from {loaded.model}"
        names = tuple(one.source for one in taught.recordings)
        provenance = files.Provenance(
            recordings=names,
            samples=report["samples"],
            input_unit=like.unit,
            input_rest_ma=like.rest_ma,
            made_by=REPLAY,
            note=note,
        )
        files.save(save, status.learned, provenance)
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        _print(report)
    if save is not None and not taught.learned:
        print(f"cruise: {save}: not written, nothing was learned", file=sys.stderr)
        raise typer.Exit(1)


def _print(report: dict) -> None:
    console = printer(least=FIGURES)
    console.print(f"{count_of(len(report['recordings']), 'recording')}, {report['samples']} samples")
    for note in report["notes"]:
        console.print(f"note: {note}")
    if report["learned"]:
        table = Table(box=box.SIMPLE_HEAD)
        for heading in ("parameter", "learned", "+-"):
            table.add_column(heading, justify="left" if heading == "parameter" else "right")
        for name, value in report["parameters"].items():
            table.add_row(name, f"{value:.5g}", f"{report['standard_errors'][name]:.2g}")
        console.print(table)
    else:
        console.print(bold("nothing was learned", ": no sample could teach, the model is the one it began with"))
    console.print("gate: " + ", ".join(f"{gate} {100 * share:.0f} %" for gate, share in report["gate_share"].items()))
    if report["frame_faults"]:
        console.print(f"faulty frames: {report['frame_faults']}")
    judged = report.get("test")
    if judged is None:
        errors = ", ".join(f"{name} {value:.5f} m/s" for name, value in report["error_ahead_mps"].items())
        console.print(f"running error 3 s ahead: {errors or 'nothing judged yet'}")
        return
    table = Table(box=box.SIMPLE_HEAD)
    unseen = count_of(len(judged["recordings"]), "unseen recording")
    table.add_column(f"{judged['horizon_s']:g} s ahead on {unseen}")
    table.add_column("RMS error m/s", justify="right")
    for name in ("online", "batch", "factory", "persistence"):
        error_mps = judged[f"{name}_mps"]
        table.add_row(name, "-" if error_mps is None else f"{error_mps:.5f}")
    console.print(table)
