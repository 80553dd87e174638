"""`cruise plant`: the virtual combine on a bus, with its scripted operator."""

from pathlib import Path
from typing import Annotated

import typer

from cruise import settings
from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.cli.places import CONFIG
from cruise.cli.run import Running
from cruise.plant import Combine, PlantSettings
from cruise.service import course
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.loop import Node, Together, serve
from cruise.service.operator_node import OperatorNode


def plant(
    config: Annotated[Path, typer.Argument(help="Settings of the service: bus, addresses.")] = CONFIG / "cruise.yaml",
    combine: Annotated[Path, typer.Option(help="Settings of the virtual combine.")] = CONFIG / "plant.yaml",
    drive: Annotated[Path, typer.Option(help="The drive: field and operator as rows.")] = CONFIG / "demo.yaml",
    seed: Annotated[int, typer.Option(min=0, help="Noise and variation of the drive.")] = 1,
    operator: Annotated[bool, typer.Option(help="Whether the scripted operator's panel is on the bus too.")] = True,
) -> None:
    """Put the virtual combine on the bus, in real time, until it is stopped."""
    service = service_settings.load(config)
    rows = course.vary(course.load(drive), seed)
    machine = Combine(settings.load(combine, PlantSettings), seed)
    codec = Codec.load(service.database, service.can)
    nodes: list[Node] = [CombineNode(machine, codec, rows.field, rows.operator)]
    if operator:
        nodes.append(OperatorNode(codec, rows.operator))
    with open_bus(service.can) as bus:
        print(f"cruise plant: on {service.can.bus} {service.can.channel}, seed {seed}", flush=True)
        serve(Together(nodes), bus, Running())
