"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

A quarter with one leg is designed, by symmetry. The whole robot is printed. It is then simulated
with three chambers, body, front legs and rear legs, through one cycle of a gait.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.config import ActuatorConfig, TipWeights
from toros_fem.actuators.gait import Gait, write_gait
from toros_fem.actuators.legs import leg_cross_sections, rest_on_body, tip_angle_metric
from toros_fem.actuators.run import ActuatorResult, design_actuator, summary_sentence
from toros_fem.analysis.trace import trace
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.config import quantity
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.mechanics.chambers import Chambers
from toros_fem.meshes import Pattern, Star, compose, plane_centroids, sew, stand, walker

ANGLE = {"stand": 90.0, "crawl": 60.0}  # of the legs, in degrees
CHAMBERS = ("body", "front", "rear")
# Rear feet grip, the body reaches out, front feet grip, rear feet let go, the body draws in.
PHASES = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0], [0, 1, 1]], dtype=bool)
DOWN = (0.0, 0.0, -1.0)
# Fig. 10 of the paper: distance in m by which the crawling robot gets ahead in a cycle.
MEASURED_STRIDE = ("paper, measured", 0.025)


@dataclass(frozen=True)
class WalkerConfig(ActuatorConfig):
    """Numbers of the walker; SI units."""

    motion: str = quantity("stand", "what the legs are designed for", choices=tuple(ANGLE))
    angle: float | None = quantity(
        None, "angle by which legs bend; none takes 90 to stand and 60 to crawl", "deg", above=0
    )
    leg_length: float = quantity(0.06, "length of a leg from the body's circle", "m", above=0)
    leg_width: float = quantity(0.024, "width of a leg", "m", above=0)
    body_radius: float = quantity(0.02, "radius of the body", "m", above=0)
    fillet: float = quantity(6e-3, "radius of the fillets between body and legs", "m", above=0)
    edge_length: float = quantity(1.8e-3, "edge length of the mesh", "m", above=0)
    bent_length: float = quantity(
        0.03, "length of a leg that bends, from its root; the rest stays straight", "m", above=0
    )
    foot_length: float | None = quantity(
        None, "length of a leg's end that is printed; none leaves it to the design", "m", above=0
    )
    cross_sections: int = quantity(6, "number of cross-sections of the leg", at_least=1)
    centreline_weight: float = quantity(
        0.02, "weight of the leg's centre line over that of its orientation", at_least=0
    )
    orientation_length: float = TipWeights.redefault("orientation_length", 0.03)
    reach: float = quantity(
        6e-3, "distance along x by which the body reaches out to either side if it crawls", "m"
    )
    gait_steps: int | None = quantity(
        2, "number of equilibria in each phase of the gait; none leaves the gait out", at_least=1
    )
    released_pressure_fraction: float = quantity(
        0.86, "pressure of a released chamber over that of the design", at_least=0, at_most=1
    )
    seams: str = ActuatorConfig.redefault("seams", "hinged")
    levels: int | None = ActuatorConfig.redefault("levels", 1)
    filter_radius: float = ActuatorConfig.redefault("filter_radius", 2.75e-3)
    pressure: float = ActuatorConfig.redefault("pressure", 20e3)

    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "angle"}

    @property
    def leg_angle(self) -> float:
        """Angle in degrees by which legs are to bend."""
        return ANGLE[self.motion] if self.angle is None else self.angle

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: six edges across a leg."""
        return self.leg_width / 6

    @property
    def star(self) -> Star:
        """Outline of the robot."""
        return Star(4, self.leg_length, self.leg_width, self.body_radius, self.fillet, np.pi / 4)


def coarse(config: WalkerConfig) -> WalkerConfig:
    """Return the same design on a coarse mesh with few steps; it takes a minute or two."""
    return config.updated(
        edge_length=2.8e-3,
        filter_radius=4.3e-3,
        # T hardly depends on the print in the feet: few steps would leave holes and blobs there.
        foot_length=0.015,
        levels=1,
        iterations=40,
        constrained_iterations=30,
    )


def case(comm: MPI.Comm, config: WalkerConfig) -> ActuatorCase:
    """Return a quarter of the robot and its target."""
    star, angle = config.star, config.leg_angle
    pattern = walker(comm, config.edge_length, star, planes=(0, 1))
    along = np.append(star.directions[0], 0.0)
    target = stand(
        np.radians(angle), config.bent_length, directions=star.directions[:1], root=star.root
    )
    if config.motion == "crawl":
        target = compose(target, lambda points: points + [config.reach, 0, 0])
    return ActuatorCase(
        pattern=pattern,
        target=target(pattern.points),
        supports=rest_on_body(pattern, star.body_radius, (0, 1)),
        passive=foot_density(pattern, config),
        metrics=(tip_angle_metric(angle, along, DOWN, star.root),),
        cross_sections=leg_cross_sections(
            pattern,
            along,
            star.root,
            config.cross_sections,
            config.centreline_weight,
            config.orientation_length,
        ),
        # The top is to stretch; without this hint the start does not distinguish up from down.
        start=np.where(pattern.panel == pattern.panel_index("top"), 0.35, 0.65),
        symmetry=(0, 1),
    )


def foot_density(pattern: Pattern, config: WalkerConfig) -> npt.NDArray[np.float64] | None:
    """Return the prescribed density of all triangles, (t,): 1 in the feet, NaN elsewhere.

    Without feet there is none.
    """
    if config.foot_length is None:
        return None
    star = config.star
    reach = (plane_centroids(pattern) @ star.directions.T).max(axis=1)
    return np.where(reach > star.reach - config.foot_length, 1.0, np.nan)


def chambers(pattern: Pattern, star: Star) -> Chambers:
    """Return three chambers: the body, the two legs at x > 0, and the two at x < 0."""
    centroids = plane_centroids(pattern)
    leg = (centroids @ star.directions.T > star.root).any(axis=1)
    return Chambers(CHAMBERS, np.where(leg, np.where(centroids[:, 0] > 0, 1, 2), 0))


def walk(
    comm: MPI.Comm, output: Path, config: WalkerConfig, steps: int, design: ActuatorResult
) -> dict[str, Any]:
    """Simulate the whole printed robot through one cycle of the gait; return its figures.

    Args:
        comm: Communicator.
        output: Folder for table, pictures and figures.
        config: Numbers of the walker.
        steps: Number of equilibria in each phase.
        design: The designed robot.
    """
    star, printed = config.star, design.printed
    pattern = printed.pattern
    skin = sew(comm, pattern)
    shown = printed.evaluation or design.result.final
    quarter, whole = design.problem.skin, design.problem.whole
    assert whole is not None
    start = whole.at_vertices(quarter.gather_vertices(shown.equilibrium.positions))
    # Fixed at their positions in the design's shape: this prevents rigid motion only.
    rest = rest_on_body(pattern, star.body_radius)
    rest = replace(rest, displacement=np.where(rest.fixed, start - pattern.points, 0.0))
    solver = EquilibriumSolver(skin, config.composite, rest, chambers=chambers(pattern, star))
    feet = tuple(1 if x > 0 else 2 for x in star.directions[:, 0])
    phases = np.where(PHASES, 1.0, config.released_pressure_fraction)
    gait = Gait(CHAMBERS, phases, steps, feet)
    density = printed.cells.astype(np.float64)
    legs = [
        tip_angle_metric(config.leg_angle, np.append(d, 0), DOWN, star.root, name=f"leg_{k}")
        for k, d in enumerate(star.directions)
    ]
    pressure = shown.equilibrium.pressure
    # The design is known with all chambers full: the path leads from there to the cycle.
    fractions = [np.ones(len(CHAMBERS)), *gait.pressure_fractions]
    levels = [(pressure * fraction).tolist() for fraction in fractions]
    figures = {"chambers": CHAMBERS, "pressure_pa": pressure, "triangles": len(density)}
    points: list[TracePoint] = []
    try:
        path = trace(solver, density[skin.owned_cells], levels, legs, start[skin.owned_vertices])
        points.extend(path)
    except EquilibriumError as caught:  # raised by all ranks or by none
        figures["failure"] = str(caught)
    points = points[1:]
    if not points:
        return figures
    return write_gait(
        comm, output, gait, pattern, points, star.directions, star.root, printed.regions, figures,
        MEASURED_STRIDE if config.motion == "crawl" else None,
    )  # fmt: skip


def run(
    comm: MPI.Comm, output: Path | str, config: WalkerConfig | None = None, *, verbose: bool = False
) -> dict[str, Any]:
    """Design the walker and let it walk; return the summary, with the gait's under "gait".

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields, pictures and the gait's table.
        config: Numbers of this design; None takes the defaults.
        verbose: Whether to print every Newton step.
    """
    config = config or WalkerConfig()
    made = design_actuator(comm, output, case, config, verbose=verbose)
    if config.gait_steps is None:
        return made.summary
    return {**made.summary, "gait": walk(comm, Path(output), config, config.gait_steps, made)}


def sentence(summary: dict[str, Any]) -> str:
    """Return the result in words."""
    gait = summary.get("gait")
    walked = ""
    if gait and "failure" in gait:
        walked = f"; its gait ends after {gait.get('equilibria', 0)} equilibria: {gait['failure']}"
    elif gait:
        walked = f"; a stride of {gait['stride_mm']:.1f} mm"
    return summary_sentence(summary) + walked
