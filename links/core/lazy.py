"""Lazy faces: a package hands on the names of its modules, and loads a module when one of its names is first asked for.

A command that asks for one codec does not wait for all others to load. What a face hands on stands in it once: as the
imports that it has for types. Sans-IO.
"""

import sys
from functools import cache
from importlib import import_module

ONLY_AST = 0x400
"""ast.PyCF_ONLY_AST: the module ast would have to be imported, also for --help."""


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
    """Name to module, as the face of ``package`` imports them ``if TYPE_CHECKING``."""
    face = sys.modules[package].__spec__
    assert face is not None and face.loader is not None, "it was imported"
    source = face.loader.get_source(package)  # type: ignore[attr-defined]  # of every loader of files
    tree = compile(source, package, "exec", ONLY_AST)
    blocks = (node.body for node in tree.body if hasattr(node, "test"))
    return {name.name: one.module for block in blocks for one in block for name in one.names}
