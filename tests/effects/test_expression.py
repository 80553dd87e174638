"""Expressions: what they compute, and what is refused at which column."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects.expression import DEEPEST, FUNCTIONS, LONGEST, ExpressionError, read

VALUES = {"x": 2.0, "y": -3.0, "gear": 3.0, "p1": 0.5}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * x ** 2", 9.0),
        ("  -x + +y", -5.0),
        ("-x ** 2", -4.0),
        ("x / y", -2.0 / 3.0),
        ("2 ** -1", 0.5),
        ("1e-3 * x", 0.002),
        ("abs(y) + sign(y)", 2.0),
        ("min(x, y, 7) + max(1, x)", -1.0),
        ("exp(log(x)) + sqrt(x * x)", 4.0),
        ("sin(x) ** 2 + cos(x) ** 2", 1.0),
        ("tanh(p1)\n - 0", math.tanh(0.5)),
        ("clip(x, -1, 1)", 1.0),
        ("where(gear > 2, x, y)", 2.0),
        ("where(1 < gear <= 2, x, y)", -3.0),
        ("where(gear == 3, where(x != 2, 0, 5), y)", 5.0),
    ],
)
def test_the_value_is_that_of_the_formula_for_floats_and_elementwise(text, value):
    expression = read(text)
    found = expression(VALUES)
    assert type(found) is float
    assert found == pytest.approx(value, rel=1e-12)
    several = expression({name: np.array([one, one + 1.0]) for name, one in VALUES.items()})
    if expression.names:
        assert several.shape == (2,)
        assert several[0] == pytest.approx(value, rel=1e-12)
        assert several[1] == expression({name: one + 1.0 for name, one in VALUES.items()})


@given(x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3))
def test_arithmetic_is_that_of_floats(x, y):
    text = "(x + y) * (x - y) / 7 - x * 0.3"
    assert read(text)({"x": x, "y": y}) == (x + y) * (x - y) / 7 - x * 0.3


@pytest.mark.parametrize(
    "text", ["where(x > 0, 1, 0)", "where(gear > 2, 1, x)", "min(x, 0)", "max(0, x)", "x ** 0", "0 * x"]
)
def test_a_name_that_was_not_measured_gives_no_number_wherever_it_stands(text):
    assert math.isnan(read(text)(VALUES | {"x": math.nan}))
    np.testing.assert_array_equal(np.isnan(read(text)(VALUES | {"x": np.array([math.nan, 1.0])})), [True, False])


@pytest.mark.parametrize(
    "text", ["1 / (x - 2)", "1 / 0", "log(x - 2)", "(x - 4) ** 0.5", "exp(1000 * x)", "9 ** 9 ** 9 ** 9"]
)
def test_what_python_would_raise_for_is_no_finite_number(text):
    assert not math.isfinite(read(text)(VALUES))


def test_names_stand_once_in_their_order():
    assert read("p1 * y + x * y").names == ("p1", "y", "x")


REFUSED = {
    "1 + ": (4, "not an expression"),
    "1 +\n 2 +": (9, "not an expression"),
    "": (1, "not an expression"),
    "  (x": (3, "not an expression"),
    "x; y": (2, "not an expression"),
    "x = 2": (3, "not an expression"),
    "x\x00": (1, "not an expression"),
    "1 + sine(x)": (5, "no function sine; did you mean sin"),
    "  2 * foo(x)": (7, "no function foo; known: abs, min"),
    "x * sqrt": (5, "sqrt is a function: sqrt"),
    "clip(x, 1)": (1, "clip takes 3 arguments"),
    "abs(x, y)": (1, "abs takes 1 argument without"),
    "max(x)": (1, "max takes 2 to 9 arguments"),
    "abs(x, out=y)": (1, "abs takes 1 argument without names"),
    "min(x, default=3)": (1, "min takes 2 to 9 arguments without names"),
    "where(x, 1, 2)": (7, "begins with a comparison"),
    "where(x in y, 1, 2)": (7, "begins with a comparison"),
    "1 + (x > 2)": (6, "a comparison stands only first in where"),
    "x and y": (1, "'x and y' is not allowed"),
    "not x": (1, "'not x' is not allowed"),
    "x % 2": (1, "'x % 2' is not allowed"),
    "x // 2": (1, "not allowed"),
    "x if y else 2": (1, "not allowed"),
    "[x]": (1, "not allowed"),
    "lambda: x": (1, "not allowed"),
    "1 + x.real": (5, "'x.real' is not allowed"),
    "x[0]": (1, "not allowed"),
    "abs(*x)": (5, "not allowed"),
    "(y := x)": (2, "not allowed"),
    "...": (1, "not allowed"),
    "'abc'": (1, "'abc' is no number"),
    "True": (1, "True is no number"),
    "2j * x": (1, "2j is no number"),
    "x * 1e999": (5, "larger than 1e308"),
    "x * 1" + "0" * 400: (5, "larger than 1e308"),
    "__import__('os').system('true')": (1, "no function __import__('os').system"),
    "().__class__.__bases__": (1, "not allowed"),
    "(lambda: x)()": (1, "no function"),
    "x + " * 200 + "x": (LONGEST + 1, "longer than"),
    "-" * (DEEPEST + 5) + "x": (DEEPEST + 2, "more than 40 operations"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_mistake_is_refused_with_its_column_and_what_would_be_right(text):
    column, complaint = REFUSED[text]
    with pytest.raises(ExpressionError) as raised:
        read(text)
    assert str(raised.value).startswith(f"column {column}: ")
    assert complaint in str(raised.value)


@given(text=st.text(alphabet="xyp1 ().,+-*/<>=[]{}:'\"_\\\n\t#@!%&^|~" + "absminwhere", max_size=60))
def test_any_text_is_an_expression_or_refused(text):
    try:
        expression = read(text)
    except ExpressionError:
        return
    values = dict.fromkeys(expression.names, 1.0)
    assert type(expression(values)) is float


def test_every_function_is_known_to_numpy_by_its_arguments():
    for name, (_, least, _) in FUNCTIONS.items():
        arguments = ["x > 1", "x", "y"] if name == "where" else ["x", "y", "gear"][:least]
        assert math.isfinite(read(f"{name}({', '.join(arguments)})")(VALUES))
