"""Mesh files that tests write."""

from pathlib import Path

import meshio
import numpy as np
from mpi4py import MPI

XDMF = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="{n} 3" Format="XML"
 Precision="8">{points}</DataItem></Geometry>
<Topology TopologyType="Triangle" NumberOfElements="{t}"><DataItem DataType="Int"
 Dimensions="{t} 3" Format="XML" Precision="8">{triangles}</DataItem></Topology>
</Grid></Domain></Xdmf>"""


def write(comm: MPI.Comm, path: Path, points: np.ndarray, cells: object, **options: object) -> Path:
    """Write a mesh on the first rank."""
    if comm.rank == 0:
        more = {k: options.pop(k) for k in ("cell_data", "field_data") if k in options}
        meshio.Mesh(points, cells, **more).write(path, **options)
    comm.barrier()
    return path


def text(comm: MPI.Comm, path: Path, content: str) -> Path:
    """Write a text on the first rank."""
    if comm.rank == 0:
        path.write_text(content, encoding="utf-8")
    comm.barrier()
    return path


def xdmf(points: np.ndarray, triangles: np.ndarray) -> str:
    """An XDMF file whose numbers are text."""
    places = " ".join(repr(float(x)) for x in points.ravel())
    corners = " ".join(map(str, triangles.ravel()))
    return XDMF.format(n=len(points), t=len(triangles), points=places, triangles=corners)


def obj(points: np.ndarray, triangles: np.ndarray) -> str:
    """An OBJ file."""
    content = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    return content + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)
