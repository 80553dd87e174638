"""Figures as JSON has them: lists for arrays, and nothing where there is no number."""

import math
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """`value` with what JSON does not know as what it knows: None for NaN and infinity."""
    match value:
        case dict():
            return {key: plain(one) for key, one in value.items()}
        case list() | tuple():
            return [plain(one) for one in value]
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case float() if not math.isfinite(value):
            return None
    return value
