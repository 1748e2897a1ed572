"""Options whose commands tell their help without a solver: of fits, tolerances, mesh files."""

from __future__ import annotations

import logging
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Flag, In, Length, Number, OneOf, Positive, Stretch, Table, Text, key
from toros_fem.materials.library.material import MATERIAL_KINDS

if TYPE_CHECKING:  # `toros unwrap --help` needs no meshes
    from scipy.sparse import csr_array

    from toros_fem.meshes.surface import Surface
    from toros_fem.meshes.unwrapped import Unwrapped

# Branches of the load cycles of a test, and losses of residuals with scipy's names.
BRANCHES = ("last-loading", "first-loading", "last-unloading", "all")
LOSSES = {"soft-l1": "soft_l1", "huber": "huber", "squares": "linear"}
# What extension without force is, and force without extension.
STARTS = ("auto", "slack", "set", "none")
OFFSETS = ("ask", "preload", "untared")
log = logging.getLogger(__name__)


class FitOptions(Table):
    """How a material is fitted to tensile tests."""

    kind: Annotated[str, OneOf(MATERIAL_KINDS)] = key(
        "fabric", "what it is: fabric and print follow eq. (1), a rubber Yeoh's law"
    )
    branch: Annotated[str, OneOf(BRANCHES)] = key(
        "last-loading", "branch of the load cycles that is fitted"
    )
    start: Annotated[str, OneOf(STARTS)] = key(
        "auto",
        "what extension before the force rises is: slack of the strip, or the set of the fabric, "
        "by which the gauge length grows; auto takes slack in a first loading, set in a later one",
    )
    offset: Annotated[str, OneOf(OFFSETS)] = key(
        "ask", "what a force at a strain of 0 is: a preload, or that of an untared cell"
    )
    up_to: Stretch | None = key(None, "largest stretch that is fitted; none takes all")
    loss: Annotated[str, OneOf(tuple(LOSSES))] = key(
        "soft-l1", "loss of the residuals; the first two bound what an outlier counts"
    )
    draws: Annotated[int, In(at_least=40, at_most=100000)] = key(
        400, "times that the tests are drawn again, for the 95 % intervals"
    )
    seed: Number = key(0, "seed of these draws")
    points: Annotated[int, In(at_least=10, at_most=10000)] = key(
        60, "points that each curve is averaged to, even over the stretch"
    )


class ToleranceConfig(Table):
    """Tolerances of printer, material and pressure; SI units."""

    width: Annotated[float, In("m", above=0, at_most=0.01)] | None = key(
        1e-4,
        "width by which lines are off; each border by half of it, and twice as much is simulated "
        "too; none leaves it out",
    )
    modulus: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which moduli are off; none leaves them out"
    )
    thickness: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which thicknesses are off; none leaves them out"
    )
    pressure_change: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.05, "fraction by which the pressure is off; none leaves it out"
    )


class ForceOptions(Table):
    """Which forces of a design are told; SI units."""

    panel: Text = key("tip", "panel whose force is told, the free end of the skin")
    turns: Annotated[str, OneOf(("held", "free"))] = key(
        "held", "whether the panel is held in its turns too where it is blocked, or may turn"
    )
    pressure: Annotated[float, In("Pa", above=0)] | None = key(
        None, "largest pressure; none takes that of the design"
    )
    steps: Annotated[int, In(at_least=2, at_most=50)] = key(
        5, "number of pressures, and of places at which the panel is held besides that at rest"
    )
    direction: Text | None = key(
        None,
        'direction of the force that is told, "0 0 1" for instance; none takes the way of the free '
        "panel",
    )
    point: Text | None = key(
        None,
        'assembled point that the torque is about, in m, "0 0 0.15" for instance; it moves with '
        "the panel; none takes the centre of the panel's area",
    )
    without_intervals: Flag = key(
        False, "tell no intervals, which come from a coarser mesh of the same print: half the time"
    )

    def __post_init__(self) -> None:
        for name in ("direction", "point"):
            self.vector(name)

    def vector(self, name: str) -> tuple[float, ...] | None:
        """Return the three numbers of `direction` or `point`; None where there are none.

        Raises:
            ParameterError: They are not three finite numbers.
        """
        words: str | None = getattr(self, name)
        if words is None:
            return None
        with suppress(ValueError):
            numbers = tuple(float(word) for word in words.split())
            if len(numbers) == 3 and all(map(isfinite, numbers)):
                return numbers
        raise ParameterError(f'{name} = "{words}" must be three numbers, as "0 0 1".', name)


# ------------------------------------------------------------------------------------- mesh files


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
