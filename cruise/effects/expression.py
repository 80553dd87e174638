"""Expressions of signals and parameters as a user writes them: read by a small parser, never run as Python.

    1 + p1 * (header_height_mm - 300)        where(gear > 2, -p1 * engine_load_pct, 0)

Numbers, names, + - * / **, comparisons as the first argument of where(), and the functions of FUNCTIONS; all in
floating point and elementwise. Python's `ast` splits the text, everything that is not listed here is refused.
"""

import ast
import difflib
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cruise.effects.effect import Value

LONGEST: Final = 500  # characters; a term that an engineer can check by eye has less
DEEPEST: Final = 40  # operations inside each other


class ExpressionError(ValueError):
    """The expression can't be read; the message says at which column, why, and what would be right."""


def _smallest(*values: Value) -> Value:
    result = values[0]
    for value in values[1:]:
        result = np.minimum(result, value)
    return result


def _greatest(*values: Value) -> Value:
    result = values[0]
    for value in values[1:]:
        result = np.maximum(result, value)
    return result


FUNCTIONS: Final[Mapping[str, tuple[Callable[..., Value], int, int]]] = {
    "abs": (np.abs, 1, 1),
    "min": (_smallest, 2, 9),
    "max": (_greatest, 2, 9),
    "exp": (np.exp, 1, 1),
    "log": (np.log, 1, 1),
    "sqrt": (np.sqrt, 1, 1),
    "sin": (np.sin, 1, 1),
    "cos": (np.cos, 1, 1),
    "tanh": (np.tanh, 1, 1),
    "sign": (np.sign, 1, 1),
    "clip": (np.clip, 3, 3),
    "where": (np.where, 3, 3),
}
"""Every function: what it does, and the least and greatest number of its arguments."""

_BINARY: Final = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,  # Python's own raises for 1 / 0
    ast.Pow: np.power,  # Python's own turns complex for (-1) ** 0.5
}
_UNARY: Final = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_COMPARISONS: Final = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}

_Evaluate = Callable[[Mapping[str, Value]], Value]


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression that was read: its text, the names in it in their order, and its value for values of these."""

    text: str
    names: tuple[str, ...]
    _evaluate: _Evaluate = field(repr=False, compare=False)

    def __reduce__(self) -> tuple[Callable[[str], "Expression"], tuple[str]]:
        """To another process it goes as its text, and is read again there."""
        return read, (self.text,)

    def __call__(self, values: Mapping[str, Value]) -> Value:
        """The value, elementwise: a float of floats; NaN where one of the names has none."""
        with np.errstate(all="ignore"):
            result = self._evaluate(values)
            total = sum(values[name] for name in self.names)  # of infinities too this is no number
        if isinstance(result, np.ndarray) or isinstance(total, np.ndarray):
            result = np.where(total == total, result, math.nan)
            return result if result.ndim else float(result)
        return float(result) if total == total else math.nan


def read(text: str) -> Expression:
    """Read an expression. Raises ExpressionError with the column of the first mistake."""
    if len(text) > LONGEST:
        raise ExpressionError(f"column {LONGEST + 1}: longer than {LONGEST} characters")
    body = text.replace("\n", " ").lstrip()
    try:
        tree = ast.parse(body.rstrip() + "\n", mode="eval")  # the line's end, for the column of what is missing there
    except SyntaxError as error:
        column = (error.offset or 1) + len(text) - len(body)
        raise ExpressionError(f"column {column}: not an expression: {error.msg}") from error
    except ValueError as error:
        raise ExpressionError(f"column 1: not an expression: {error}") from error
    reader = _Reader(len(text) - len(body))
    evaluate = reader.value(tree.body, 0)
    return Expression(text, tuple(reader.names), evaluate)


class _Reader:
    """Turns the nodes of a syntax tree, of the listed kinds only, into functions of the names' values."""

    def __init__(self, indent: int) -> None:
        self.indent = indent
        self.names: dict[str, None] = {}

    def refused(self, node: ast.expr, problem: str) -> ExpressionError:
        return ExpressionError(f"column {node.col_offset + self.indent + 1}: {problem}")

    def value(self, node: ast.expr, depth: int) -> _Evaluate:
        """A numerical expression, as a function of the signals and the parameters."""
        if depth > DEEPEST:
            raise self.refused(node, f"more than {DEEPEST} operations inside each other")
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                raise self.refused(node, f"{node.value!r} is no number")
            case ast.Constant(value=int() | float()):
                return self.number(node)
            case ast.Name(id=name):
                return self.name(node, name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                return _applied(_UNARY[type(op)], [self.value(operand, depth + 1)])
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return _applied(_BINARY[type(op)], [self.value(left, depth + 1), self.value(right, depth + 1)])
            case ast.Call():
                return self.call(node, depth)
            case ast.Compare():
                raise self.refused(node, "a comparison stands only first in where(comparison, then, otherwise)")
        raise self.refused(node, f"{ast.unparse(node)[:40]!r} is not allowed; {_ALLOWED}")

    def number(self, node: ast.Constant) -> _Evaluate:
        try:
            constant = float(node.value)  # type: ignore[arg-type]  # int or float, as matched
        except OverflowError:
            constant = math.inf
        if not math.isfinite(constant):
            raise self.refused(node, "a number larger than 1e308")
        return lambda values: constant

    def name(self, node: ast.expr, name: str) -> _Evaluate:
        if name in FUNCTIONS:
            raise self.refused(node, f"{name} is a function: {name}(...)")
        self.names[name] = None
        return lambda values: values[name]

    def call(self, node: ast.Call, depth: int) -> _Evaluate:
        name = node.func.id if isinstance(node.func, ast.Name) else ast.unparse(node.func)[:40]
        if name not in FUNCTIONS:
            near = difflib.get_close_matches(name, FUNCTIONS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(FUNCTIONS)}"
            raise self.refused(node, f"no function {name}; {hint}")
        function, least, most = FUNCTIONS[name]
        if node.keywords or not least <= len(node.args) <= most:
            count = f"{least}" if least == most else f"{least} to {most}"
            raise self.refused(node, f"{name} takes {count} argument{'s' * (most > 1)} without names")
        if name == "where":
            first, *others = node.args
            return _applied(function, [self.comparison(first, depth + 1), *(self.value(a, depth + 1) for a in others)])
        return _applied(function, [self.value(argument, depth + 1) for argument in node.args])

    def comparison(self, node: ast.expr, depth: int) -> _Evaluate:
        """True or False, of one comparison or a chain of them."""
        if not isinstance(node, ast.Compare) or not all(type(op) in _COMPARISONS for op in node.ops):
            raise self.refused(node, "where() begins with a comparison: where(gear > 2, then, otherwise)")
        sides = [self.value(side, depth + 1) for side in (node.left, *node.comparators)]
        pairs = zip(node.ops, sides, sides[1:], strict=False)
        links = [_applied(_COMPARISONS[type(op)], [left, right]) for op, left, right in pairs]
        return lambda values: np.logical_and.reduce(np.broadcast_arrays(*(link(values) for link in links)))


_ALLOWED = f"an expression has numbers, names, + - * / ** and {', '.join(FUNCTIONS)}"


def _applied(function: Callable[..., Value], arguments: list[_Evaluate]) -> _Evaluate:
    return lambda values: function(*(argument(values) for argument in arguments))
