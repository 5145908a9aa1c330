"""Code of the user's own that a configuration names: ``kind = "package.module:factory"``.

An object that Python already has is lent to a flight under such a name (:func:`lend`). A fault in
it is reported in one sentence, with the user's own frames behind it (:class:`UserCodeFault`).
"""

import copy
import importlib
import inspect
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from groundstation.config.config_notices import config_notice
from groundstation.config.errors import ArgumentError, ConfigError
from groundstation.config.schema import FACTORY
from links.text import Sentence

Option = bool | int | float | str | list[bool | int | float | str]
"""Types of an option's value; NaN and infinity are refused as everywhere."""
_LENT: "ContextVar[Mapping[str, object]]" = ContextVar("lent")
STEP_LIMIT_S = 0.5
"""A step that has not returned after this time is interrupted [s]. By then no command may rest on a
pose (flight.coast_s and guards.level_s: 0.5 s), and the link plays its bring-down."""
MAKING_LIMIT_S = 20.0
"""An import or a factory that has not returned after this time is interrupted [s]. Nothing flies
yet; large numerical packages take several seconds to import on a small computer."""


class SelfInterrupt(Exception):
    """The user's code raised KeyboardInterrupt without Ctrl-C: it ends the flight as any of its
    faults does.
    """


class StepWatch:
    """Watch on the duration of steps of the user's code.

    This one watches nothing: in virtual time they take none.
    """

    slow: Sentence | None = None
    """The first step that was too slow, for the operator; None without one."""

    def find_recent(self) -> Sentence | None:
        """Return the newest step that was too slow, if it ended within the last second.

        Else None.
        """
        return None

    def begin(self, what: str, limit_s: float = STEP_LIMIT_S) -> None:
        """The step of ``what`` begins, and has ``limit_s`` [s] to return."""

    def end(self) -> None:
        """The step has returned, or failed."""

    def run(
        self, what: str, limit_s: float, code: Callable[..., Any], /, *arguments: Any, **named: Any
    ) -> Any:
        """Call ``code`` of the user's as a step of ``what``, which has ``limit_s`` [s] to return.

        Raises:
            SelfInterrupt: it raised KeyboardInterrupt itself.
        """
        self.begin(what, limit_s)
        try:
            return code(*arguments, **named)
        except KeyboardInterrupt as fault:
            if self.is_interrupted_by_keys():
                raise
            raise SelfInterrupt("KeyboardInterrupt, by its own code and no key").with_traceback(
                fault.__traceback__
            ) from None
        finally:
            self.end()

    def is_interrupted_by_keys(self) -> bool:
        """Whether Ctrl-C raises KeyboardInterrupt in a step.

        Else only the user's code itself can have.
        """
        return True


STEP_WATCH: "ContextVar[StepWatch]" = ContextVar("step_watch", default=StepWatch())  # noqa: B039  # it keeps nothing
"""The watch on the steps of the user's code in this context."""


P = ParamSpec("P")
R = TypeVar("R")


class UserCodeFault(Exception):
    """Code of the user's own failed, or returned a value that must not leave.

    Its cause has the user's frames.
    """

    def __init__(self, what: str | Sentence, error: BaseException | None = None) -> None:
        """``what`` failed with ``error``, caught where the user's code was called.

        None: ``what`` is the whole text.
        """
        super().__init__(str(what) if error is None else f"{what} failed: {describe_error(error)}")
        self._frames: str | None = None
        if error is not None:
            _strip_caller(error)
            self.__cause__ = error

    def __reduce__(self) -> tuple[type["UserCodeFault"], tuple[str], dict[str, str]]:
        """Pickle the sentence and the user's frames: a worker process hands its faults to the one
        that started it.
        """
        return type(self), (str(self),), {"_frames": self.frames()}

    def frames(self) -> str:
        """Return the traceback of the user's code as lines, also of a worker process.

        Empty where nothing raised.
        """
        if self._frames is None:
            self._frames = (
                "".join(traceback.format_exception(self.__cause__)) if self.__cause__ else ""
            )
        return self._frames


def _strip_caller(error: BaseException) -> None:
    """Leave ``error`` the frames of the user's code alone, without those that called it."""
    frames = error.__traceback__ and error.__traceback__.tb_next
    while frames and frames.tb_frame.f_globals.get("__name__", "").startswith(
        ("groundstation.", "importlib")
    ):
        frames = frames.tb_next
    error.__traceback__ = frames


