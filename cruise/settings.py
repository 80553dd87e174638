"""Strict settings: YAML text becomes a typed, frozen struct, and every mistake names its place and its remedy.

    file.yaml:12: limits.max_acel_mps2: unknown setting; did you mean max_accel_mps2?

The dialect is the core schema of YAML 1.2 (yaml.org/spec/1.2.2, section 10.3): 1e-3 is a number, and on, off, yes, no
and 1:30 are text. PyYAML's own dialect, YAML 1.1, has both the other way round. Anchors, aliases and tags are refused,
and so are nan and inf: a nan passes every comparison with a limit.

What is written begins with `%YAML 1.2` and ends with `...`, both as the standard has them (sections 6.8 and 9.1), and
what begins so and has no such end is refused: the last lines of a model file are history, and without them the rest
would look whole. What is written by hand needs neither.
"""

import difflib
import enum
import math
import os
import re
import typing
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, TextIO, TypeVar

import msgspec
import yaml

MAX_BYTES = 1_000_000  # a settings file has 10 kB, a model file with its history 100 kB; PyYAML reads about 100 kB/s
DECLARED, END = "%YAML", re.compile(r"^\.\.\.", re.MULTILINE)  # of a written file, the first line and the last
EMPTY = '""'  # how a choice of no text is written
MAX_DEPTH = 32  # settings nest 4 deep; Python's own stack ends near 200 nested nodes

_CORE_SCHEMA = (  # tag, pattern, first characters; in the order of precedence
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]{1,19}|0o[0-7]{1,21}|0x[0-9a-fA-F]{1,16}", "-+0123456789"),
    ("tag:yaml.org,2002:float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", "-+.0123456789"),
    ("tag:yaml.org,2002:float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+."),
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
)

T = TypeVar("T", bound=msgspec.Struct)

Positive = Annotated[float, msgspec.Meta(gt=0)]
"""For settings that divide or scale: times, rates, standard deviations."""


def refuse_wide(settings: msgspec.Struct, most: float) -> None:
    """Raise ValueError for a number above `most` times its default, which would switch off what it guards."""
    for field in msgspec.structs.fields(settings):
        value = getattr(settings, field.name)
        if isinstance(field.default, float) and value > most * field.default:
            raise ValueError(
                f"{field.name} is {value:g}, more than {most:g} times the default of {field.default:g}: "
                "that would switch the check off"
            )


class SettingsError(ValueError):
    """A setting or a configuration file that the user has to correct; the message says where and how."""


