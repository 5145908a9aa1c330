"""Configuration: one TOML file and ``--set`` overrides into frozen structs, and back into TOML.

Any ``msgspec.Struct`` may be the root; types, ``msgspec.Meta`` bounds, ``Literal`` and tagged unions are its schema. A
table needs only the keys that it changes. Some sections may stand in a file of their own (a vehicle, a preset, a CSV),
whose path is relative to the configuration's: it is read once, so that what was checked is what flies. msgspec checks
the types too, but its errors don't speak to an operator.

A factory is code of the user's own that a configuration names, ``kind = "package.module:factory"``. An object that
Python already has is lent to a flight under such a name (:func:`lend`). What goes wrong in it is told in one sentence,
with the user's own frames behind it (:class:`UserCodeFault`).
"""

import copy
import importlib
import inspect
import linecache
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, ParamSpec, TypeVar

import msgspec
import tomli_w
from msgspec import inspect as mi

from groundstation.config.retired import drop_retired_keys

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


_FIRST, _NEXT = "[A-Za-z0-9]", "[A-Za-z0-9_.-]"
"""The first a letter or a digit: no option, no hidden file, no folder above."""
NAME = f"{_FIRST}{_NEXT}*"
"""A name within a longer pattern."""
FACTORY = r"\A[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*\Z"
"""``package.module:factory``."""
VEHICLE_LETTERS, CLIENT_LETTERS = 24, 32
"""So long may the name of a vehicle be, and that of a client."""


def name_pattern(most: int) -> str:
    """The pattern of a whole name of at most ``most`` letters; ``$`` would let a line end pass."""
    return rf"\A{_FIRST}{_NEXT}{{0,{most - 1}}}\Z"


def describe_name(most: int) -> str:
    """The same in words."""
    return f"a name matching {describe_pattern(name_pattern(most))}"


def describe_pattern(pattern: str) -> str:
    """``pattern``, that of a whole text, as people write it."""
    return pattern.removeprefix(r"\A").removesuffix(r"\Z")


def is_name(text: str, most: int) -> bool:
    """Whether ``text`` is one of at most ``most`` letters."""
    return re.search(name_pattern(most), text) is not None


def describe_type(info: mi.Type) -> str:
    """What a key of this type accepts, in words: ``a number > 0``, ``one of ['vicon', 'natnet']``."""
    match info:
        case mi.Metadata():
            return describe_type(info.type)
        case mi.FloatType():
            return "a number" + _bounds(info)
        case mi.IntType():
            return "a whole number" + _bounds(info)
        case mi.BoolType():
            return "true or false"
        case mi.StrType():
            return (
                "a string"
                + _lengths(info, "character")
                + (f" matching {describe_pattern(info.pattern)}" if info.pattern else "")
            )
        case mi.LiteralType():
            return f"one of {list(info.values)}"
        case mi.EnumType():
            return f"one of {[one.value for one in info.cls]}"
        case mi.TupleType():
            each = " or ".join(dict.fromkeys(map(describe_type, info.item_types)))
            return f"an array of {len(info.item_types)} values, each {each}"
        case mi.VarTupleType() | mi.ListType():
            return f"an array{_lengths(info, 'value')}, each {describe_type(info.item_type)}"
        case mi.UnionType():
            kinds = [kind for kind in info.types if not isinstance(kind, mi.NoneType)]
            tagged = [kind for kind in map(strip_metadata, kinds) if isinstance(kind, mi.StructType) and kind.tag_field]
            if len(tagged) == len(kinds) > 1:
                return f"a table with {tagged[0].tag_field}, one of {[kind.tag for kind in tagged]}"
            return " or ".join(dict.fromkeys(map(describe_type, kinds)))
        case mi.StructType():
            needed = [field.encode_name for field in info.fields if field.required]
            return f"a table with {', '.join(needed)}" if needed else "a table"
        case mi.DictType():
            return "a table"
    return "a value"


def _bounds(info: mi.FloatType | mi.IntType) -> str:
    signs = ((">", info.gt), (">=", info.ge), ("<", info.lt), ("<=", info.le), ("a multiple of", info.multiple_of))
    text = " and ".join(f"{sign} {bound:g}" for sign, bound in signs if bound is not None)
    return f" {text}" if text else ""


def _lengths(info: mi.StrType | mi.VarTupleType | mi.ListType, unit: str) -> str:
    low, high = info.min_length, info.max_length
    if low is None and high is None:
        return ""
    if high is None:
        return f" of at least {low} {unit}{'' if low == 1 else 's'}"
    return f" of {low or 0} to {high} {unit}s"


def strip_metadata(info: mi.Type) -> mi.Type:
    """The type without its remarks."""
    return strip_metadata(info.type) if isinstance(info, mi.Metadata) else info


