"""Reads an MSH file by gmsh in a process of its own, `python -P msh_process.py FILE`.

On damaged files gmsh writes beyond its memory, which would end or spoil the process that designs.
It imports neither the package nor MPI, and writes an .npz file of arrays to standard output.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import gmsh
import numpy as np


def arrays(path: str) -> dict[str, Any]:
    """Return points, faces by their number of corners with their groups, lines, names and others.

    A face of several physical groups is there once for each, of none with the group 0. Without
    physical groups CAD faces are groups.
    """
    gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.merge(path)
    model, mesh = gmsh.model, gmsh.model.mesh
    node, coordinates, _ = mesh.getNodes()
    if not len(node):
        raise ValueError("it has no nodes")
    order = np.argsort(node)
    node = node[order]
    found: dict[str, list[Any]] = {"line": [], "3": [], "4": [], "group 3": [], "group 4": []}
    other, grouped = [], bool(model.getPhysicalGroups(2))
    for dimension, entity in model.getEntities():
        groups = model.getPhysicalGroupsForEntity(dimension, entity) if grouped else [entity]
        kinds, _, corners = mesh.getElements(dimension, entity)
        for kind, tags in zip(kinds, corners, strict=True):
            name, _, degree, size, *_ = mesh.getElementProperties(kind)
            if dimension not in (1, 2):
                continue
            numbers = np.minimum(np.searchsorted(node, tags), len(node) - 1)
            if not np.array_equal(node[numbers], tags):
                raise ValueError("an element has a node that is not there")
            numbers = numbers.reshape(-1, size)
            if degree != 1 or size > 4:
                other.append(f"{len(numbers)} of type {name}")
            elif dimension == 1:
                found["line"].append(numbers)
            else:
                for group in groups if len(groups) else [0]:
                    found[f"{size}"].append(numbers)
                    found[f"group {size}"].append(np.full(len(numbers), abs(group)))
    physical = [tag for _, tag in model.getPhysicalGroups(2)]
    made = {name: np.concatenate(parts) for name, parts in found.items() if parts}
    return {
        **made,
        "points": np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[order],
        "physical": np.array(physical, dtype=np.int64),
        "names": np.array([model.getPhysicalName(2, tag) for tag in physical], dtype=np.str_),
        "other": np.array(other, dtype=np.str_),
    }


if __name__ == "__main__":
    written = io.BytesIO()
    try:
        np.savez(written, **arrays(sys.argv[1]))
    except Exception as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(written.getvalue())
    sys.stdout.flush()
