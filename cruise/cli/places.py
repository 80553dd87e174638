"""Where the files are that the verbs take by default, and what a model that was learned says of who made it."""

import sys
from pathlib import Path

_CHECKOUT = Path(__file__).resolve().parents[2] / "config"
CONFIG = _CHECKOUT if _CHECKOUT.is_dir() else Path(sys.prefix) / "share" / "cruise"  # by pip: pyproject.toml
OUT = Path(__file__).resolve().parents[2] / "config"
CONFIG = (
    _CHECKOUT if _CHECKOUT.is_dir() else Path(sys.prefix) / "share" / "cruise"
)  # where pip puts it (pyproject.toml)
OUT = Path("out")
REPLAY = "cruise replay"
