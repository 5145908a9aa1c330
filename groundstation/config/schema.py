"""Schema of a configuration in words, from msgspec's description of structs and bounds."""

import re
from collections.abc import Iterable, Iterator, Mapping
from difflib import SequenceMatcher, get_close_matches
from functools import cache
from typing import Any, ClassVar

import msgspec
from msgspec import inspect as mi

from groundstation.config.errors import KeyPath, dotted_key

_FIRST, _NEXT = "[A-Za-z0-9]", "[A-Za-z0-9_.-]"
"""The first a letter or a digit: no option, no hidden file, no folder above."""
NAME = f"{_FIRST}{_NEXT}*"
"""A name within a longer pattern."""
FACTORY = r"\A[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*\Z"
"""``package.module:factory``."""
NAME_LETTERS = 32
"""Longest name of a vehicle or a client [letters]."""
WHOLE_NAME = rf"\A{_FIRST}{_NEXT}{{0,{NAME_LETTERS - 1}}}\Z"
"""The pattern of a name alone. ``$`` would let a line end pass."""


def describe_pattern(pattern: str) -> str:
    """Return ``pattern``, that of a whole text, as people write it."""
    return pattern.removeprefix(r"\A").removesuffix(r"\Z")


NAME_FORM = f"a name matching {describe_pattern(WHOLE_NAME)}"


def is_name(text: str) -> bool:
    """Whether ``text`` is a name of a vehicle or a client."""
    return re.search(WHOLE_NAME, text) is not None


def describe_type(info: mi.Type) -> str:
    """Describe the accepted values: ``a number > 0``, ``one of ['vicon', 'natnet']``."""
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
            tagged = [
                kind
                for kind in map(strip_metadata, kinds)
                if isinstance(kind, mi.StructType) and kind.tag_field
            ]
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
    signs = (
        (">", info.gt),
        (">=", info.ge),
        ("<", info.lt),
        ("<=", info.le),
        ("a multiple of", info.multiple_of),
    )
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
    """Return the type without its metadata."""
    return strip_metadata(info.type) if isinstance(info, mi.Metadata) else info


def describe_unknown_key(key: str, value: Any, known: list[str]) -> str:
    """Describe a key that is none of ``known``, and suggest the one that may have been meant."""
    what = "unknown section" if isinstance(value, dict) else "unknown key"
    return f"{what}{suggest(key, known)} (known: {', '.join(known) or 'none'})"


def suggest(written: Any, known: Iterable[Any]) -> str:
    """Suggest the word of ``known`` that ``written`` probably means, as the end of an error.

    Empty where none is near, or two are equally near: left-handed axes mean no others.
    """
    if not isinstance(written, str):
        return ""
    words = [word for word in known if isinstance(word, str)]
    near = get_close_matches(written, words, n=2)
    likeness = [SequenceMatcher(None, word, written).ratio() for word in near]
    is_one = len(near) == 1 or (len(near) == 2 and likeness[0] > likeness[1])
    return f"; did you mean {near[0]}?" if is_one else ""


def describe_value(value: Any) -> str:
    """Describe the value that was written instead, in at most one line."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a number of more than 40 digits"
    text = repr(value) if isinstance(value, str | int | float | list) else str(value)
    return text if len(text) <= 80 else text[:77] + "..."


class OpenFactory:
    """Base of a struct of a tagged union with the keys ``factory`` and ``options``: its ``kind``
    may name a factory.

    Its tags can't be listed.
    """

    __slots__ = ()
    EXAMPLE: ClassVar[str] = "package.module:factory"
    """Example of a tag, for error messages."""

    @classmethod
    def expand(cls, table: dict[str, Any]) -> dict[str, Any]:
        """Return ``table`` in this struct's own form if its ``kind`` names a factory, else as is.

        Keys that the struct does not have are the factory's options.
        """
        named = table.get("kind")
        if not isinstance(named, str) or not re.match(FACTORY, named):
            return table
        own = set(cls.__struct_encode_fields__) - {"factory"}  # type: ignore[attr-defined]  # it is a base beside a struct
        kept = {key: value for key, value in table.items() if key in own}
        given = {key: value for key, value in table.items() if key not in own and key != "kind"}
        if given:
            inner = kept.get("options", {})
            kept["options"] = {**inner, **given} if isinstance(inner, dict) else inner
        return {"kind": "custom", "factory": named, **kept}


@cache
def inspect_struct(root: type[msgspec.Struct]) -> mi.Type:
    """Return msgspec's description of ``root`` and of all structs in it."""
    return mi.type_info(root)


