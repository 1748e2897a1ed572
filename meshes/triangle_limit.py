"""Number of triangles that a mesh will have, and the bound on it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from toros_fem.base.errors import MeshSizeError
from toros_fem.base.validation import require_count

# Such a skin needs about 50 GB: docs/command_line.md.
MOST_TRIANGLES = 2_000_000
# Area of an equilateral triangle over the square of its edge.
EQUILATERAL = np.sqrt(3) / 4

_most: ContextVar[int | None] = ContextVar("toros_most_triangles", default=MOST_TRIANGLES)


def expected_triangles(area: float, edge_length: float) -> float:
    """Return the number of equilateral triangles on an area in m², for an edge length in m."""
    return float(area / (EQUILATERAL * edge_length**2))


def require_affordable(area: float, edge_length: float) -> None:
    """Check that a mesh will not have more triangles than the limit, before it is made.

    Args:
        area: Area in m².
        edge_length: Edge length in m.

    Raises:
        MeshSizeError: It will have more.
    """
    most, count = _most.get(), expected_triangles(area, edge_length)
    if most is None or count <= most:
        return
    longest = np.sqrt(area / (EQUILATERAL * most))
    raise MeshSizeError(
        f"edge_length = {edge_length:.3g} m gives about {count:.2g} triangles on {area:.3g} m², "
        f"more than {most}. Give at least {longest:.2g} m, or, where the memory is there, allow it "
        "by --allow-large or `with toros_fem.meshes.triangle_limit(None):`.",
        area,
    )


def require_fewer(count: int, area: float) -> None:
    """Check that a mesh of a known number of triangles keeps the limit.

    Args:
        count: Number of triangles.
        area: Area of the mesh in m².

    Raises:
        MeshSizeError: It does not.
    """
    most = _most.get()
    if most is not None and count > most:
        raise MeshSizeError(
            f"{count:.3g} triangles are more than {most}. Make fewer copies or longer edges, or "
            "allow it by `with toros_fem.meshes.triangle_limit(None):`.",
            area,
        )


@contextmanager
def triangle_limit(most: int | None) -> Iterator[None]:
    """Make meshes inside a `with` block with another largest number of triangles.

    Args:
        most: The largest number; None for no limit.
    """
    if most is not None:
        require_count(1, most=most)
    token = _most.set(most)
    try:
        yield
    finally:
        _most.reset(token)


@contextmanager
def lowered_limit(most: int) -> Iterator[None]:
    """Make meshes inside a `with` block with a largest number of triangles, if none is lower."""
    now = _most.get()
    with triangle_limit(most if now is None else min(most, now)):
        yield
