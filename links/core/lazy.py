"""Lazy faces: a package hands on the names of its modules, and loads a module when one of its names is first asked for.

A command that asks for one codec does not wait for all others to load. Sans-IO.
"""

import sys
from importlib import import_module

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from collections.abc import Mapping


def load_name(package: str, modules: "Mapping[str, tuple[str, ...]]", name: str) -> object:
    """A name of a package, from the module that defines it; the package keeps it.

    Args:
        package: the package's ``__name__``.
        modules: the package's own table: a module in it, and its names that are handed on.
        name: what is asked for.

    Raises:
        AttributeError: the package does not hand on such a name.
    """
    for module, names in modules.items():
        if name in names:
            value = getattr(import_module(f"{package}.{module}"), name)
            setattr(sys.modules[package], name, value)
            return value
    raise AttributeError(f"module {package!r} has no attribute {name!r}")
