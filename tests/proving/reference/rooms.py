"""Rooms: the folders of the project as its imports arrange them, as a table and as a picture."""

import ast
import functools
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[3]
HOUSES = ("sim", "groundstation", "links")
OPENED = "groundstation/core"
"""The room whose inner rooms are drawn, too."""
WIDTH, BOX, HEAD, GAP, MARGIN = 1000, 29, 28, 7, 12
"""Measures of the picture [px]: a box is as high as one line."""
TITLE = "The rooms: each imports only what stands below it"
COLORS = {"sim": "#D55E00", "groundstation": "#0072B2", "links": "#009E73"}


class Room(NamedTuple):
    """A folder: its path in the repository, and the first sentence of its face."""

    path: str
    text: str

    @property
    def name(self) -> str:
        """The last part of its path."""
        return self.path.rpartition("/")[2]


def rooms_below(folder: str) -> list[Room]:
    """The rooms that stand next in a folder, by name."""
    return [_room(face) for face in sorted((ROOT / folder).glob("*/__init__.py"))]


def _room(face: Path) -> Room:
    text = ast.get_docstring(ast.parse(face.read_text("utf-8"))) or ""
    return Room(face.parent.relative_to(ROOT).as_posix(), " ".join(text.partition("\n\n")[0].split()))


@functools.cache
def folder_imports(folder: str) -> frozenset[str]:
    """Paths of what the modules of a folder ask for, but for what only types need."""
    return frozenset(
        module.replace(".", "/")
        for path in (ROOT / folder).rglob("*.py")
        for module, _ in tree_imports(ast.parse(path.read_text("utf-8")))
    )


def tree_imports(tree: ast.AST, *, typing: bool = False) -> Iterator[tuple[str, str]]:
    """Modules and the names that are asked of them ("" for the module itself), with or without what only types need."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif typing or not is_for_types(node):
            yield from tree_imports(node, typing=typing)


def is_for_types(node: ast.AST) -> bool:
    """Whether that is what only types need."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def floors(rooms: list[Room]) -> list[list[Room]]:
    """Rooms one above the other, so that each asks only for what stands on a lower floor; the highest first."""
    asks = {
        room: [
            other
            for other in rooms
            if other != room and any(_within(path, other) for path in folder_imports(room.path))
        ]
        for room in rooms
    }

    @functools.cache
    def height(room: Room) -> int:
        return 1 + max((height(other) for other in asks[room]), default=-1)

    return [[room for room in rooms if height(room) == level] for level in sorted({*map(height, rooms)}, reverse=True)]


def _within(path: str, room: Room) -> bool:
    return f"{path}/".startswith(f"{room.path}/")


def rooms_page() -> str:
    """The page of rooms: every folder of the three packages, and what is in it."""
    head = f"# Rooms\n\n![{TITLE}](rooms.svg)\n\n| room | what is in it |\n|---|---|"
    rooms = [_room(face) for house in HOUSES for face in sorted((ROOT / house).rglob("__init__.py"))]
    return "\n".join([head, *(f"| `{room.path}/` | {room.text} |" for room in rooms)])


def rooms_picture() -> str:
    """The rooms as an SVG picture: a room stands above all that it imports."""
    drawn, y = "", float(MARGIN)
    for house in HOUSES:
        color = COLORS[house]
        below, inner = _stack(floors(rooms_below(house)), MARGIN, y + HEAD, WIDTH - 2 * MARGIN, color)
        drawn += _box(4, y, WIDTH - 8, below - y, color, f' fill-opacity=".08" fill="{color}"')
        drawn += _words(MARGIN, y + 19, f'<tspan font-size="16" font-weight="bold" fill="{color}">{house}</tspan>')
        drawn += inner
        y = below + GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y:.0f}" role="img" aria-label="{TITLE}" '
        f'font-family="Helvetica, Arial, sans-serif" font-size="13">\n<title>{TITLE}</title>\n'
        f'<rect width="{WIDTH}" height="{y:.0f}" fill="#ffffff"/>\n{drawn}</svg>'
    )


def _stack(levels: list[list[Room]], x: float, y: float, width: float, color: str) -> tuple[float, str]:
    """Floors drawn from ``y`` on; where they end, and the drawing."""
    drawn = ""
    for level in levels:
        wide = (width - GAP * (len(level) - 1)) / len(level)
        end = y + BOX
        for number, room in enumerate(level):
            left, inner, below = x + number * (wide + GAP), "", y + BOX
            text = _shorten(room.text, wide - 8 * len(room.name))
            if room.path == OPENED:
                below, inner = _stack(floors(rooms_below(room.path)), left + GAP, y + HEAD, wide - 2 * GAP, color)
            name = f'<tspan font-weight="bold" fill="#222">{room.name}</tspan>'
            drawn += _box(left, y, wide, below - y, color, ' fill="#fff"')
            drawn += _words(left + 8, y + 19, f'{name}<tspan dx="9" font-size="11" fill="#555">{escape(text)}</tspan>')
            drawn += inner
            end = max(end, below)
        y = end + GAP
    return y, drawn


def _box(x: float, y: float, width: float, height: float, color: str, fill: str) -> str:
    return f'<rect x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}" rx="5"{fill} stroke="{color}"/>\n'


def _words(x: float, y: float, spans: str) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}">{spans}</text>\n'


def _shorten(text: str, wide: float) -> str:
    """As many words of a room's sentence as there is room for."""
    most, text = int((wide - 30) / 6.0), text.removesuffix(".")
    return text if len(text) <= most else f"{text[:most].rpartition(' ')[0].rstrip(',:')} …"
