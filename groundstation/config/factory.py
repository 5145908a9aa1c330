"""Factory: code of the user's own that a configuration names, ``kind = "package.module:factory"``, and what it makes.

An object that Python already has is lent to a flight under such a name (:func:`lend`), without a module to import.
What goes wrong in it is told in one sentence, with the user's own frames behind it (:class:`UserCodeFault`).
"""

import copy
import importlib
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from groundstation.config.schema import FACTORY, ConfigError

Option = bool | int | float | str | list[bool | int | float | str]
"""What an option may be; NaN and infinity are refused as everywhere."""
_LENT: "ContextVar[Mapping[str, object]]" = ContextVar("lent")


class UserCodeFault(Exception):
    """Code of the user's own failed, or answered with what must not leave; its cause has the user's frames."""

    def __init__(self, what: str, error: Exception | None = None) -> None:
        """``what`` failed with ``error``, which was caught by whoever called the user's code; or did what is told."""
        super().__init__(what if error is None else f"{what} failed: {describe_error(error)}")
        if error is not None:
            trace = error.__traceback__
            self.__cause__ = error.with_traceback(trace and trace.tb_next)  # without the caller's own frame


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
    except Exception as error:  # whatever the user's module raises, the operator must hear of it
        raise ConfigError(
            key, f"can't import {module_name}: {describe_error(error)} (is its folder on PYTHONPATH, or it installed?)"
        ) from error
    if not hasattr(module, name):
        raise ConfigError(key, f"{module_name} has no attribute {name!r}")
    return getattr(module, name)


def needed_names(function: Callable[..., Any], options: Mapping[str, Any]) -> list[str] | None:
    """The names of the arguments that ``function`` needs beside ``options``; None where it does not tell."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(one.kind is one.VAR_POSITIONAL for one in parameters):
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
    if needed is not None and len(needed) <= len(told) and "options" not in inspect.signature(found).parameters:
        arguments, named = told[: len(needed)], dict(options)
    try:
        return found(*arguments, **named)
    except Exception as error:  # as above
        raise ConfigError(key, f"{factory} failed: {describe_error(error)}") from error
