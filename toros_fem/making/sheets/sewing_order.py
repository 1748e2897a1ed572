"""An order in which the seams of a skin can be sewn, with an opening for the bladder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from toros_fem.making.panels.seam_lines import SewnSeam
from toros_fem.meshes.pattern import Pattern

# Kinds of seams, in the order in which they are sewn.
DART, FLAT, EDGE, RING, CLOSING = "dart", "flat", "edge", "ring", "closing"
KINDS = DART, FLAT, EDGE, RING, CLOSING
# Length in m of the opening for the bladder; a seam up to half as long again stays open whole.
OPENING = 60e-3


@dataclass(frozen=True)
class SewingStep:
    """One seam in the order of work.

    Attributes:
        seam: Number of the seam.
        kind: "dart" ends inside of a panel; "flat" joins two pieces that were apart; "edge" joins
            edges of one piece; "ring" closes on itself, as round a cap; "closing" is the last seam
            of a body, where the bladder goes in.
        opening: Length in m that stays open for the bladder; 0 but for the closing seam.
    """

    seam: int
    kind: str
    opening: float = 0.0


def sewing_order(
    pattern: Pattern, seams: Sequence[SewnSeam], closing: Sequence[int] = ()
) -> list[SewingStep]:
    """Return the seams of a pattern in an order of work, body by body.

    Darts come first, while a panel lies flat. Seams that join pieces follow, the longest first,
    then those that join edges of one piece. Rings come after them, since a ring's edge is whole
    only once all seams that end at it are sewn. The last seam of a body leaves an opening for the
    bladder.

    Args:
        pattern: The pattern.
        seams: Its seams, by `sewn_seams`.
        closing: Numbers of seams that should come last, those where the bladder's tube leaves for
            instance. Of a body without one the longest ring is the last, or the longest seam.
    """
    bodies = _Groups(len(pattern.panel_names))
    for seam in seams:
        bodies.join(*seam.panels)
    steps = []
    for body in bodies.groups():
        own = [seam for seam in seams if seam.panels[0] in body]
        if own:
            steps += _body_order(pattern, own, closing)
    return steps


def _body_order(
    pattern: Pattern, seams: Sequence[SewnSeam], closing: Sequence[int]
) -> list[SewingStep]:
    vertices = {seam.number: _end_vertices(pattern, seam) for seam in seams}
    rings = [seam for seam in seams if vertices[seam.number][0] == vertices[seam.number][1]]
    wanted = [seam for seam in seams if seam.number in closing] or rings or list(seams)
    last = max(wanted, key=lambda seam: (round(seam.length, 9), -seam.number))
    pieces = _Groups(len(pattern.panel_names))
    steps = [SewingStep(seam.number, DART) for seam in seams if seam is not last and _dart(seam)]
    rest = [seam for seam in seams if seam is not last and not _dart(seam)]
    edges = []
    for seam in sorted(rest, key=lambda seam: (-round(seam.length, 9), seam.number)):
        if seam in rings:
            continue
        if pieces.join(*seam.panels):
            steps.append(SewingStep(seam.number, FLAT))
        else:
            edges.append(SewingStep(seam.number, EDGE))
    steps += sorted(edges, key=lambda step: step.seam)
    steps += [SewingStep(seam.number, RING) for seam in rest if seam in rings]
    opening = last.length if last.length < 1.5 * OPENING else OPENING
    return [*steps, SewingStep(last.number, CLOSING, opening)]


def _end_vertices(pattern: Pattern, seam: SewnSeam) -> tuple[int, int]:
    """Return the assembled vertices at both ends of a seam."""
    cells = pattern.panel == seam.panels[0]
    points = pattern.flat_triangles[cells].ravel()
    places = {tuple(pattern.flat_points[point]): int(pattern.sewn[point]) for point in points}
    first, last = (places[tuple(seam.lines[0, end])] for end in (0, -1))
    return first, last


def _dart(seam: SewnSeam) -> bool:
    """Return whether a seam joins a panel to itself and its edges meet at one of its ends."""
    meet = [bool((seam.lines[0, end] == seam.lines[1, end]).all()) for end in (0, -1)]
    return seam.panels[0] == seam.panels[1] and any(meet)


class _Groups:
    """Panels that hang together."""

    def __init__(self, count: int) -> None:
        self._of = list(range(count))

    def join(self, one: int, other: int) -> bool:
        """Join two groups; return whether they were apart."""
        a, b = self._of[one], self._of[other]
        self._of = [a if group == b else group for group in self._of]
        return a != b

    def groups(self) -> list[set[int]]:
        return [
            {k for k, group in enumerate(self._of) if group == name}
            for name in dict.fromkeys(self._of)
        ]
