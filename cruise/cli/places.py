"""Where the files are that the verbs take by default, and what a model that was learned says of who made it."""

from pathlib import Path

CONFIG = Path(__file__).resolve().parents[2] / "config"
OUT = Path("out")
REPLAY = "cruise replay"
