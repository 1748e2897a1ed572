"""Fields for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.files import naming, replacing
from toros_fem.meshes.pattern import Pattern


def write_fields(
    path: Path, pattern: Pattern, positions: Floats, cell_fields: Mapping[str, Floats]
) -> None:
    """Write the deformed skin as a VTU file (one rank).

    The displacement from the assembled shape is written too, so that a viewer can show either.
    Positions, (n, 3), in m, are those of all assembled vertices, fields of all triangles, (t,) or
    (t, 3) for vectors.

    Raises:
        OutputError: The file cannot be written.
    """
    import meshio

    fields = meshio.Mesh(
        positions,
        [("triangle", pattern.triangles)],
        point_data={"displacement": positions - pattern.points},
        cell_data={
            "panel": [pattern.panel.astype(np.float64)],
            **{name: [np.asarray(values)] for name, values in cell_fields.items()},
        },
    )
    with naming(path), replacing(path) as beside:
        fields.write(beside, file_format="vtu")
