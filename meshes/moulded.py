"""Skins moulded in a doubly curved shape: a flat chart for each triangle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import PatternError
from toros_fem.base.validation import checked_names, real_numbers, whole_numbers
from toros_fem.meshes.pattern import Pattern

# Distance of neighbouring charts over the longest edge: they do not touch.
PITCH = 1.1


def moulded(
    points: npt.ArrayLike,
    triangles: npt.ArrayLike,
    panel: npt.ArrayLike | None = None,
    panel_names: Sequence[str] = ("skin",),
) -> Pattern:
    """Return a skin that is free of membrane stress in the given shape, however curved it is.

    Every triangle has a flat chart of its own, congruent to it in space; its first axis runs along
    its first edge. What needs cloth cut from flat panels is refused (docs/geometry.md): the cone
    filter, prints, lines, courses of a knit, transfer between meshes. For bending the rest shape
    is the choice of `Bending.rest`: "assembled" for a shell without moments in this shape.

    Args:
        points: Positions (n, 3) in m.
        triangles: Corners (t, 3), counter-clockwise seen from outside.
        panel: Number of the panel of each triangle, (t,), to name parts of the skin; None for one.
        panel_names: A name for each panel.

    Raises:
        PatternError: The arrays do not fit together, or the surface is no valid skin.
    """
    places = real_numbers("points", points, "(n, 3), in m", PatternError)
    corners = whole_numbers("triangles", triangles, "(t, 3)", PatternError)
    if places.ndim != 2 or places.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
        raise PatternError(
            f"points and triangles have shapes {places.shape} and {corners.shape}; they must be "
            "(n, 3) and (t, 3)."
        )
    if not np.isfinite(places).all():
        raise PatternError("points must be finite, in m.")
    if len(corners) == 0 or corners.min() < 0 or corners.max() >= len(places):
        raise PatternError(f"triangles must hold corners among the {len(places)} points.")
    a, b, c = np.moveaxis(places[corners], 1, 0)
    length = np.linalg.norm(b - a, axis=1)
    if not (length > 0).all():
        k = int(np.argmin(length > 0))
        raise PatternError(f"triangle {k} has an edge of length {length[k]:g} m. Collapse it.")
    along = (b - a) / length[:, None]
    x = np.einsum("ij,ij->i", c - a, along)
    y = np.linalg.norm(np.cross(along, c - a), axis=1)
    zero = np.zeros_like(x)
    flat = np.stack(
        [np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([x, y], 1)], axis=1
    )
    flat -= flat.min(axis=1, keepdims=True)
    columns = int(np.ceil(np.sqrt(len(corners))))
    number = np.arange(len(corners))
    grid = np.stack([number % columns, number // columns], axis=1)
    flat += (PITCH * float(flat.max()) * grid)[:, None]
    return Pattern(
        flat_points=flat.reshape(-1, 2),
        flat_triangles=np.arange(3 * len(corners)).reshape(-1, 3),
        panel=0 * number if panel is None else whole_numbers("panel", panel, "(t,)", PatternError),
        sewn=corners.ravel(),
        points=places,
        panel_names=checked_names("panel_names", panel_names, PatternError),
        moulded=True,
    )