@cache
def field_descriptions(struct: type[msgspec.Struct]) -> dict[str, str]:
    """Return each field's ``Meta(description=…)`` by key; a base's where ``struct`` has none."""
    found: dict[str, str] = {}
    for cls in reversed(struct.__mro__):
        if issubclass(cls, msgspec.Struct) and cls is not msgspec.Struct:
            (info,) = structs(inspect_struct(cls))
            found |= {
                field.encode_name: text
                for field in info.fields
                if (text := _description(field.type))
            }
    return found


def _description(info: mi.Type) -> str:
    if not isinstance(info, mi.Metadata):
        return ""
    return str((info.extra_json_schema or {}).get("description", "")) or _description(info.type)


def kinds(root: type[msgspec.Struct], section: str) -> tuple[str, dict[Any, set[str]]]:
    """Return the key of the kind of a ``section`` of ``root``, and the keys of each kind.

    Empty without kinds.
    """
    info = inspect_struct(root)
    assert isinstance(info, mi.StructType)
    for field in info.fields:
        tagged = [kind for kind in structs(field.type) if kind.tag_field is not None]
        if field.encode_name == section and tagged:
            return tagged[0].tag_field or "", {
                kind.tag: {one.encode_name for one in kind.fields} for kind in tagged
            }
    return "", {}


def options(info: mi.Type) -> list[mi.Type]:
    """Return the types of a value: each of a union, without their metadata."""
    info = strip_metadata(info)
    return (
        [kind for each in info.types for kind in options(each)]
        if isinstance(info, mi.UnionType)
        else [info]
    )


def structs(info: mi.Type) -> list[mi.StructType]:
    """Return the structs of a value of this type."""
    return [kind for kind in options(info) if isinstance(kind, mi.StructType)]


def find_struct(info: mi.Type, table: Mapping[str, Any], default: object) -> mi.StructType | None:
    """Find the struct of ``table``, by its tag or else that of ``default``; None without either."""
    for kind in structs(info):
        if kind.tag_field is None:
            return kind
        named = table.get(kind.tag_field, kind.tag if isinstance(default, kind.cls) else None)
        if type(named) is type(kind.tag) and named == kind.tag:
            return kind
        if (
            isinstance(named, str)
            and issubclass(kind.cls, OpenFactory)
            and re.match(FACTORY, named)
        ):
            return kind
    return None


def tags(info: mi.Type) -> list[Any]:
    """Return the tags of the structs of a union, as the operator may write them."""
    kinds = structs(info)
    return [
        *(kind.tag for kind in kinds),
        *(kind.cls.EXAMPLE for kind in kinds if issubclass(kind.cls, OpenFactory)),
    ]


def item_types(info: mi.Type, length: int) -> list[mi.Type]:
    """Return the types of the elements of an array of this length; any type if it can't be one."""
    for kind in options(info):
        if isinstance(kind, mi.VarTupleType | mi.ListType):
            return [kind.item_type] * length
        if isinstance(kind, mi.TupleType) and len(kind.item_types) == length:
            return list(kind.item_types)
    return [mi.AnyType()] * length


def default_of(field: mi.Field) -> Any:
    """Return the default of a field; None without one."""
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return None if field.default is msgspec.NODEFAULT else field.default


def keys_of(root: type[msgspec.Struct]) -> list[str]:
    """Return every key of a ``root``, of every kind of its sections, as an operator writes it.

    Sorted.
    """
    return sorted({key for key, _ in _keys(mi.type_info(root), ())})


def texts_of(root: type[msgspec.Struct]) -> list[str]:
    """Return the keys whose value may be or hold a free text."""
    return sorted(
        {
            key
            for key, info in _keys(mi.type_info(root), ())
            if info is not None and _holds_text(info)
        }
    )


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
    return not isinstance(
        info, mi.FloatType | mi.IntType | mi.BoolType | mi.LiteralType | mi.EnumType | mi.NoneType
    )


def _keys(info: mi.Type, path: KeyPath) -> Iterator[tuple[str, mi.Type | None]]:
    inner = structs(info)
    if not inner:
        yield dotted_key(path), info
    for struct in inner:
        if struct.tag_field is not None:
            yield dotted_key((*path, struct.tag_field)), None
        for field in struct.fields:
            yield from _keys(field.type, (*path, field.encode_name))


def is_within_bounds(info: mi.FloatType | mi.IntType, value: float) -> bool:
    """Whether what ``info`` asks of a number holds for ``value``."""
    return (
        (info.gt is None or value > info.gt)
        and (info.ge is None or value >= info.ge)
        and (info.lt is None or value < info.lt)
        and (info.le is None or value <= info.le)
        and (info.multiple_of is None or value % info.multiple_of == 0)
    )
