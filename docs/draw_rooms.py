"""Draw the rooms of the package from its imports: docs/images/rooms.svg.

    python3 docs/draw_rooms.py
    python3 docs/draw_rooms.py --check    # exit code 1 if the drawing is not that of the code

A room is a folder of `toros_fem`, or `forms` or `meshes`. It stands below all rooms that import it,
as high as they allow. Its cells are its folders.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("toros_fem", "forms", "meshes")
DRAWING = ROOT / "docs" / "images" / "rooms.svg"
# Sizes in pixels: the sheet, a floor, the way between floors, and the margin.
WIDTH, FLOOR, GAP, MARGIN = 1000, 64, 26, 26
FACE, EDGE, CELL, INK = "#fbfaf7", "#444444", "#e8eef2", "#222222"


def sources() -> list[Path]:
    """Return all files of the package."""
    return [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def module_of(path: Path) -> str:
    """Return the dotted name of a file, as it is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    whole = parts if parts[0] == "toros_fem" else ("toros_fem", *parts)
    return ".".join(part for part in whole if part != "__init__")


def room_of(module: str) -> str:
    """Return the room of a module; "" for the package itself."""
    return (*module.split("."), "")[1]


def imports(path: Path) -> set[str]:
    """Return the modules that a file imports at run time, with what it takes from them."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            assert node.module is not None
            found.add(node.module)
            if node.module.startswith("toros_fem"):
                found.update(f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def arrows() -> dict[str, set[str]]:
    """Return the rooms that each room imports."""
    found: dict[str, set[str]] = {}
    for path in sources():
        room = room_of(module_of(path))
        if room not in ("", "__main__", "public"):
            others = {room_of(name) for name in imports(path) if name.startswith("toros_fem.")}
            found.setdefault(room, set()).update(others - {room, ""})
    return found


def floors(below: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """Return the floor of each room, from 1.

    Raises:
        ValueError: Rooms import each other in a circle.
    """
    found: dict[str, int] = {}
    while len(found) < len(below):
        ready = [room for room in below if room not in found and set(below[room]) <= set(found)]
        if not ready:
            raise ValueError(f"these import each other: {sorted(set(below) - set(found))}")
        for room in ready:
            found[room] = 1 + max((found[other] for other in below[room]), default=0)
    return found


def high_floors(below: Mapping[str, set[str]]) -> dict[str, int]:
    """Return the highest floor of each room that is below all rooms that import it."""
    lowest = floors(below)
    found: dict[str, int] = {}
    for room in sorted(below, key=lowest.__getitem__, reverse=True):
        above = [found[other] for other in below if room in below[other]]
        found[room] = min(above, default=max(lowest.values()) + 1) - 1
    return found


def drawn(below: Mapping[str, set[str]]) -> Iterator[tuple[str, str]]:
    """Yield the arrows that no longer way implies."""
    every: dict[str, set[str]] = {}
    for room in sorted(below, key=floors(below).__getitem__):
        every[room] = set().union(below[room], *(every[other] for other in below[room]))
    for room, others in below.items():
        implied = set().union(*(every[other] for other in others))
        for other in sorted(others - implied):
            yield room, other


def cells(room: str) -> list[str]:
    """Return the folders of a room."""
    folder = ROOT / (room if room in FOLDERS else f"toros_fem/{room}")
    return sorted(path.parent.name for path in folder.glob("*/__init__.py"))


def svg() -> str:
    """Return the drawing."""
    below = arrows()
    level = high_floors(below)
    count = max(level.values())
    reduced = sorted(drawn(below))
    # An arrow past other floors begins and ends at the left.
    past = {
        room for one, other in reduced for room in (one, other) if level[one] > level[other] + 1
    }
    rows = {
        k: sorted((room not in past, room) for room in level if level[room] == k)
        for k in range(1, count + 1)
    }
    parts: list[str] = []
    places: dict[str, tuple[float, float, float]] = {}
    for k, rooms in rows.items():
        top = MARGIN + (count - k) * (FLOOR + GAP)
        width = (WIDTH - 2 * MARGIN - GAP * (len(rooms) - 1)) / len(rooms)
        for place, (_, room) in enumerate(rooms):
            left = MARGIN + place * (width + GAP)
            places[room] = left, top, width
            parts.append(_room(room, left, top, width))
    lines = [
        (_past if level[one] > level[other] + 1 else _arrow)(places[one], places[other])
        for one, other in reduced
    ]
    height = 2 * MARGIN + count * FLOOR + (count - 1) * GAP
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'font-family="DejaVu Sans, Helvetica, sans-serif" fill="{INK}">'
    )
    style = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        f'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="{EDGE}"/></marker></defs>'
    )
    return "\n".join([head, style, *lines, *parts, "</svg>"]) + "\n"


def _room(room: str, left: float, top: float, width: float) -> str:
    """Return the box of a room with its cells."""
    found = cells(room)
    shapes = [
        f'<rect x="{left:.1f}" y="{top}" width="{width:.1f}" height="{FLOOR}" rx="4" '
        f'fill="{FACE}" stroke="{EDGE}"/>',
        f'<text x="{left + 8:.1f}" y="{top + 18}" font-size="14" font-weight="bold">{room}</text>',
    ]
    wide = (width - 10) / max(len(found), 1)
    for place, name in enumerate(found):
        x = left + 8 + place * wide
        shapes += [
            f'<rect x="{x:.1f}" y="{top + 28}" width="{wide - 6:.1f}" height="26" fill="{CELL}"/>',
            f'<text x="{x + wide / 2 - 3:.1f}" y="{top + 45}" font-size="11" '
            f'text-anchor="middle">{name}</text>',
        ]
    return "\n".join(shapes)


def _arrow(one: tuple[float, float, float], other: tuple[float, float, float]) -> str:
    """Return an arrow from the floor of a room to the top of another below it."""
    (left, top, width), (left_of, top_of, width_of) = one, other
    low, high = max(left, left_of), min(left + width, left_of + width_of)
    # Straight down where one stands over the other.
    begin = end = (low + high) / 2
    if low >= high:
        begin, end = left + width / 2, left_of + width_of / 2
    return (
        f'<line x1="{begin:.1f}" y1="{top + FLOOR}" x2="{end:.1f}" y2="{top_of}" '
        f'stroke="{EDGE}" marker-end="url(#tip)"/>'
    )


def _past(one: tuple[float, float, float], other: tuple[float, float, float]) -> str:
    """Return an arrow along the left margin, past the floors between two rooms."""
    (left, top, _), (left_of, top_of, _) = one, other
    return (
        f'<path d="M{left:.1f} {top + FLOOR / 2} H{MARGIN / 3:.1f} V{top_of + FLOOR / 2} '
        f'H{left_of:.1f}" fill="none" stroke="{EDGE}" marker-end="url(#tip)"/>'
    )


def main() -> int:
    """Draw, or compare."""
    if "--check" in sys.argv[1:]:
        return int(DRAWING.read_text(encoding="utf-8") != svg())
    DRAWING.write_text(svg(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
