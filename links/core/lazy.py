"""Lazy faces: a package hands on the names of its modules, and loads a module when one of its names is first asked for.

A command that asks for one codec does not wait for all others to load. What a face hands on stands in it once: as the
imports that it has for types. Sans-IO.
"""

import sys
from functools import cache
from importlib import import_module


def load_name(package: str, name: str) -> object:
    """A name of a package, from the module that its face imports it from for types; the package keeps it.

    Raises:
        AttributeError: the package does not hand on such a name.
    """
    module = imports_for_types(package).get(name)
    if module is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    value = getattr(import_module(module), name)
    setattr(sys.modules[package], name, value)
    return value


@cache
def imports_for_types(package: str) -> dict[str, str]:
    """Name to module, as the face of ``package`` imports them ``if TYPE_CHECKING``; a test holds that all are read."""
    face = sys.modules[package].__spec__
    assert face is not None and face.loader is not None, "it was imported"
    source = face.loader.get_data(face.origin).decode()  # type: ignore[attr-defined]  # of every loader of files
    found = {}
    for statement in source.partition("if TYPE_CHECKING:")[2].partition("\n\n")[0].split("from ")[1:]:
        module, _, names = statement.partition(" import ")
        found.update({name.split()[0]: module for name in names.strip("() \n").split(",") if name.strip()})
    return found
