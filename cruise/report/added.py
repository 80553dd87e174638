"""What an effect that was added is worth, in words, for command line and page."""

from collections.abc import Sequence
from typing import Final

from cruise.effects import Custom, Stage
from cruise.validation.ladder import Added, Parameter
from cruise.validation.numbers import IMPLAUSIBLE, NO_SIGN

LITTLE: Final = 0.02  # of the error: less is nothing that anyone would notice


def less(added: Added) -> float:
    """By which share the held-out error is less with it."""
    return 1.0 - added.error_after_mps / added.error_before_mps if added.error_before_mps else 0.0


def doubts(added: Added, fitted: Sequence[Parameter]) -> list[str]:
    """What speaks against keeping it, a sentence each; none where it takes what anyone would notice."""
    said = []
    if less(added) <= -LITTLE:
        said.append("It makes the model worse: leave it out; cruise diagnose says what would help.")
    elif absent(added.effect, fitted):
        said.append(f"There is no sign of it in these recordings: it was fitted to nothing{_other_way(added)}.")
    elif less(added) < LITTLE:
        said.append("It explains next to nothing of these recordings: cruise diagnose says what would.")
    odd = (one.name for one in fitted if one.remark == IMPLAUSIBLE)
    return [
        *said,
        *(f"{name} is negative, which is implausible: more current would slow the machine down." for name in odd),
    ]


def absent(effect: str, fitted: Sequence[Parameter]) -> bool:
    """Whether it was fitted to nothing: its load, or all its shapes where it has none. One shape may stay neutral."""
    remarks = {one.name.removeprefix(f"{effect}."): one.remark for one in fitted if one.name.startswith(f"{effect}.")}
    asked = [remarks["load"]] if "load" in remarks else list(remarks.values())
    return bool(asked) and all(remark == NO_SIGN for remark in asked)


def _other_way(added: Added) -> str:
    """What to try of a load, which only takes speed: of a term of one's own, the same with the other sign."""
    effect = next((one for one in added.after.explanation.effects if one.name == added.effect), None)
    if effect is None or effect.acts_as is not Stage.LOAD or effect.either_sign:
        return ""
    if isinstance(effect, Custom):
        other = f"custom({effect.name}, load, -({effect.expression}))"
        return f", as a load only takes speed: where it gives some, write {other}"
    return ", or may push one way only"
