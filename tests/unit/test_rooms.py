"""A folder is a room, and others ask for what is in it through its ``__init__`` alone."""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HOUSES = ("links", "groundstation", "sim", "tests/proving")
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for house in HOUSES
    for path in sorted((ROOT / house).rglob("*.py"))
}
FACES = {name for name, path in FILES.items() if path.name == "__init__.py"}
ROOTS = ("groundstation", "links", "sim")
PAST_A_FACE = {
    # The pages of the reference show the options of both programs, which their entry points hold.
    "tests.proving.reference": {"groundstation.__main__", "sim.__main__"},
    # The face would load it with every flight. One worker, too, must be a process here: flights are
    # copied.
    "tests.proving.faults.deal": {"sim.runs.pool"},
}


def room(module: str) -> str:
    return module if module in FACES else module.rpartition(".")[0]


@cache
def parse(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text("utf-8"))


@cache
def table(face: str) -> dict[str, str]:
    """What a face hands on: name to the module that it imports it from."""
    return {name: module for module, name in imports(face, typing=True)}


@cache
def imports(module: str, *, typing: bool) -> tuple[tuple[str, str], ...]:
    return tuple(tree_imports(parse(module), typing=typing))


def tree_imports(tree: ast.AST, *, typing: bool = False) -> Iterator[tuple[str, str]]:
    """Modules and names asked of them ("" for the module), with or without what only types need."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif not isinstance(node, ast.expr) and (typing or not is_for_types(node)):
            yield from tree_imports(node, typing=typing)


def is_for_types(node: ast.AST) -> bool:
    """Whether that is what only types need."""
    return (
        isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
    )


def module_of(module: str, name: str) -> str:
    """The module that is loaded for a name that is asked of a module."""
    if f"{module}.{name}" in FILES:
        return f"{module}.{name}"
    return table(module).get(name, module) if module in FACES else module


def test_a_face_holds_no_code() -> None:
    for face in FACES - set(ROOTS):
        for node in parse(face).body:
            text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            assert text or isinstance(node, ast.ImportFrom), face


def test_a_root_loads_what_it_imports_for_types_and_only_when_it_is_asked() -> None:
    for root in ROOTS:
        (block,) = (
            ast.Module(node.body, [])
            for node in parse(root).body
            if isinstance(node, ast.If) and is_for_types(node)
        )
        (modules,) = (
            ast.literal_eval(node.value)
            for node in parse(root).body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_MODULES"
        )
        assert modules == {name: module for module, name in tree_imports(block)}
        assert all(getattr(import_module(root), name) is not None for name in modules)


def test_a_room_is_asked_through_its_face() -> None:
    past = set()
    for module in FILES.keys() - FACES:
        for asked, name in imports(module, typing=True):
            target = module_of(asked, name) if f"{asked}.{name}" in FILES else asked
            outside = not f"{room(module)}.".startswith(f"{room(target)}.")
            handed = asked in FACES and name in table(asked)
            if target in FILES.keys() - FACES and outside and not handed:
                past.add((module, target))
    assert past == {
        (module, target) for module, targets in PAST_A_FACE.items() for target in targets
    }


def test_a_name_is_handed_on_only_where_somebody_asks_for_it() -> None:
    asked = {pair for module in FILES.keys() - FACES for pair in imports(module, typing=True)}
    idle = {
        (face, name)
        for face in FACES - set(ROOTS)
        for name in table(face)
        if (face, name) not in asked
    }
    outside = "\n".join(
        path.read_text("utf-8")
        for top in ("tests", "examples", "docs")
        for path in (ROOT / top).rglob("*")
        if path.suffix in (".py", ".md") and "proving" not in path.relative_to(ROOT).parts
    )
    assert {(face, name) for face, name in idle if name not in outside} == set()


def defined(tree: ast.AST) -> Iterator[str]:
    """Names of classes, functions, constants and attributes that a module defines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr


def test_a_docstring_refers_to_what_is_there() -> None:
    known = {name for module in FILES for name in defined(parse(module))}
    known |= {module.rpartition(".")[2] for module in FILES}
    past = set()
    for module, path in FILES.items():
        for target in re.findall(
            r":(?:class|meth|func|data|attr):`([^`]+)`", path.read_text("utf-8")
        ):
            first, *more = target.split(".")
            if (not more and first not in known) or (first in ROOTS and not known.issuperset(more)):
                past.add((module, target))
    assert past == set()


def test_what_does_no_io_does_none_through_the_faces_that_it_asks() -> None:
    """pyproject.toml's contract sees a module's imports, not what a face loads for a name."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (contract,) = [contract for contract in contracts if contract["type"] == "forbidden"]
    pure = tuple(contract["source_modules"])
    todo = [module for module in FILES if any(f"{module}.".startswith(f"{name}.") for name in pure)]
    assert len(todo) > len(pure)
    way = {module: module for module in todo}
    while todo:
        module = todo.pop()
        for asked, name in imports(module, typing=False):
            assert asked.partition(".")[0] not in contract["forbidden_modules"], (
                f"{way[module]} -> {asked}"
            )
            target = module_of(asked, name)
            if target in FILES and target not in way:
                way[target] = f"{way[module]} -> {target}"
                todo.append(target)
