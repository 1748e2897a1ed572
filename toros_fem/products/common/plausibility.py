"""What a skin can be expected to do: dimensionless groups of a scene, and their usual ranges.

A number may be within its bounds and still be in the wrong unit, or belong to no skin that works.
Each group compares numbers of a scene with each other. Outside of the usual range it is told as a
doubt; what no skin can do is refused. docs/reference/scene_keys.md has the table.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.scene import Scene
from toros_fem.design.loop.case import Case
from toros_fem.materials.sheet import Composite
from toros_fem.measures.shape import ShapePart
from toros_fem.mechanics.skin.stretch_bounds import singular_values
from toros_fem.meshes.triangles import gradients, surface_areas

log = logging.getLogger(__name__)

INFINITE = math.inf
# Area of a target over that of the cut panels below which it is in doubt, and part of its area
# that may stretch beyond the bound: single triangles do so at sharp bends of a map.
SHRUNK, BEYOND = 0.95, 0.01
# Lengths that are units of files.
UNITS = ("scale", "object_scale")


@dataclass(frozen=True)
class Range:
    """Range of a dimensionless group.

    Attributes:
        words: What it is, with its formula.
        usual: Least and largest value of skins that work.
        possible: Those of what makes sense at all; what is outside is refused.
        source: Where the ranges are from.
        remedy: What is wrong most often.
    """

    words: str
    usual: tuple[float, float]
    possible: tuple[float, float] = (-INFINITE, INFINITE)
    source: str = ""
    remedy: str = ""


# r is the radius of the skin, L its length, E h the stiffness of the fabric with its bladder.
# A tile has its side in the place of r and of the girth.
RANGES: Mapping[str, Range] = {
    "load": Range(
        "strain by which the pressure would widen the plain skin, p r/(E h)",
        (0.03, 30.0), (1e-6, 1e4), "hoop force p r of a thin tube; the paper's tubes have 1 to 4",
        "Is the pressure in the unit that was meant? Numbers without a unit are Pa.",
    ),
    "thickness": Range(
        "thickness of a sheet over the radius of the skin, or the side of a tile",
        (2e-4, 0.2), (1e-6, 1.0), "shells are thin up to about 0.1 (Timoshenko 1959)",
        "Is the thickness in the unit that was meant? Numbers without a unit are m.",
    ),
    "size": Range(
        "largest extent of the skin in m",
        (5e-3, 2.0), (1e-4, 10.0), "from a tip of a finger to a person",
        "Is it in the unit that was meant? `scale` is the length of a mesh file's unit.",
    ),
    "slenderness": Range(
        "length of a tube, leg or finger over its diameter",
        (1.5, 60.0), (0.2, 1e3), "7.5 for the paper's tubes",
        "Are both in the unit that was meant? Numbers without a unit are m.",
    ),
    "contrast": Range(
        "stiffness of the reinforced fabric over that of the fabric, E h of each",
        (3.0, 1e5), (0.0, INFINITE), "560 in the default materials",
        "A print that is hardly stiffer than the fabric shapes nothing.",
    ),
    "stretch": Range(
        "bound c1 on a stretch of the fabric",
        (1.02, 8.0), (1.0, 20.0), "natural rubber tears at 8 (Treloar 1975)",
        "c1 is a stretch, not a strain in per cent: 1.9 for a fabric that stretches by 90 %.",
    ),
    "width": Range(
        "width of a line or a gap, or radius of the filter, over the smallest girth of the skin or "
        "the side of a tile",
        (1e-3, 0.25), (1e-5, 0.5), "lines that shape a tube are much thinner than its girth",
        "Is the width in the unit that was meant? Numbers without a unit are m.",
    ),
    "filter": Range(
        "radius of the filter over the edge length of the mesh",
        (1.5, INFINITE), (0.0, INFINITE), "a filter reaches the neighbours of a triangle",
        "With less it hardly filters, and guarantees no width of a line.",
    ),
    "angle": Range(
        "angle that is asked for, over a full turn",
        (0.02, 7.0), (0.0, INFINITE), "smaller ones are within the errors of a print",
        "Angles are in degrees.",
    ),
    "shortening": Range(
        "part of its length by which a skin shortens",
        (0.005, 0.25), (-INFINITE, 0.423), "braids shorten by less than 1 − 1/√3 (Schulte 1961)",
        "A number without a unit is in per cent: 8 is 8 %.",
    ),
    "bound": Range(
        "strain that the target needs, over that at the bound c1 of the fabric",
        (0.0, 0.9), (0.0, 1.5), "eq. (1): no stretch reaches c1",
        "Take a longer or thinner skin, a fabric that stretches further, or a smaller target.",
    ),
    "edges": Range(
        "number of edges around the skin, its girth 2 π r over their length",
        (14.0, INFINITE), (5.0, INFINITE), "with fewer, a tube is a prism (docs/accuracy.md)",
        "Take shorter edges. Those of an own mesh are halved by each step of `refinements`, and "
        "`remesh` makes a new mesh.",
    ),
    "length": Range(
        "length over the girth of the skin, or over the side of the tile",
        (0.0, 20.0), (0.0, 1e3), "parts of a skin are about as large as the skin",
        "Is the length in the unit that was meant? Numbers without a unit are m.",
    ),
}  # fmt: skip
# Groups that count without a target and a design.
SIMULATED = ("thickness", "contrast", "stretch", "load", "size")


@dataclass(frozen=True)
class Group:
    """Value of a dimensionless group of a scene.

    Attributes:
        name: Its name in `RANGES`.
        key: Key of the scene that it is told with.
    """

    name: str
    key: str
    value: float

    @property
    def range(self) -> Range:
        """Its usual range."""
        return RANGES[self.name]

    @property
    def doubt(self) -> str | None:
        """What is doubtful about it, in a sentence or two; None within the usual range."""
        return None if _inside(self.value, self.range.usual) else self._sentence(self.range.usual)

    def require_possible(self) -> None:
        """Check that it is possible at all.

        Raises:
            ParameterError: It is not.
        """
        if not _inside(self.value, self.range.possible):
            raise ParameterError(self._sentence(self.range.possible, "possible"), self.key)

    def _sentence(self, ends: tuple[float, float], word: str = "usual") -> str:
        low, high = ends
        span = f"{low:g} to {high:g}" if math.isfinite(low) else f"at most {high:g}"
        span = span if math.isfinite(high) else f"at least {low:g}"
        of = self.range
        what = f"{of.words}," if "," in of.words else of.words
        told = f"{self.key}: the {what} is {self.value:.3g}; {word} is {span}. {of.remedy}"
        return told.rstrip()


def angle_group(key: str, angle: float) -> Group:
    """Return the group of an angle in degrees."""
    return Group("angle", key, abs(angle) / 360)


def bend_strain(angle: float, length: float, outer: float) -> float:
    """Return the strain of the outer side of a bend by an angle in degrees over a length in m.

    `outer` is the distance in m of that side from the line that keeps its length.
    """
    return abs(math.radians(angle)) * outer / length


def sheet_groups(sheet: Composite, size: float) -> Iterator[Group]:
    """Yield the groups of the sheets of a skin with a radius, or of a tile with a side, in m."""
    fabric, printed, bladder = sheet.fabric, sheet.reinforcement, sheet.bladder
    yield Group("thickness", "thickness", fabric.thickness / size)
    yield Group("thickness", "reinforcement_thickness", printed.thickness / size)
    contrast = printed.membrane_stiffness / fabric.membrane_stiffness
    yield Group("contrast", "reinforcement_young", contrast)
    if bladder is not None:
        yield Group("thickness", "bladder_thickness", bladder.thickness / size)
    bounds = {"": sheet.fabric_bounds, "reinforcement_": sheet.reinforcement_bounds}
    for of, (c1, _) in bounds.items():
        if not of or bounds[of] != bounds[""]:
            yield Group("stretch", f"{of}c1", c1)


def with_lengths(scene: Scene, size: float, groups: Iterable[Group]) -> Iterator[Group]:
    """Yield groups of a scene, and those of the lengths that they do not tell of.

    `size` is the girth of the skin, or the side of the tile, in m.
    """
    told = set()
    for group in groups:
        told.add(group.key)
        yield group
    for name, one in scene.described().items():
        value = scene.value(name)
        if one.within.unit == "m" and value is not None and name not in (*told, *UNITS):
            yield Group("length", name, abs(value) / size)


def doubts(scene: Scene, simulated: bool = False) -> list[str]:
    """Return what is doubtful about a scene, a sentence or two each.

    A value that does not count is doubtful too. Of a scene that is only simulated, sheets and
    pressures count: its target may be nobody's, and its pattern is given.

    Raises:
        ParameterError: A group is impossible.
    """
    found = []
    for group in scene.groups():
        if not simulated or group.name in SIMULATED:
            group.require_possible()
            if group.doubt is not None:
                found.append(group.doubt)
    return found if simulated else [*found, *_idle(scene)]


def warn_of_doubts(comm: MPI.Comm, doubtful: Sequence[str]) -> None:
    """Log doubts on the first rank."""
    if comm.rank == 0:
        for one in doubtful:
            log.warning("%s", one)


def target_doubts(case: Case) -> list[str]:
    """Return what is doubtful about a target whose whole shape counts, as sentences.

    It is a map: each triangle of the cut panels has its place there. Of cross-sections the walls
    may swell freely, and nothing is told.
    """
    if not any(isinstance(part, ShapePart) for part in case.parts):
        return []
    pattern, target = case.pattern, np.asarray(case.goal)
    areas, bound = pattern.areas, (case.composite or Composite()).fabric_bounds[0]
    corners = target[pattern.triangles]
    largest, _ = singular_values(np.einsum("tki,tkj->tij", corners, gradients(pattern.corners)))
    grown = float(surface_areas(target, pattern.triangles).sum() / areas.sum())
    beyond = float(areas[largest > bound].sum() / areas.sum())
    found = []
    if grown < SHRUNK:
        found.append(
            f"target: its area is {grown:.0%} of that of the cut panels; no fabric shrinks. Cut a "
            "smaller skin, or take a larger target."
        )
    if beyond > BEYOND:
        found.append(
            f"target: on {beyond:.0%} of its area the fabric stretches by more than c1 = {bound:g} "
            f"(up to {float(largest.max()):.3g}). Cut a larger skin, take a fabric that stretches "
            "further, or a smaller target."
        )
    return found


@dataclass(frozen=True, eq=False)
class Inflated:
    """A skin under pressure, as its groups see it.

    Attributes:
        sheet: Fabric, print and bladder.
        pressure: Largest pressure in Pa.
        radius: Radius of the inflated skin in m where it is thinnest.
        pressure_key: Key of the scene that holds the pressure.
    """

    sheet: Composite
    pressure: float
    radius: float
    pressure_key: str = "pressure"

    def groups(self) -> Iterator[Group]:
        """Yield the groups of its sheets and of its pressure."""
        yield from sheet_groups(self.sheet, self.radius)
        yield self.load(self.pressure_key, self.pressure)

    @property
    def girth(self) -> float:
        """Its girth in m."""
        return 2 * math.pi * self.radius

    def load(self, key: str, pressure: float) -> Group:
        """Return the group of a pressure in Pa."""
        return Group("load", key, pressure * self.radius / self.sheet.least_stiffness)

    def width(self, key: str, width: float) -> Group:
        """Return the group of the width in m of a line or a gap."""
        return Group("width", key, width / self.girth)

    def slenderness(self, key: str, length: float) -> Group:
        """Return the group of a length in m."""
        return Group("slenderness", key, length / (2 * self.radius))

    def shortening(self, key: str, share: float) -> Iterator[Group]:
        """Yield the groups of a part of its length by which it shortens; it may lengthen too."""
        if share < 0:
            yield self.reach(key, -share)
        else:
            yield Group("shortening", key, share)

    def reach(self, key: str, strain: float) -> Group:
        """Return the group of a strain that the fabric must have for the target of a key."""
        return Group("bound", key, strain / (self.sheet.fabric_bounds[0] - 1))

    def bend(self, key: str, angle: float, length: float, outer: float) -> Iterator[Group]:
        """Yield the groups of a bend by an angle in degrees over a length in m.

        `outer` is the distance in m of the outer side from the line that keeps its length.
        """
        yield angle_group(key, angle)
        yield self.reach(key, bend_strain(angle, length, outer))

    def twist(self, key: str, angle: float, length: float) -> Iterator[Group]:
        """Yield the groups of a twist by an angle in degrees over a length in m."""
        yield angle_group(key, angle)
        half = abs(math.radians(angle)) * self.radius / length / 2  # of the shear
        yield self.reach(key, half + math.hypot(1.0, half) - 1)  # the largest principal strain


def _idle(scene: Scene) -> Iterator[str]:
    known = scene.described()
    for name, (other, needed) in scene.idle():
        words = " or ".join(map(known[other].written, needed or ()))
        what = f"it needs {other} = {words}" if needed else f"{other} is none"
        told = f"{name} = {known[name].written(scene.value(name))}"
        yield f"{told} does not count: {what}. Change {other}, or leave {name} out."


def _inside(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]
