"""The live view says what was decided about a learned model, and why."""

import io

from rich.console import Console

from cruise.cli.live import view
from cruise.estimation.supervision import Change, Decision
from cruise.model import files
from cruise.service.cruise_node import CruiseNode
from tests.service.drive import codec, cruise_settings


def shown(node: CruiseNode) -> str:
    console = Console(width=250, record=True, file=io.StringIO())
    console.print(view(node.status(40.0), 180.0, 0.0))
    return console.export_text()


def test_the_last_decision_is_shown_with_its_reason():
    node = CruiseNode(cruise_settings(), files.load(cruise_settings().model), codec())
    assert "adopted 0 times" in shown(node)
    assert "margins" not in shown(node)
    for why in ("its error is above", "its margins are too small"):
        node.supervisor.decisions.append(Decision(31.2, Change.REFUSED, why, {"gain_margin": 1.26}))
    assert "31 s: refused: its margins are too small" in shown(node)
    assert "its error" not in shown(node)