def load(path: str | Path, type_: type[T]) -> T:
    """Read the YAML file at `path` as a `type_`; raise SettingsError with every mistake in it, one a line."""
    file = Path(path)
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise SettingsError(f"{path}: no such file; give the path of an existing YAML file") from error
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > MAX_BYTES:
        raise SettingsError(f"{path}: longer than {MAX_BYTES} bytes; this is not a settings file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SettingsError(f"{path}:{line}: not UTF-8 text; save the file as UTF-8") from error
    return parse(text, type_, str(path))


def parse(text: str, type_: type[T], source: str) -> T:
    """Read YAML `text` as a `type_`; `source` is what errors call it. Raises SettingsError, as `load` does."""
    if text.startswith(DECLARED) and not END.search(text):
        raise SettingsError(
            f"{source}:{len(text.splitlines())}: cut off, for the file begins with {DECLARED} and has no '...' at its "
            "end; take a whole copy of it"
        )
    root = _compose(text, source)
    if root is None:
        needs = ", ".join(field.encode_name for field in msgspec.structs.fields(type_) if field.required)
        raise SettingsError(f"{source}: empty; it needs {needs or 'at least one setting'}")
    problems = [f"{source}:{line}: {problem}" for line, problem in _problems(root, type_, "")]
    if problems:
        raise SettingsError("\n".join(problems))
    return msgspec.convert(_value(root), type_)


def save(path: str | Path, struct: msgspec.Struct) -> None:
    """Write `struct` to `path` so that `load` gives an equal one; the file is the old or the new one, never half.

    Raises ValueError, before anything is written, for a struct that could not be read back (nan, inf).
    """
    text = dump(struct)
    if parse(text, type(struct), str(path)) != struct:
        raise ValueError(f"{path}: {type(struct).__name__} does not survive being written and read")
    with replaced(path, newline="\n") as stream:
        stream.write(text)


@contextmanager
def named(path: str | Path) -> Iterator[None]:
    """Let an error of the system that names no file, as that of a full disk, name the one that is written."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


@contextmanager
def replaced(path: str | Path, newline: str) -> Iterator[TextIO]:
    """A text that goes to `.NAME.tmp` beside the file, to the disk, and then takes its place in one step.

    Where anything goes wrong before, the old file stays. One writer a file.
    """
    file = Path(path).resolve()  # a symbolic link stays, what it points at is replaced
    temporary = file.with_name(f".{file.name}.tmp")
    try:
        with named(path), temporary.open("w", encoding="utf-8", newline=newline) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(file)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    directory = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(directory)  # without it a power cut may bring the old name back
    finally:
        os.close(directory)


def dump(struct: msgspec.Struct) -> str:
    """Return `struct` as the YAML text that `parse` reads."""
    return yaml.dump(
        msgspec.to_builtins(struct), Dumper=_Dumper, sort_keys=False, width=110, version=(1, 2), explicit_end=True
    )


class _Loader(yaml.SafeLoader):
    """Composes nodes in the core schema, of bounded depth and without aliases (their expansion has no bound)."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()
        if getattr(event, "anchor", None) is not None:
            raise _refused("anchors and aliases are not used here; write the value out", event)
        if getattr(event, "tag", None) is not None:
            raise _refused("tags are not used here; write the value alone", event)
        is_key = index is None and parent is not None  # an item has its number there, a mapping's value its key
        if is_key and not isinstance(event, yaml.ScalarEvent):
            raise _refused("a key has to be a word or a number", event)
        if self.depth == MAX_DEPTH:
            raise _refused(f"nested deeper than {MAX_DEPTH}", event)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def _refused(problem: str, event: yaml.Event) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


class _Dumper(yaml.SafeDumper):
    """Writes in the core schema, so that text that looks like a number there is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _dialect in (_Loader, _Dumper):
    _dialect.yaml_implicit_resolvers = {}  # PyYAML's own: YAML 1.1
    for _tag, _pattern, _first in _CORE_SCHEMA:
        _dialect.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), list(_first))


def _compose(text: str, source: str) -> yaml.Node | None:
    try:
        return _Loader(text).get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = mark.line + 1 if mark else 1
        raise SettingsError(f"{source}:{line}: {_syntax_problem(error)}") from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, int(error.position)) + 1
        raise SettingsError(f"{source}:{line}: character {chr(error.character)!r} is not allowed; delete it") from error


def _syntax_problem(error: yaml.MarkedYAMLError) -> str:
    problem = str(error.problem)
    if "'\\t'" in problem:
        return "a tab; YAML is indented with spaces"
    if problem == "but found another document":
        return "a second document begins; keep one a file, and nothing behind '...'"
    return f"not YAML: {', '.join(str(part) for part in (error.context, error.problem) if part)}"


def _problems(node: yaml.Node, type_: Any, key: str) -> list[tuple[int, str]]:
    """Walk the nodes and the type together and return line and text of each mistake, the deepest ones first.

    msgspec alone would stop at the first one, and would not say in which entry of a mapping it is.
    """
    return list(_parts(node, _branch(node, type_), key)) or list(_own(node, type_, key))


def _parts(node: yaml.Node, type_: Any, key: str) -> Iterator[tuple[int, str]]:
    """Yield the mistakes in the parts of `node`: its keys, its values, its items."""
    origin = typing.get_origin(type_) or type_
    if isinstance(origin, type) and issubclass(origin, msgspec.Struct):
        yield from _struct_parts(node, origin, key)
    elif isinstance(node, yaml.MappingNode) and isinstance(origin, type) and issubclass(origin, Mapping):
        yield from _repeated_keys(node, key)
        key_type, value_type = typing.get_args(type_) or (Any, Any)
        for name, child in node.value:
            yield from _own(name, key_type, _joined(key, name.value))
            yield from _problems(child, value_type, _joined(key, name.value))
    elif isinstance(node, yaml.SequenceNode) and origin in (list, tuple, set, frozenset):
        items = typing.get_args(type_) or (Any, ...)
        if origin is not tuple or items[-1] is Ellipsis:
            items = items[:1] * len(node.value)
        for index, (child, item) in enumerate(zip(node.value, items, strict=False)):
            yield from _problems(child, item, f"{key}[{index}]")


def _own(node: yaml.Node, type_: Any, key: str) -> Iterator[tuple[int, str]]:
    """Yield what is wrong with `node` as a whole: its type, its range, a rule of the struct's own."""
    value = _value(node)
    if isinstance(value, float) and not math.isfinite(value):
        yield _line(node), _prefixed(key, f"expected a finite number, got {_shown(node)}")
        return
    try:
        msgspec.convert(value, type_)
    except msgspec.ValidationError as error:
        problem = str(error).partition(" - at `$")[0].partition(", got ")[0].replace("`", "")
        if choices := _choices(type_):
            problem = f"expected one of {', '.join(choices)}, got {_shown(node)}"
        elif problem.startswith(("Expected", "Invalid")):
            problem = f"{problem[0].lower()}{problem[1:]}, got {_shown(node)}"
        yield _line(node), _prefixed(key, problem + _remedy(value, type_))


def _branch(node: yaml.Node, type_: Any) -> Any:
    """Reduce `type_` to what `node` can be of it, where that is plain: X of X | None, one of several tagged structs."""
    if isinstance(node, yaml.ScalarNode):
        members = _structs(type_)
        return members[0] if len(members) == 1 and type_ is members[0] else type_
    if type_ is Any:
        return dict if isinstance(node, yaml.MappingNode) else list
    if typing.get_origin(type_) is Annotated:
        return _branch(node, typing.get_args(type_)[0])
    if typing.get_origin(type_) in (typing.Union, UnionType):
        members = [member for member in typing.get_args(type_) if member is not NoneType]
        if len(members) == 1:
            return _branch(node, members[0])
        for member in _structs(type_):
            config = member.__struct_config__
            if config.tag is not None and _text_at(node, config.tag_field) == str(config.tag):
                return member
        if isinstance(node, yaml.SequenceNode):  # one or several: X | tuple[X, ...]
            return next((member for member in members if typing.get_origin(member) in (list, tuple)), type_)
        untagged = [member for member in _structs(type_) if member.__struct_config__.tag is None]
        return untagged[0] if len(untagged) == 1 else type_
    return type_


def _structs(type_: Any) -> list[type[msgspec.Struct]]:
    members = typing.get_args(type_) if typing.get_origin(type_) in (typing.Union, UnionType) else (type_,)
    return [member for member in members if isinstance(member, type) and issubclass(member, msgspec.Struct)]


def _struct_parts(node: yaml.Node, type_: type[msgspec.Struct], key: str) -> Iterator[tuple[int, str]]:
    if not isinstance(node, yaml.MappingNode):
        yield _line(node), _prefixed(key, f"expected settings, one 'key: value' a line, got {_shown(node)}")
        return
    yield from _repeated_keys(node, key)
    fields = {field.encode_name: field for field in msgspec.structs.fields(type_)}
    present = {name.value for name, _ in node.value}
    for name, child in node.value:
        if name.value in fields:
            yield from _problems(child, fields[name.value].type, _joined(key, name.value))
        elif name.value != type_.__struct_config__.tag_field:
            problem = f"unknown setting; {_nearest(name.value, fields, 'known here')}"
            yield _line(name), _prefixed(_joined(key, name.value), problem)
    for name, field in fields.items():
        if field.required and name not in present:
            yield _line(node), _prefixed(_joined(key, name), f"missing; add it ({_type_name(field.type)})")


def _repeated_keys(node: yaml.MappingNode, key: str) -> Iterator[tuple[int, str]]:
    first: dict[str, yaml.Node] = {}
    for name, _ in node.value:
        earlier = first.setdefault(name.value, name)
        if earlier is not name:
            yield _line(name), _prefixed(_joined(key, name.value), f"set twice; line {_line(earlier)} sets it too")


def _remedy(value: Any, type_: Any) -> str:
    """Return what to do about a `value` that is not a `type_`, or nothing where the expectation says it all."""
    configs = [struct.__struct_config__ for struct in _structs(type_)]
    tagged = {str(config.tag): config for config in configs if config.tag is not None}
    if isinstance(value, dict) and tagged:
        tag_field = next(iter(tagged.values())).tag_field
        return f"; {tag_field}: {_nearest(str(value.get(tag_field)), tagged, 'one of')}"
    if near := difflib.get_close_matches(str(value), _choices(type_), n=1):
        return f"; did you mean {near[0]}?"
    types = {_type_name(member) for member in typing.get_args(type_) or (type_,)} | {_type_name(type_)}
    if isinstance(value, str) and "bool" in types:
        return "; write true or false"
    if isinstance(value, str) and types & {"float", "int"}:
        return "; write a plain number such as 0.5, without unit, comma or quotes"
    if isinstance(value, bool | int | float) and "str" in types:
        return "; put it in quotes"
    return ""


def _choices(type_: Any) -> list[str]:
    if typing.get_origin(type_) in (typing.Union, UnionType):
        return [choice for member in typing.get_args(type_) for choice in _choices(member)]
    if typing.get_origin(type_) is typing.Literal:
        return [str(choice) or EMPTY for choice in typing.get_args(type_)]
    if isinstance(type_, type) and issubclass(type_, enum.Enum):
        return [str(member.value) for member in type_]
    return []


def _nearest(word: str, known: Iterable[str], otherwise: str) -> str:
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {near[0]}?" if near else f"{otherwise}: {', '.join(known) or 'nothing'}"


def _value(node: yaml.Node) -> Any:
    """Return the plain Python value of a node in the core schema."""
    if isinstance(node, yaml.MappingNode):
        return {_value(name): _value(child) for name, child in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [_value(child) for child in node.value]
    kind, text = node.tag.rpartition(":")[2], node.value
    if kind == "null":
        return None
    if kind == "bool":
        return text.lower() == "true"
    if kind == "int":
        return int(text, 0 if text[:2] in ("0x", "0o") else 10)
    if kind == "float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text


def _text_at(node: yaml.Node, name: str | None) -> str | None:
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return next((child.value for key, child in pairs if key.value == name), None)


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1


def _joined(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _prefixed(key: str, problem: str) -> str:
    return f"{key}: {problem}" if key else problem


def _shown(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return "nothing" if node.value == "" else repr(_value(node))[:60]
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def _type_name(type_: Any) -> str:
    if typing.get_origin(type_) is Annotated:
        return _type_name(typing.get_args(type_)[0])
    return type_.__name__ if isinstance(type_, type) else str(type_).replace("typing.", "")
