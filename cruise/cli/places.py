"""Where the files are that the verbs take by default."""

from pathlib import Path

CONFIG = Path(__file__).resolve().parents[2] / "config"
OUT = Path("out")
