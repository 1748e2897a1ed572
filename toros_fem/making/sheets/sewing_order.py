"""An order in which the seams of a skin can be sewn, with an opening for the bladder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.cluster.hierarchy import DisjointSet

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
    only once all seams that end at it are sewn. The last seam of a body, which leaves an opening
    for the bladder, is one of `closing`, else the longest ring, or else the longest seam.
    """
    bodies = DisjointSet(range(len(pattern.panel_names)))
    for seam in seams:
        bodies.merge(*seam.panels)
    steps = []
    for body in bodies.subsets():
        own = [seam for seam in seams if seam.panels[0] in body]
        if own:
            steps += _body_order(own, closing)
    return steps


def _body_order(seams: Sequence[SewnSeam], closing: Sequence[int]) -> list[SewingStep]:
    rings = [seam for seam in seams if seam.ring]
    wanted = [seam for seam in seams if seam.number in closing] or rings or list(seams)
    last = max(wanted, key=lambda seam: (round(seam.length, 9), -seam.number))
    rest = [seam for seam in seams if seam is not last]
    kinds: dict[str, list[int]] = {kind: [] for kind in KINDS}
    pieces = DisjointSet(panel for seam in seams for panel in seam.panels)
    # The longest first: it joins pieces, and shorter ones are edges of the piece that it makes.
    for seam in sorted(rest, key=lambda seam: (-round(seam.length, 9), seam.number)):
        if seam.dart or seam.ring:
            kind = DART if seam.dart else RING
        else:
            kind = FLAT if pieces.merge(*seam.panels) else EDGE
        kinds[kind].append(seam.number)
    opening = last.length if last.length < 1.5 * OPENING else OPENING
    steps = [
        SewingStep(number, kind)
        for kind, found in kinds.items()
        for number in (found if kind == FLAT else sorted(found))
    ]
    return [*steps, SewingStep(last.number, CLOSING, opening)]
