"""A short tube with a print that bends and twists it."""

import numpy as np
import shapely
from mpi4py import MPI

import toros_fem as tf
from toros_fem.making.as_printed import PrintedDesign

LENGTH = 0.06
# Slanted ribs on a spine, in m on the wall.
RIBS = shapely.union_all(
    [
        shapely.box(0.027, 0.004, 0.032, 0.056),
        *[
            shapely.Polygon([(8e-3, y), (8e-3, y + 5e-3), (54e-3, y + 11e-3), (54e-3, y + 6e-3)])
            for y in (0.006, 0.022, 0.038)
        ],
    ]
)
Printed = tuple[tf.ShapeDesign, PrintedDesign]


def printed_tube(comm: MPI.Comm, edge: float = 4e-3) -> Printed:
    """The problem and its print, simulated."""
    pattern = tf.meshes.cylinder(comm, LENGTH, 0.02, edge)

    def angle(pattern: tf.meshes.Pattern, positions: np.ndarray) -> float:
        return float(np.degrees(tf.bend_angle(pattern, positions, sections=4)))

    case = tf.Case(
        pattern,
        target=tf.meshes.bend(np.pi / 3, LENGTH, neutral=0.01),
        supports=tf.clamp(pattern, ["base"]),
        pressure=4e3,
        printed_panels=["base", "tip"],
        metrics=[
            tf.Metric("angle", "deg", 60.0, angle),
            tf.Metric("length", "ratio", None, tf.length_ratio),
        ],
    )
    problem = tf.ShapeDesign(comm, case, tf.Regularisation(8e-3, length_scale=None))
    regions = [
        RIBS if name == "wall" else shapely.box(-1, -1, 1, 1) for name in pattern.panel_names
    ]
    outlines = [
        shapely.coverage_union_all(shapely.polygons(pattern.corners[pattern.panel == k]))
        for k in range(len(regions))
    ]
    regions = [a & b for a, b in zip(regions, outlines, strict=True)]
    made = tf.printed_lines(problem, pattern, regions)
    on = made.evaluation.problem
    assert isinstance(on, tf.ShapeDesign)
    return on, made
