"""What the service loads: only what it needs to drive, all of it before it drives."""

import json
import subprocess
import sys

SCRIPT = """
import json, sys
from msgspec import structs
from cruise.can.bus import open_bus
from cruise.can.settings import CanSettings
from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.daemon import Daemon
from cruise.service.notify import Notifier
found = service_settings.load(CONFIG / "cruise.yaml")
found = structs.replace(found, can=CanSettings(bus="virtual", channel="start"))
daemon = Daemon(found, Notifier(""), print)
started = set(sys.modules)
from cruise import settings
from cruise.can.codec import Codec
from cruise.plant import Combine, PlantSettings
from cruise.service.combine_node import CombineNode
from cruise.service.course import OperatorRow
from cruise.service.loop import Lockstep
from cruise.service.operator_node import OperatorNode
rows = (
    OperatorRow(at_s=0.2, cruise_enable=1.0),
    OperatorRow(at_s=0.5, over_s=1.0, lever_pct=50.0),
    OperatorRow(at_s=6.0, press="set"),
)
machine = Combine(settings.load(CONFIG / "plant.yaml", PlantSettings), 1)
codec = Codec.load(found.database, found.can)
nodes = [CombineNode(machine, codec, (), rows), OperatorNode(codec, rows), daemon.station]
before = set(sys.modules)
Lockstep([(node, open_bus(found.can)) for node in nodes]).run(20.0)
state = str(daemon.node.engagement.state)
print(json.dumps({"started": sorted(started), "later": sorted(set(sys.modules) - before), "state": state}))
"""
SLOW_TO_LOAD = {"scipy.signal", "matplotlib", "control", "sklearn", "pandas"}


def test_nothing_slow_is_loaded_to_start_and_nothing_at_all_while_it_drives():
    ran = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    loaded = json.loads(ran.stdout)
    assert loaded["state"] in ("engaging", "engaged")
    assert loaded["later"] == [], "what is loaded while it drives makes it late"
    assert not SLOW_TO_LOAD & set(loaded["started"])
