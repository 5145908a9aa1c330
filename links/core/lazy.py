"""Lazy faces: a package hands on the names of its modules, and loads a module when one of its names is first asked for.

A command that asks for one codec does not wait for all others to load. Sans-IO.
"""

import sys
from collections.abc import Mapping
from importlib import import_module


def load(package: str, modules: Mapping[str, str], name: str) -> object:
    """A name of a package, from the module that defines it; the package keeps it.

    Args:
        package: the package's ``__name__``.
        modules: the package's own table: name to module in it.
        name: what is asked for.

    Raises:
        AttributeError: the package does not hand on such a name.
    """
    if name not in modules:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    value = getattr(import_module(f"{package}.{modules[name]}"), name)
    setattr(sys.modules[package], name, value)
    return value
