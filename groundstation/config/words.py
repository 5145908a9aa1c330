"""What a key of a configuration accepts, and what was written instead, in an operator's words.

The types are those of ``msgspec.inspect``.
"""

from typing import Any

from msgspec import inspect as mi

from groundstation.config.names import in_words


def expected(info: mi.Type) -> str:
    """What a key of this type accepts, in words: ``a number > 0``, ``one of ['vicon', 'natnet']``."""
    match info:
        case mi.Metadata():
            return expected(info.type)
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
                + (f" matching {in_words(info.pattern)}" if info.pattern else "")
            )
        case mi.LiteralType():
            return f"one of {list(info.values)}"
        case mi.EnumType():
            return f"one of {[one.value for one in info.cls]}"
        case mi.TupleType():
            each = " or ".join(dict.fromkeys(map(expected, info.item_types)))
            return f"an array of {len(info.item_types)} values, each {each}"
        case mi.VarTupleType() | mi.ListType():
            return f"an array{_lengths(info, 'value')}, each {expected(info.item_type)}"
        case mi.UnionType():
            kinds = [kind for kind in info.types if not isinstance(kind, mi.NoneType)]
            tagged = [kind for kind in map(bare, kinds) if isinstance(kind, mi.StructType) and kind.tag_field]
            if len(tagged) == len(kinds) > 1:
                return f"a table with {tagged[0].tag_field}, one of {[kind.tag for kind in tagged]}"
            return " or ".join(dict.fromkeys(map(expected, kinds)))
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


def bare(info: mi.Type) -> mi.Type:
    """The type without its remarks."""
    return bare(info.type) if isinstance(info, mi.Metadata) else info


def unknown(key: str, value: Any, known: list[str]) -> str:
    """What is wrong with a key that is none of ``known``, and which of them may have been meant."""
    from difflib import get_close_matches

    near = get_close_matches(key, known, n=1)
    what = "unknown section" if isinstance(value, dict) else "unknown key"
    return f"{what}{f'; did you mean {near[0]}?' if near else ''} (known: {', '.join(known) or 'none'})"


def shown(value: Any) -> str:
    """What was written instead, no longer than a line."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a number of more than 40 digits"
    text = repr(value) if isinstance(value, str | int | float | list) else str(value)
    return text if len(text) <= 80 else text[:77] + "..."