def without_frames(work: Callable[P, R]) -> Callable[P, R]:
    """Wrap ``work``: its refusals show the caller's own frames and names alone."""

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
            raise fault.with_traceback(None)  # noqa: B904  # its context is suppressed above

    return plain


def coroutine_hint(answer: object) -> str:
    """Return advice where ``answer`` is a coroutine, which is then closed; else nothing."""
    if not inspect.iscoroutine(answer):
        return ""
    answer.close()  # Python would complain that nobody has awaited it
    return " (write `def`, not `async def`)"


def several(names: Any) -> list[Any]:
    """Return ``names`` as a list, also if it is a single one given without brackets."""
    return list(names) if isinstance(names, Iterable) and not isinstance(names, str) else [names]


def describe_error(error: BaseException) -> str:
    """Return kind and text of ``error``."""
    return f"{type(error).__name__}: {error}"


@contextmanager
def lend(objects: Mapping[str, object]) -> Iterator[None]:
    """Bind each name (``module:name``) to that object in this context and the tasks it starts."""
    token = _LENT.set({**_LENT.get({}), **objects})
    try:
        yield
    finally:
        _LENT.reset(token)


def name_object(thing: object) -> str:
    """Return a name for ``thing``, of its module and itself, that :func:`lend` accepts."""
    named = thing if inspect.isclass(thing) or inspect.isroutine(thing) else type(thing)
    module, name = (
        getattr(named, "__module__", None) or "python",
        getattr(named, "__name__", "given"),
    )
    text = f"{module}:{re.sub(r'[^A-Za-z0-9_]', '_', name)}"
    return text if re.match(FACTORY, text) else "python:given"


def find_object(key: str, factory: str) -> Any:
    """Find the object that ``factory`` names: lent under that name, or else in its module.

    Raises:
        ConfigError: it can't be imported, or is not there; by ``key``.
    """
    lent = _LENT.get({})
    if factory in lent:
        return lent[factory]
    module_name, _, name = factory.partition(":")
    module = _run_making(
        key,
        config_notice("code.no_import", module=module_name),
        module_name,
        importlib.import_module,
        module_name,
    )
    if not hasattr(module, name):
        raise ConfigError(key, config_notice("code.no_attribute", module=module_name, name=name))
    return getattr(module, name)


def _run_making(
    key: str,
    failed: Sentence,
    what: str,
    code: Callable[..., Any],
    /,
    *arguments: Any,
    **named: Any,
) -> Any:
    """Call ``code`` of the user's, which imports or makes ``what`` before the flight.

    Raises:
        ConfigError: it ``failed``, whatever it raises, sys.exit too; by ``key``.
    """
    try:
        return STEP_WATCH.get().run(what, MAKING_LIMIT_S, code, *arguments, **named)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        _strip_caller(error)
        id = "code.no_module" if isinstance(error, ModuleNotFoundError) else "value.refused"
        raise ConfigError(
            key, config_notice(id, value=failed, why=describe_error(error))
        ) from error


def _parameters(function: Callable[..., Any]) -> list[inspect.Parameter] | None:
    try:
        return list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return None


def needed_names(function: Callable[..., Any], options: Mapping[str, Any]) -> list[str] | None:
    """Return the names of the arguments that ``function`` needs beside ``options``.

    None if they are unknown.
    """
    parameters = _parameters(function)
    if parameters is None or any(one.kind is one.VAR_POSITIONAL for one in parameters):
        return None
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [
        one.name
        for one in parameters
        if one.kind in places and one.default is one.empty and one.name not in options
    ]


def call_factory(
    key: str, factory: str, found: Any, given: tuple[Any, ...], options: Mapping[str, Any]
) -> Any:
    """Call the user's factory; a ready object is copied, so that each flight begins anew.

    A factory gets as much of ``given`` as it needs, then the options as one dict if it needs more,
    or by name.

    Raises:
        ConfigError: it can't be called so, or fails; by ``key``.
    """
    if not callable(found):
        return copy.deepcopy(found)
    needed = needed_names(found, options)
    arguments: tuple[Any, ...] = (*given, dict(options))
    named: dict[str, Any] = {}
    as_dict = any(
        one.name == "options" and one.kind is not one.VAR_KEYWORD
        for one in _parameters(found) or ()
    )
    if needed is not None and len(needed) <= len(given) and not as_dict:
        arguments, named = given[: len(needed)], dict(options)
    return _run_making(
        key, config_notice("code.no_result", factory=factory), factory, found, *arguments, **named
    )
