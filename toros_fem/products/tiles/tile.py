"""A fabric with designed stiffness: a tile that repeats (paper section 4.3, Fig. 7).

The print of a square tile of 1 cm is designed so that the fabric has the target stiffness when it
is pulled by 10 % in any direction and free across. Several random starts are tried,
families of straight and wavy lines and long waves of the density by turns, and the best is
continued; islands and lines or gaps below `--print-width` count against a start and a print. All
figures are those of the printed pattern, simulated again on a mesh along its borders.

Targets: "orthotropic" (4000 N/m along x, 1000 along y and at 45°), "tetragonal" (4000 along x and
y, 800 at 45°), "isotropic" (1500 everywhere), "anisotropic" (the largest ratio of stiffness along x
to that along y), "auxetic" (widens when pulled along x or y). `demos/tile_sheet.py` makes a sheet
of the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, In, Length, OneOf, Table, key
from toros_fem.base.validation import Floats
from toros_fem.meshes.tiles import KINDS
from toros_fem.meshes.triangles import require_affordable
from toros_fem.products.actuators.cost import Cost
from toros_fem.products.plausibility import (
    Group,
    doubts,
    sheet_groups,
    warn_of_doubts,
    with_lengths,
)
from toros_fem.products.tiles.problem import TileCase, TileDesignScene, measure_print
from toros_fem.products.tiles.report import TileRun, write_tile_results
from toros_fem.products.tiles.search import design_tile
from toros_fem.products.tiles.stiffness_profile import Contrast, ProfileObjective, ProfileTarget
from toros_fem.results.reporter import DesignReporter, print_step
from toros_fem.results.result import RunResult
from toros_fem.results.runs.open_run import journal_of

# Symmetry of the design for each target.
SYMMETRIES = {
    "orthotropic": "orthotropic",
    "tetragonal": "tetragonal",
    "isotropic": "tetragonal",
    "anisotropic": "orthotropic",
    "auxetic": "chiral",
}
# Stiffness along x, at 45° and along y, in N/m, of the targets that prescribe it.
STIFFNESSES = {
    "orthotropic": (4000.0, 1000.0, 1000.0),
    "tetragonal": (4000.0, 800.0, 4000.0),
    "isotropic": (1500.0, 1500.0, 1500.0),
}
PRESCRIBED = tuple(STIFFNESSES)
# Cost of a Newton step of a print, whose triangles are quadratic, over one of a design.
QUADRATIC = 4.0


class TileTarget(Table):
    """Shape or stiffness that is asked for."""

    target: Annotated[str, OneOf(tuple(SYMMETRIES))] = key("tetragonal", "target of the design")
    directions: Count = key(
        3, "number of angles between directions, in 45° (tetragonal) or in each half of 90°"
    )
    contraction: Annotated[float, In(at_least=-1, at_most=1)] = key(
        -0.2, "lateral contraction of the auxetic target"
    )
    stiffness_0: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness along x; none takes that of --target"
    )
    stiffness_45: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness at 45°; none takes that of --target"
    )
    stiffness_90: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness along y, if orthotropic; none takes that of --target"
    )

    NEEDS: ClassVar = {
        "contraction": ("target", ("auxetic",)),
        **dict.fromkeys(("directions", "stiffness_0", "stiffness_45"), ("target", PRESCRIBED)),
        "stiffness_90": ("target", ("orthotropic",)),
    }


class TileSizes(Table):
    """Sizes and mesh.

    Raises:
        ParameterError: Edges are too long for the tile.
    """

    size: Length = key(0.01, "side of the square tile")
    edge_length: Length = key(0.125e-3, "edge length; twice as long for the starts")
    mesh: Annotated[str, OneOf(KINDS)] = key("crossed", "kind of mesh")

    def __post_init__(self) -> None:
        if self.edge_length > self.size / 5:
            raise ParameterError(
                f"edge_length = {self.edge_length:g} m must be at most {self.size / 5:g} m, a "
                "fifth of the tile: the mesh of the starts has edges twice as long.",
                "edge_length",
            )


class TileScene(TileDesignScene):
    """Target and mesh of the tile, and its design."""

    target: TileTarget = TileTarget()
    skin: TileSizes = TileSizes()

    KIND: ClassVar = "tile"
    COARSE: ClassVar = {"edge_length": 1.6, "filter_radius": 8 / 7}
    FEW: ClassVar = (
        "target", "stiffness_0", "stiffness_45", "stiffness_90", "size", "edge_length", "seed",
    )  # fmt: skip

    def groups(self) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        return with_lengths(self, self.skin.size, self._groups())

    def _groups(self) -> Iterator[Group]:
        side, design = self.skin.size, self.design
        yield from sheet_groups(self.material.composite, side)
        constrained = ("line_width", "gap_width") if design.constrained else ()
        for name in ("print_width", "filter_radius", *constrained):
            if (width := self.value(name)) is not None:
                yield Group("width", name, width / side)

    def run_design(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Design the tile and write all results into a folder (collective)."""
        scene = self.of_first_rank(comm)
        warn_of_doubts(comm, doubts(scene))
        reporter, case = DesignReporter(comm, output), tile_case(comm, scene)
        log = print_step(comm) if verbose else None
        made = design_tile(case, scene, reporter, log, journal_of(output))
        found = TileRun(made, measure_print(made), dict(reporter.seconds))
        write_tile_results(output, found)
        return found

    def expected_cost(self, comm: MPI.Comm) -> Cost:
        """Return the cost of the design (collective)."""
        require_affordable(self.skin.size**2, self.skin.edge_length)
        own = tile_case(comm, self).tile.pattern
        return Cost(len(own.panel), len(own.panel), 3 * len(own.points), comm.size)


def linear_profile(angles: np.ndarray, along: float, diagonal: float, across: float) -> Floats:
    """Return the stiffness of a linear orthotropic sheet at angles, from that at 0°, 45° and 90°.

    1/s = cos⁴/s₀ + sin⁴/s₉₀ + (4/s₄₅ − 1/s₀ − 1/s₉₀) sin² cos².
    """
    c, s = np.cos(angles) ** 2, np.sin(angles) ** 2
    mixed = 4 / diagonal - 1 / along - 1 / across
    return np.asarray(1 / (c**2 / along + s**2 / across + mixed * c * s))


def tile_case(comm: MPI.Comm, config: TileScene) -> TileCase:
    """Return the tile with its target."""
    asked, skin, symmetry = config.target, config.skin, SYMMETRIES[config.target.target]
    halves = 1 if symmetry == "tetragonal" else 2
    angles = np.asarray(
        np.linspace(0, halves * np.pi / 4, halves * asked.directions + 1), dtype=np.float64
    )
    objective: ProfileObjective
    if asked.target == "anisotropic":
        angles = angles[[0, -1]]
        objective = Contrast(soft=angles > 0, stiff=angles == 0)
    elif asked.target == "auxetic":
        angles = angles[:1]
        objective = ProfileTarget(contraction=np.array([asked.contraction]))
    else:
        given = (asked.stiffness_0, asked.stiffness_45, asked.stiffness_90)
        along, diagonal, across = (
            default if value is None else value
            for value, default in zip(given, STIFFNESSES[asked.target], strict=True)
        )
        if symmetry == "tetragonal":
            across = along
        objective = ProfileTarget(linear_profile(angles, along, diagonal, across))
    size = skin.size, skin.size
    return TileCase(comm, size, skin.edge_length, skin.mesh, symmetry, angles, objective)