def describe_unknown_key(key: str, value: Any, known: list[str]) -> str:
    """What is wrong with a key that is none of ``known``, and which of them may have been meant."""
    from difflib import get_close_matches

    near = get_close_matches(key, known, n=1)
    what = "unknown section" if isinstance(value, dict) else "unknown key"
    return f"{what}{f'; did you mean {near[0]}?' if near else ''} (known: {', '.join(known) or 'none'})"


def describe_value(value: Any) -> str:
    """What was written instead, no longer than a line."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a number of more than 40 digits"
    text = repr(value) if isinstance(value, str | int | float | list) else str(value)
    return text if len(text) <= 80 else text[:77] + "..."


KeyPath = tuple[str, ...]


class ConfigError(Exception):
    """A bad configuration, as one line for the operator: ``source: key: problem``."""

    def __init__(self, key: str, problem: str, source: str = "") -> None:
        """Keep ``key`` (dotted, may be empty), ``problem``, and ``source`` (the file's name, or the override)."""
        super().__init__(": ".join(part for part in (source, key, problem) if part))
        self.key = key
        self.problem = problem
        self.source = source


class ArgumentError(ConfigError):
    """A bad argument of a function, by its name in Python; whoever runs a program gave it as ``option``."""

    def __init__(self, option: str, problem: str) -> None:
        super().__init__("overrides" if option == "--set" else option.removeprefix("--"), problem)
        self.option = option


@contextmanager
def refuse_io(key: str, doing: str, source: str = "") -> Iterator[None]:
    """Tell the operator by ``key`` why what is done here, such as ``cannot write FILE``, is not possible.

    Raises:
        ConfigError: in the place of an OSError.
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(key, f"{doing}: {error.strerror or error}", source) from None


def locate(error: msgspec.ValidationError) -> tuple[str, str]:
    """The dotted key that ``error`` is about (empty: the whole), and what is wrong there."""
    text, _, where = str(error).partition(" - at `$")
    return where.rstrip("`").lstrip("."), text


class Problem(Exception):
    """A key that is wrong, and why."""

    def __init__(self, path: KeyPath, text: str) -> None:
        super().__init__(text)
        self.path = path
        self.text = text


class OpenFactory:
    """Beside a struct of a tagged union, with the keys ``factory`` and ``options``: its ``kind`` may name a factory.

    So it also answers to tags that nobody can list.
    """

    __slots__ = ()
    EXAMPLE: ClassVar[str] = "package.module:factory"
    """Such a tag, for error messages."""

    @classmethod
    def expand(cls, table: dict[str, Any]) -> dict[str, Any]:
        """``table`` in this struct's own form where its ``kind`` names a factory, else as it is.

        Keys that the struct does not have are the factory's options.
        """
        named = table.get("kind")
        if not isinstance(named, str) or not re.match(FACTORY, named):
            return table
        own = set(cls.__struct_encode_fields__) - {"factory"}  # type: ignore[attr-defined]  # it stands beside a struct
        kept = {key: value for key, value in table.items() if key in own}
        given = {key: value for key, value in table.items() if key not in own and key != "kind"}
        if given:
            inner = kept.get("options", {})
            kept["options"] = {**inner, **given} if isinstance(inner, dict) else inner
        return {"kind": "custom", "factory": named, **kept}


class FromFile:
    """Beside a struct that is a section of a configuration: its keys may stand in a file, which its key ``file`` names.

    Such a struct has the optional key ``file``, and ``preset`` if it has :attr:`PRESETS`. Both are gone once read.
    """

    __slots__ = ()
    PRESETS: ClassVar[str] = ""
    """Folder of this package with files that come along, one a preset; empty where there are none."""

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """The section as written, ``table``, completed from the text of its file.

        Raises:
            ValueError: what is wrong with the text, and in which line or key; without the file's name.
        """
        raise NotImplementedError


@cache
def inspect_struct(root: type[msgspec.Struct]) -> mi.Type:
    """What msgspec tells of ``root`` and all that it holds."""
    return mi.type_info(root)


def complete(root: type[msgspec.Struct], data: dict[str, Any]) -> dict[str, Any]:
    """``data`` checked as a ``root`` and completed with the defaults of the tables that it mentions.

    Raises:
        Problem: the first thing that is wrong, in the order of ``data``; a missing key comes after its neighbours.
    """
    result: dict[str, Any] = _complete(inspect_struct(root), data, None, ())
    return result


def kinds(root: type[msgspec.Struct], section: str) -> tuple[str, dict[Any, set[str]]]:
    """The key that tells a ``section`` of ``root`` its kind, and the keys of each kind; none where it has no kinds."""
    info = inspect_struct(root)
    assert isinstance(info, mi.StructType)
    for field in info.fields:
        if field.encode_name == section:
            union = strip_metadata(field.type)
            found = [strip_metadata(kind) for kind in (union.types if isinstance(union, mi.UnionType) else (union,))]
            tagged = [kind for kind in found if isinstance(kind, mi.StructType) and kind.tag_field is not None]
            keys = {kind.tag: {each.encode_name for each in kind.fields} for kind in tagged}
            return (tagged[0].tag_field or "", keys) if tagged else ("", {})
    return "", {}


def structs(info: mi.Type) -> list[mi.StructType]:
    """The structs that a value of this type may be."""
    info = strip_metadata(info)
    if isinstance(info, mi.StructType):
        return [info]
    if isinstance(info, mi.UnionType):
        return [struct for kind in info.types for struct in structs(kind)]
    return []


def keys_of(root: type[msgspec.Struct]) -> list[str]:
    """Every key that a ``root`` may have, of every kind of its sections, as an operator writes it; in their order."""
    return sorted({key for key, _ in _keys(mi.type_info(root), ())})


def texts_of(root: type[msgspec.Struct]) -> list[str]:
    """Those of :func:`keys_of` whose value may be a text, or hold one, that is not one of a few known words."""
    return sorted({key for key, info in _keys(mi.type_info(root), ()) if info is not None and _holds_text(info)})


def _holds_text(info: mi.Type) -> bool:
    match info:
        case mi.Metadata():
            return _holds_text(info.type)
        case mi.UnionType():
            return any(map(_holds_text, info.types))
        case mi.TupleType():
            return any(map(_holds_text, info.item_types))
        case mi.VarTupleType() | mi.ListType():
            return _holds_text(info.item_type)
    return not isinstance(info, mi.FloatType | mi.IntType | mi.BoolType | mi.LiteralType | mi.EnumType | mi.NoneType)


def _keys(info: mi.Type, path: KeyPath) -> Iterator[tuple[str, mi.Type | None]]:
    inner = structs(info)
    if not inner:
        yield dotted_key(path), info
    for struct in inner:
        if struct.tag_field is not None:
            yield dotted_key((*path, struct.tag_field)), None
        for field in struct.fields:
            yield from _keys(field.type, (*path, field.encode_name))


def dotted_key(path: KeyPath) -> str:
    """The path as an operator writes it."""
    return ".".join(path)


def _complete(info: mi.Type, value: Any, default: Any, path: KeyPath) -> Any:
    """``value`` checked against ``info``, its missing keys taken from ``default`` (a struct, or None)."""
    match info:
        case mi.Metadata():
            return _complete(info.type, value, default, path)
        case mi.StructType():
            return _struct(info, value, default, path)
        case mi.UnionType():
            return _union(info, value, default, path)
        case mi.DictType():
            if not isinstance(value, dict):
                _refuse(info, value, path)
            return {key: _complete(info.value_type, item, None, (*path, key)) for key, item in value.items()}
        case mi.TupleType():
            if not isinstance(value, list | tuple) or len(value) != len(info.item_types):
                _refuse(info, value, path)
            return [
                _complete(kind, item, None, _element_path(path, i))
                for i, (kind, item) in enumerate(zip(info.item_types, value, strict=True))
            ]
        case mi.VarTupleType() | mi.ListType():
            if not isinstance(value, list | tuple) or not _within(len(value), info.min_length, info.max_length):
                _refuse(info, value, path)
            return [_complete(info.item_type, item, None, _element_path(path, i)) for i, item in enumerate(value)]
    if not _SCALARS.get(type(info), lambda _info, _value: True)(info, value):
        _refuse(info, value, path)
    return value


def _struct(info: mi.StructType, value: Any, default: Any, path: KeyPath) -> dict[str, Any]:
    if not isinstance(value, dict):
        _refuse(info, value, path)
    tag = {} if info.tag_field is None else {info.tag_field: info.tag}
    fields = {field.encode_name: field for field in info.fields}
    complete: dict[str, Any] = dict(tag)
    for key, item in value.items():
        inner = (*path, key)
        if key in fields:
            field = fields[key]
            base = _default(field) if default is None else getattr(default, field.name)
            complete[key] = _complete(field.type, item, base, inner)
        elif key not in tag:
            raise Problem(inner, describe_unknown_key(key, item, [*tag, *fields]))
        elif item != info.tag:
            raise Problem(inner, f"expected one of {[info.tag]}, got {describe_value(item)}")
    for key, field in fields.items():
        if key in complete:
            continue
        if default is not None:
            complete[key] = msgspec.to_builtins(getattr(default, field.name))
        elif field.required:
            raise Problem((*path, key), f"missing; expected {describe_type(field.type)}")
    return complete


def _union(info: mi.UnionType, value: Any, default: Any, path: KeyPath) -> Any:
    structs = {kind.tag: kind for kind in map(strip_metadata, info.types) if isinstance(kind, mi.StructType)}
    if isinstance(value, dict) and structs:
        fallback = next((tag for tag, kind in structs.items() if isinstance(default, kind.cls)), None)
        first = next(iter(structs.values()))
        if first.tag_field is None:
            return _complete(first, value, default, path)
        accepted: list[Any] = list(structs)
        for struct in structs.values():
            if issubclass(struct.cls, OpenFactory):
                value = struct.cls.expand(value)
                accepted.append(struct.cls.EXAMPLE)
        tag = value.get(first.tag_field, fallback)
        if tag is None:
            raise Problem((*path, first.tag_field), f"missing; expected one of {accepted}")
        if not isinstance(tag, str | int) or tag not in structs:
            raise Problem((*path, first.tag_field), f"expected one of {accepted}, got {describe_value(tag)}")
        return _complete(structs[tag], value, default if tag == fallback else None, path)
    problems = []
    for kind in info.types:
        try:
            return _complete(kind, value, None, path)
        except Problem as problem:
            problems.append(problem)
    deeper = [problem for problem in problems if len(problem.path) > len(path)]
    if len(deeper) == 1:
        raise deeper[0]
    _refuse(info, value, path)


def _is_float(info: Any, value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value)) and is_within_bounds(info, value)
    except OverflowError:
        return False


def _is_str(info: Any, value: Any) -> bool:
    return (
        isinstance(value, str)
        and _within(len(value), info.min_length, info.max_length)
        and (info.pattern is None or re.search(info.pattern, value) is not None)
    )


_SCALARS: dict[type, Callable[[Any, Any], bool]] = {
    mi.FloatType: _is_float,
    mi.IntType: lambda info, value: type(value) is int and abs(value) < 2**63 and is_within_bounds(info, value),
    mi.BoolType: lambda _, value: isinstance(value, bool),
    mi.StrType: _is_str,
    mi.NoneType: lambda _, value: value is None,
    mi.LiteralType: lambda info, value: any(type(value) is type(one) and value == one for one in info.values),
    mi.EnumType: lambda info, value: any(type(value) is type(one.value) and value == one.value for one in info.cls),
}


def is_within_bounds(info: mi.FloatType | mi.IntType, value: float) -> bool:
    """Whether what ``info`` asks of a number holds for ``value``."""
    return (
        (info.gt is None or value > info.gt)
        and (info.ge is None or value >= info.ge)
        and (info.lt is None or value < info.lt)
        and (info.le is None or value <= info.le)
        and (info.multiple_of is None or value % info.multiple_of == 0)
    )


def _within(length: int, low: int | None, high: int | None) -> bool:
    return (low is None or length >= low) and (high is None or length <= high)


def _default(field: mi.Field) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return None if field.default is msgspec.NODEFAULT else field.default


def _refuse(info: mi.Type, value: Any, path: KeyPath) -> NoReturn:
    raise Problem(path, f"expected {describe_type(info)}, got {describe_value(value)}")


def _element_path(path: KeyPath, index: int) -> KeyPath:
    return (*path[:-1], f"{path[-1]}[{index}]")


Option = bool | int | float | str | list[bool | int | float | str]
"""What an option may be; NaN and infinity are refused as everywhere."""
_LENT: "ContextVar[Mapping[str, object]]" = ContextVar("lent")


P = ParamSpec("P")
R = TypeVar("R")


class UserCodeFault(Exception):
    """Code of the user's own failed, or answered with what must not leave; its cause has the user's frames."""

    def __init__(self, what: str, error: BaseException | None = None) -> None:
        """``what`` failed with ``error``, which was caught by whoever called the user's code; or did what is told."""
        super().__init__(what if error is None else f"{what} failed: {describe_error(error)}")
        if error is not None:
            _strip_caller(error)
            self.__cause__ = error


def _strip_caller(error: BaseException) -> None:
    """Leave ``error`` the frames of the user's code alone, without that of whoever called it and caught it."""
    error.__traceback__ = error.__traceback__ and error.__traceback__.tb_next


def _strip_import(error: BaseException) -> None:
    """Leave ``error`` the frames of the module that was imported, if it was found, without those of the import."""
    frames = error.__traceback__ and error.__traceback__.tb_next
    while frames and frames.tb_frame.f_globals.get("__name__", "").startswith("importlib"):
        frames = frames.tb_next
    error.__traceback__ = frames


def without_frames(work: Callable[P, R]) -> Callable[P, R]:
    """``work``, whose refusals show whoever called it their own frames and names, and none of those between."""

    @wraps(work)
    def plain(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return work(*args, **kwargs)
        except ConfigError as fault:
            given = fault.key.startswith("--")
            raise (
                ArgumentError(fault.key, fault.problem) if given else fault.with_traceback(None)
            ) from fault.__cause__
        except (KeyboardInterrupt, UserCodeFault) as fault:
            fault.__suppress_context__ = True  # its cause is the user's own
            raise fault.with_traceback(None)  # noqa: B904

    return plain


def coroutine_hint(answer: object) -> str:
    """What to say behind the kind of an ``answer`` where it is a coroutine, which is then over; else nothing."""
    if not inspect.iscoroutine(answer):
        return ""
    answer.close()  # Python would complain that nobody has awaited it
    return " (write `def`, not `async def`)"


def several(names: Any) -> list[Any]:
    """The ``names`` in a list, also where it is but one that somebody gave without brackets."""
    return list(names) if isinstance(names, Iterable) and not isinstance(names, str) else [names]


def describe_error(error: BaseException) -> str:
    """Its kind and its words."""
    return f"{type(error).__name__}: {error}"


@contextmanager
def lend(objects: Mapping[str, object]) -> Iterator[None]:
    """Have each name (``module:name``) mean that object within this context, and in what is started in it."""
    token = _LENT.set({**_LENT.get({}), **objects})
    try:
        yield
    finally:
        _LENT.reset(token)


def name_object(thing: object) -> str:
    """A name for ``thing`` as :func:`lend` and configurations take it: its module's and its own, if it has them."""
    named = thing if inspect.isclass(thing) or inspect.isroutine(thing) else type(thing)
    module, name = getattr(named, "__module__", None) or "python", getattr(named, "__name__", "given")
    text = f"{module}:{re.sub(r'[^A-Za-z0-9_]', '_', name)}"
    return text if re.match(FACTORY, text) else "python:given"


def find_object(key: str, factory: str) -> Any:
    """What ``factory`` names: what was lent under it, or else what its module has.

    Raises:
        ConfigError: it can't be imported, or is not there; by ``key``.
    """
    lent = _LENT.get({})
    if factory in lent:
        return lent[factory]
    module_name, _, name = factory.partition(":")
    try:
        module = importlib.import_module(module_name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever the user's module raises, sys.exit too, the operator must hear of it
        _strip_import(error)
        hint = " (is it installed, or its folder on PYTHONPATH?)" if isinstance(error, ModuleNotFoundError) else ""
        raise ConfigError(key, f"can't import {module_name}: {describe_error(error)}{hint}") from error
    if not hasattr(module, name):
        raise ConfigError(key, f"{module_name} has no attribute {name!r}")
    return getattr(module, name)


def _parameters(function: Callable[..., Any]) -> list[inspect.Parameter] | None:
    try:
        return list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return None


def needed_names(function: Callable[..., Any], options: Mapping[str, Any]) -> list[str] | None:
    """The names of the arguments that ``function`` needs beside ``options``; None where it does not tell."""
    parameters = _parameters(function)
    if parameters is None or any(one.kind is one.VAR_POSITIONAL for one in parameters):
        return None
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [
        one.name for one in parameters if one.kind in places and one.default is one.empty and one.name not in options
    ]


def call_factory(key: str, factory: str, found: Any, told: tuple[Any, ...], options: Mapping[str, Any]) -> Any:
    """What the user's ``found`` makes; an object that is one already is copied, so that each flight begins anew.

    A factory is given as much of ``told`` as it needs, then the options as one dict where it needs more, or by name.

    Raises:
        ConfigError: it can't be called so, or fails; by ``key``.
    """
    if not callable(found):
        return copy.deepcopy(found)
    needed = needed_names(found, options)
    arguments: tuple[Any, ...] = (*told, dict(options))
    named: dict[str, Any] = {}
    as_dict = any(one.name == "options" and one.kind is not one.VAR_KEYWORD for one in _parameters(found) or ())
    if needed is not None and len(needed) <= len(told) and not as_dict:
        arguments, named = told[: len(needed)], dict(options)
    try:
        return found(*arguments, **named)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # as above
        _strip_caller(error)
        raise ConfigError(key, f"{factory} failed: {describe_error(error)}") from error


PACKAGE = "groundstation"
"""Where the presets stand."""
DEEPEST = 16
"""Tables and arrays stand within each other no deeper than this; ours need 5."""
TOO_DEEP = f"no configuration: its tables or arrays stand more than {DEEPEST} deep within each other"


def parse_toml(text: str) -> dict[str, Any]:
    """What the TOML ``text`` says.

    Raises:
        ValueError: it is no TOML, or nested deeper than any configuration is.
    """
    import tomllib

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not valid TOML: {error}") from None
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    inside: list[Any] = [data]
    for _ in range(DEEPEST):
        inside = [one for item in inside for one in (item.values() if isinstance(item, dict) else item)]
        inside = [one for one in inside if isinstance(one, dict | list)]
        if not inside:
            return data
    raise ValueError(TOO_DEEP)


def with_files(root: type[msgspec.Struct], data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with each section that names a ``preset`` or a ``file`` completed from it.

    Args:
        root: the configuration's type; its fields are the sections.
        data: what was written.
        folder: what the names of files are relative to.

    Raises:
        Problem: a file can't be read, or its text is wrong; the path is that of the key that names it.
    """
    info = inspect_struct(root)
    assert isinstance(info, mi.StructType)
    changed = dict(data)
    for field in info.fields:
        table = data.get(field.encode_name)
        if isinstance(table, dict):
            kind = _kind(field, table)
            if kind is not None:
                changed[field.encode_name] = _read_section(kind, table, folder, (field.encode_name,))
    return changed


def resolve_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with the name of each key, password or certificate (``…_file = "name"``) as it is seen from ``folder``.

    The names become absolute, so that the configuration in force means the same wherever it is read again.
    """
    changed: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, dict):
            changed[key] = resolve_files(value, folder)
        elif key.endswith("_file") and isinstance(value, str) and value:
            changed[key] = str(folder.absolute() / value)
        else:
            changed[key] = value
    return changed


def presets(kind: type[FromFile]) -> dict[str, str]:
    """The text of each preset of ``kind``, by name, in the order of their names."""
    return shipped_texts(kind.PRESETS) if kind.PRESETS else {}


def _kind(field: mi.Field, table: dict[str, Any]) -> type[FromFile] | None:
    """The struct of the section ``table`` if it may stand in a file."""
    info = strip_metadata(field.type)
    kinds = [strip_metadata(one) for one in info.types] if isinstance(info, mi.UnionType) else [info]
    for kind in kinds:
        if isinstance(kind, mi.StructType) and issubclass(kind.cls, FromFile):
            default = isinstance(field.default, kind.cls)
            tag = kind.tag if kind.tag_field is None else table.get(kind.tag_field, kind.tag if default else None)
            if tag == kind.tag:
                return kind.cls
    return None


def _read_section(kind: type[FromFile], table: dict[str, Any], folder: Path, path: KeyPath) -> dict[str, Any]:
    preset, file = table.get("preset"), table.get("file")
    rest = {key: value for key, value in table.items() if key not in ("preset", "file")}
    if kind.PRESETS and isinstance(preset, str):
        if file is not None:
            raise Problem((*path, "file"), "preset and file exclude each other; a file may name a preset itself")
        known = presets(kind)
        if preset not in known:
            raise Problem((*path, "preset"), f"expected one of {list(known)}, got {preset!r}")
        return _with_text(kind, rest, known[preset], preset, (*path, "preset"))
    if isinstance(file, str):
        return _with_text(kind, rest, _read_text(folder / file, (*path, "file")), file, (*path, "file"))
    return table


def _with_text(kind: type[FromFile], table: dict[str, Any], text: str, name: str, path: KeyPath) -> dict[str, Any]:
    try:
        return kind.with_text(table, text)
    except ValueError as error:
        raise Problem(path, f"{name}: {error}") from None


def _read_text(file: Path, path: KeyPath) -> str:
    try:
        return file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise Problem(path, f"cannot read {file}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise Problem(path, f"{file} is not UTF-8 text (byte {error.start})") from None
    except ValueError as error:  # a name that no file can have
        raise Problem(path, f"cannot read {str(file)!r}: {error}") from None


T = TypeVar("T", bound=msgspec.Struct)


def load(path: Path | None, root: type[T], overrides: Sequence[str] = ()) -> T:
    """The configuration in the TOML file ``path`` (None: all defaults), changed by ``overrides`` (``a.b=value``).

    Raises:
        ConfigError: the file can't be read or is not TOML, or see :func:`from_dict`.
    """
    if path is None:
        return from_dict({}, root, overrides)
    return from_dict(resolve_files(read_toml(path), path.parent), root, overrides, source=str(path), folder=path.parent)


def read_toml(path: Path) -> dict[str, Any]:
    """What the TOML file ``path`` says.

    Raises:
        ConfigError: it can't be read, or is not TOML.
    """
    try:
        return parse_toml(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError("", f"cannot read the configuration: {error.strerror}", str(path)) from None
    except UnicodeDecodeError as error:
        raise ConfigError("", f"not UTF-8 text (byte {error.start})", str(path)) from None
    except ValueError as error:
        raise ConfigError("", str(error), str(path)) from None


def from_dict(
    data: Mapping[str, Any], root: type[T], overrides: Sequence[str] = (), *, source: str = "", folder: Path = Path()
) -> T:
    """The configuration in ``data`` as a ``root``, changed by ``overrides``, ``source`` being named in errors.

    The value of an override is TOML (``3.5``, ``true``, ``[1, 2]``, ``"text"``), or else a string as it stands. One
    that gives a section another kind leaves out what ``data`` says there for the old kind alone.
    Files that a section names are relative to ``folder``. Keys of earlier versions are left out, with a warning.

    Raises:
        ConfigError: an unknown key, a missing one, or a value outside its type or bounds; NaN and infinity always.
    """
    data = drop_retired_keys(data, source)
    changed = dict(data)
    set_paths = [_override(changed, text) for text in overrides]
    changed = drop_retired_keys(changed, "--set")
    told = _switch(root, data, changed, set_paths)
    try:
        whole = complete(root, with_files(root, changed, folder))
    except Problem as problem:
        if problem.path[:1] in told and problem.text.startswith("missing"):
            key = dotted_key(problem.path)
            raise ConfigError(key, f"{problem.text}; add --set {key}=VALUE", "--set") from None
        raise ConfigError(
            dotted_key(problem.path), problem.text, _blame(problem.path, data, set_paths, source)
        ) from None
    try:
        return msgspec.convert(whole, root)
    except msgspec.ValidationError as error:  # what only a __post_init__ could see
        where, text = locate(error)
        path = tuple(where.split(".")) if where else ()
        name, colon, rest = text.partition(": ")
        if colon and name in _keys_at(whole, path):  # where several could be meant, the message begins with the key
            path, text = (*path, name), rest
        raise ConfigError(dotted_key(path), text, _blame(path, data, set_paths, source)) from None


def _keys_at(table: Any, path: KeyPath) -> Sequence[str]:
    for part in path:
        table = table.get(part) if isinstance(table, dict) else None
    return list(table) if isinstance(table, dict) else []


def dump(config: msgspec.Struct) -> str:
    """The configuration in force as TOML, each key with the first sentence of its docstring; loads back to the same.

    A key that is None has no TOML form and appears as a comment.
    """
    return "\n".join(_table(config, ())).lstrip("\n") + "\n"


def _override(data: dict[str, Any], text: str) -> KeyPath:
    """Set ``a.b=value`` in ``data`` (whose nested tables are copied, never changed) and return its path."""
    key, equals, value = text.partition("=")
    path = tuple(part.strip() for part in key.split("."))
    if not equals or not all(path):
        raise ConfigError("--set", f"expected key=value, such as vehicle.mass_kg=0.08, got {text!r}")
    if len(path) > DEEPEST:
        raise ConfigError("--set", TOO_DEEP)
    table = data
    for part in path[:-1]:
        inner = table.get(part)
        table[part] = dict(inner) if isinstance(inner, dict) else {}
        table = table[part]
    table[path[-1]] = _toml_value(value.strip())
    return path


def _switch(
    root: type[msgspec.Struct], data: Mapping[str, Any], changed: dict[str, Any], set_paths: Sequence[KeyPath]
) -> list[KeyPath]:
    """Where an override gives a section another kind, leave out the keys of ``data`` that only other kinds have.

    Returns the sections whose kind an override tells.
    """
    told: list[KeyPath] = []
    for section, *rest in set_paths:
        tag_field, keys = kinds(root, section)
        table, written = changed[section], data.get(section)
        if rest != [tag_field] or not keys or not isinstance(table, dict):
            continue
        told.append((section,))
        kind = table.get(tag_field)
        if isinstance(kind, str) and kind in keys and isinstance(written, Mapping) and kind != written.get(tag_field):
            strange = set().union(*keys.values()) - keys[kind]
            kept = {key: value for key, value in table.items() if key not in strange or (section, key) in set_paths}
            changed[section] = kept
    return told


_BARE_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.|\.[0-9]+)")


def _toml_value(text: str) -> Any:
    if _BARE_NUMBER.fullmatch(text):  # TOML wants digits on both sides of the point
        return float(text)
    try:
        parsed = parse_toml(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _blame(path: KeyPath, data: Any, set_paths: Iterable[KeyPath], source: str) -> str:
    """Who wrote the value at ``path``: an override, or else the file."""
    in_file = data
    for part in path:
        in_file = in_file[part] if isinstance(in_file, Mapping) and part in in_file else None
    for override in set_paths:
        if path[: len(override)] == override or (not isinstance(in_file, Mapping) and override[: len(path)] == path):
            return "--set"
    return source


def _folder(name: str) -> "Traversable":
    """A folder of files that come along."""
    from importlib import resources

    return resources.files(PACKAGE) / name


def shipped_texts(folder: str) -> dict[str, str]:
    """The text of each TOML file in a folder that comes along, by name and in the order of their names."""
    files = sorted(_folder(folder).iterdir(), key=lambda file: file.name.removesuffix(".toml"))
    return {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files if file.name.endswith(".toml")}


def example_texts() -> dict[str, str]:
    """The configurations that come along, by name."""
    return shipped_texts("examples")


def list_examples() -> str:
    """A line each: its name, and what it says first of itself."""
    texts = example_texts()
    width = max(map(len, texts))
    return "\n".join(f"{name:{width}}  {text.splitlines()[0].removeprefix('# ')}" for name, text in texts.items())


def example_text(name: str) -> str:
    """The configuration of that name, with its notes.

    Raises:
        ConfigError: there is none.
    """
    texts = example_texts()
    if name not in texts:
        raise ConfigError("config new", f"expected one of {list(texts)}, got {name!r}")
    return texts[name]


def copy_examples(folder: Path) -> None:
    """Write all of them, and the files beside them, into the new ``folder``.

    Raises:
        ConfigError: it exists, or can't be written.
    """
    with refuse_io("--all", f"cannot write {folder}"):
        _copy(_folder("examples"), folder)


def _copy(source: "Traversable", target: Path) -> None:
    if source.is_dir():
        target.mkdir()
        for each in source.iterdir():
            _copy(each, target / each.name)
    else:
        target.write_bytes(source.read_bytes())


def _table(table: msgspec.Struct | dict[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """The lines of one table: its own keys first, then its sub-tables, as TOML's order demands."""
    notes = field_notes(type(table)) if isinstance(table, msgspec.Struct) else {}
    entries = dict(_entries(table))
    if path:
        yield f"\n[{'.'.join(map(_key, path))}]"
    for key, value in entries.items():
        if _is_table(value):
            continue
        line = f"# {_key(key)} is not set" if value is None else f"{_key(key)} = {write_value(value)}"
        note = notes.get(key, "")
        yield f"{line}{'. ' if value is None else '  # '}{note}" if note else line
    for key, value in entries.items():
        if _is_table(value):
            yield from _table(value, (*path, key))


def _entries(table: msgspec.Struct | dict[str, Any]) -> Iterator[tuple[str, Any]]:
    if isinstance(table, dict):
        yield from table.items()
        return
    settings = table.__struct_config__
    if settings.tag_field is not None:
        yield settings.tag_field, settings.tag
    for key, name in _keys_and_names(type(table)):
        yield key, getattr(table, name)


def _is_table(value: Any) -> bool:
    return isinstance(value, msgspec.Struct | dict)


def write_value(value: Any) -> str:
    """``value`` as TOML, on one line."""
    if _is_table(value):
        items = ", ".join(f"{_key(key)} = {write_value(item)}" for key, item in _entries(value) if item is not None)
        return f"{{ {items} }}" if items else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(write_value, value))}]"
    if type(value) in (int, float):
        return str(value)
    return tomli_w.dumps({"v": msgspec.to_builtins(value)}).removeprefix("v = ").rstrip("\n")


def _key(key: str) -> str:
    if key.isidentifier() and key.isascii():  # all of ours, of which a configuration has hundreds
        return key
    return tomli_w.dumps({key: 0}).removesuffix(" = 0\n")


_FIELD = re.compile(r'^    (\w+): .*\n(?:(?:     .*|    [)\]}#].*)?\n)*    """(\S[\s\S]*?)"""', re.MULTILINE)
"""A field of a class, and its docstring: parsing all of them takes the time of a second of flight."""


_MARGIN = re.compile(r"\n[^ )\n#]")
"""Where a class of a module has ended: the next line that begins at the margin."""


@cache
def field_notes(struct: type[msgspec.Struct]) -> dict[str, str]:
    """The first sentence of the docstring of each field, by key; empty where the source can't be read."""
    found: dict[str, str] = {}
    for cls in reversed(struct.__mro__):
        for name, text in _FIELD.findall(_definition(cls)):
            found[name] = _sentence(text)
    return {key: found[name] for key, name in _keys_and_names(struct) if name in found}


def _keys_and_names(struct: type[msgspec.Struct]) -> Iterator[tuple[str, str]]:
    """Of each field, as it is written and as it is called here; msgspec.structs.fields() looks at all types, too."""
    return zip(struct.__struct_encode_fields__, struct.__struct_fields__, strict=True)


def _definition(cls: type) -> str:
    """The source of a class of a module; empty where it can't be read."""
    source = _source(cls.__module__)
    head = f"\nclass {cls.__qualname__}"
    start = max(source.find(head + end) for end in "(:")
    if start < 0:
        return ""
    end = _MARGIN.search(source, start + len(head))
    return source[start + 1 : end.start() + 1 if end else len(source)]


@cache
def _source(module: str) -> str:
    """The text of a module, after an empty line; empty where it can't be read, or is none, as msgspec's own."""
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    return "\n" + "".join(linecache.getlines(file)) if file.endswith(".py") else ""


def _sentence(text: str) -> str:
    words = " ".join(text.split()).replace("``", "`")
    end = words.find(". ")
    return words if end < 0 else words[: end + 1]
