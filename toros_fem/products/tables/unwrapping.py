"""Table of a mesh file: its unit, and how its surface is cut and laid flat."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from mpi4py import MPI

from toros_fem.base.keys import In, Length, Number, OneOf, Positive, Table, key

if TYPE_CHECKING:  # `toros unwrap --help` needs no meshes
    from scipy.sparse import csr_array

    from toros_fem.meshes.surface import Surface
    from toros_fem.meshes.unwrapped import Unwrapped

log = logging.getLogger(__name__)


class Unwrapping(Table):
    """How a mesh file is read, cut and laid flat."""

    scale: Length = key(1e-3, "length of the mesh file's unit; a pattern is in m")
    component: Number | None = key(
        None, "connected component of the file, 0 for the largest; none: it holds only one"
    )
    remesh: Length | None = key(
        None,
        "edge length of a new mesh of the surface, on which creases, seams and borders of parts "
        "stay edges; none keeps the triangles of the file",
    )
    cuts: Annotated[str, OneOf(("given", "auto"))] = key(
        "given",
        "where the surface is cut into panels: at the lines and parts of the file, found "
        "if it has none, or always found",
    )
    method: Annotated[str, OneOf(("auto", "exact", "abf", "lscm"))] = key(
        "auto", "how panels are laid flat"
    )
    crease_angle: Annotated[float, In("deg", above=0, at_most=180)] = key(
        45.0,
        "angle between normals above which a found cut, or a new mesh, follows an edge",
    )
    max_stretch: Positive | None = key(
        None, "largest stretch of a panel; none: 0.15 with found cuts, no bound with given ones"
    )

    def surface(self, comm: MPI.Comm, path: Path) -> Surface:
        """Read the surface, and warn of a size that no skin has (collective)."""
        from toros_fem.meshes.files import USUAL, read_surface, unit_hint

        surface = read_surface(comm, path, self.scale, self.component)
        size = float(np.ptp(surface.points, axis=0).max())
        if comm.rank == 0 and not USUAL[0] <= size <= USUAL[1]:
            hint = unit_hint(size / self.scale)
            log.warning("%s is %.3g m across with scale = %g m. %s", path, size, self.scale, hint)
        return surface

    def meshed(self, comm: MPI.Comm, surface: Surface) -> tuple[Surface, csr_array]:
        """Mesh a surface anew if that is asked for, and tell it (collective).

        The matrix, (m, n), interpolates values at the given vertices to those that are returned.
        """
        from scipy.sparse import eye_array

        from toros_fem.meshes.seams import remeshed
        from toros_fem.meshes.triangles import require_affordable

        if self.remesh is None:
            return surface, eye_array(len(surface.points), format="csr")
        require_affordable(surface.area, self.remesh, "remesh")
        crease = float(np.radians(self.crease_angle))
        made = remeshed(comm, surface, self.remesh, crease_angle=crease)
        if comm.rank == 0:
            log.info("%s", made.surface.repairs)
        return made.surface, made.weights

    def unwrapped(self, comm: MPI.Comm, surface: Surface) -> Unwrapped:
        """Cut a surface and lay it flat (collective).

        Raises:
            SurfaceError: A region cannot be laid flat by the requested method.
        """
        from toros_fem.meshes.unwrapped import unwrap

        return unwrap(
            comm,
            surface,
            "auto" if self.cuts == "auto" else None,
            self.method,
            crease_angle=float(np.radians(self.crease_angle)),
            max_stretch=self.max_stretch,
        )
