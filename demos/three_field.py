"""Effect of each part of the three-field scheme (paper Figs. 4, 5): six bending tubes.

    python demos/three_field.py --coarse

Six variants have the same case, start and largest number of steps: densities as they are; filtered
only; with projection; with constraints on the widths of lines and gaps; with a penalty on the
perimeter; with both. Each design is thresholded at eta and simulated again as it would be printed,
since only the print shows what a variant is worth.

Densities as they are stand for plain SIMP. Its exponent is 1, as in eqs. (2, 3): nothing limits the
amount of print, so another exponent p has the same designs, with ρ^(1/p) in place of ρ.

The demo writes a table, `three_field.json`, a strip of all prints, `three_field.png`, the fields ρ,
ρ̃, ρ̄ of all variants, `fig4.png`, and the prints without and with the perimeter, `fig5.png`.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.files import guarded, if_plotting, write_json
from toros_fem.base.validation import Floats
from toros_fem.design.loop.case import Case
from toros_fem.meshes import Pattern, bend
from toros_fem.products.actuators.scene import Level
from toros_fem.products.common.tables import DesignTable, ResultTable
from toros_fem.products.tubes import BendTarget, TubeScene, bend_metric
from toros_fem.results.result import PrintedResult
from toros_fem.results.runs.open_run import open_run

# β of almost 0 makes the projection the identity.
PLAIN = 1e-3
# So does a filter radius below the distance of centroids, over the edge length, with the filter.
UNFILTERED = 0.2
# Variants side by side in the picture of their fields.
IN_A_ROW = 3
# Variants that differ by the perimeter alone, in pairs.
WITHOUT_AND_WITH = ("projection", "perimeter", "widths", "widths and perimeter")


class ThreeFieldScene(TubeScene):
    """The six bending tubes.

    The bare variants are compared, after the same steps on one mesh and without corrections. The
    weight of the perimeter is that of the variants that have it.
    """

    target: BendTarget = BendTarget()
    design: DesignTable = DesignTable(
        levels=1, polish_iterations=0, corrections=0, perimeter_weight=1e-4
    )
    results: ResultTable = ResultTable(curve_pressure=None)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked = self.target
        deform = bend(np.radians(asked.angle), self.skin.length, neutral=asked.neutral)
        return self.tube_case(comm, level, deform, [bend_metric(asked.angle)])


def variants(config: ThreeFieldScene) -> dict[str, ThreeFieldScene]:
    """Return the configuration of each variant; all may take the same number of steps.

    Raises:
        ParameterError: There is no weight for the perimeter.
    """
    if config.design.perimeter_weight is None:
        raise ParameterError(
            "perimeter_weight = None leaves the perimeter out, but two variants need it. Give a "
            "number above 0."
        )
    steps = config.design.iterations + config.design.constrained_iterations
    free = config.updated(iterations=steps, constrained_iterations=0)
    linear = free.updated(perimeter_weight=None, beta=PLAIN, power=1.0)
    return {
        "no filter": linear.updated(filter_radius=UNFILTERED * config.skin.edge_length),
        "filter only": linear,
        "projection": free.updated(perimeter_weight=None),
        "widths": config.updated(perimeter_weight=None),
        "perimeter": free,
        "widths and perimeter": config,
    }


def run(
    comm: MPI.Comm,
    output: Path | str,
    config: ThreeFieldScene | None = None,
    *,
    overwrite: bool = False,
) -> None:
    """Design all variants and write table and picture strip.

    Args:
        comm: Communicator.
        output: Folder for table and picture strip, and a folder for each variant.
        config: Numbers of this comparison; None takes the defaults.
        overwrite: Whether runs in these folders are replaced.
    """
    output, config = Path(output), config or ThreeFieldScene()
    rows: list[dict[str, Any]] = []
    prints, fields = [], []
    for name, variant in variants(config).items():
        if comm.rank == 0:
            print(f"\n{name}", flush=True)
        folder = output / name.replace(" ", "_")
        with (
            warnings.catch_warnings(),
            open_run(comm, folder, variant.as_dict(), overwrite=overwrite),
        ):
            # The radius of the first variant is too small on purpose.
            warnings.filterwarnings("ignore", "filter radius", UserWarning)
            made = variant.run_design(comm, folder)
        rows.append(row(name, made))
        pattern, printed, design = made.problem.whole.pattern, made.printed, made.design
        wall = printed.contours[pattern.panel_index("wall")]
        prints.append((name, wall, caption(rows[-1])))
        final, gather = design.final, made.problem.skin.gather_cells
        densities = {"ρ": final.density, "ρ̃": final.filtered, "ρ̄": final.projected}
        fields.append((name, {key: gather(values) for key, values in densities.items()}))
    if comm.rank == 0:
        print("\n" + table(rows))
    content = {"rows": rows, "inputs": config.as_dict()}

    def draw() -> None:
        named = {name: (name, *rest) for name, *rest in prints}
        draw_prints(output / "three_field.png", pattern, prints)
        chosen = [named[name] for name in WITHOUT_AND_WITH]
        draw_prints(output / "fig5.png", pattern, chosen, border_told(rows))
        draw_fields(output / "fig4.png", pattern, fields, grey_told(rows))

    def write() -> None:
        write_json(output / "three_field.json", content)
        if_plotting(draw)

    guarded(comm, output, write)


def border_told(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how long the borders are without and with the perimeter term."""
    without, term = ({r["variant"]: r["border_mm"] / 1e3 for r in rows}[name]
                     for name in WITHOUT_AND_WITH[:2])  # fmt: skip
    return f"{without:.2f} m of border without the perimeter term, {term:.2f} m with it"


def grey_told(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how grey the designs are."""
    grey = {r["variant"]: r["grey_level"] for r in rows}
    return (
        f"Grey level {grey['no filter']:.2f} without a filter, {grey['filter only']:.2f} with it, "
        f"{grey['projection']:.2f} with the projection"
    )


def draw_prints(
    path: Path, pattern: Pattern, prints: Sequence[tuple[str, BaseGeometry, str]], title: str = ""
) -> None:
    """Draw the print of each variant on the wall, with its name above and a caption below."""
    from toros_fem.results.pictures.style import DARK, EDGE, FABRIC, SOFT, fill, page

    outline, width = pattern.outline(pattern.panel_index("wall")), 0.98 / len(prints)
    left, bottom, right, top = outline.bounds
    # In inches: the wall in its shape, a title and names above, and a caption below.
    wall, foot = 8 * 0.92 * width * (top - bottom) / (right - left), 1.1
    head = 0.7 if title else 0.35
    height = wall + head + foot
    with page(path, title, (8.0, height)) as figure:
        for k, (name, region, words) in enumerate(prints):
            box = (0.01 + (k + 0.04) * width, foot / height, 0.92 * width, wall / height)
            axes = figure.add_axes(box)
            axes.set_axis_off()
            fill(axes, outline, FABRIC, EDGE)
            fill(axes, region, DARK)
            axes.set(aspect="equal", xlim=(1e3 * left, 1e3 * right), ylim=(1e3 * bottom, 1e3 * top))
            axes.set_title(name, pad=5)
            figure.text(0.01 + (k + 0.5) * width, (foot - 0.08) / height, words, fontsize=8,
                        color=SOFT, ha="center", va="top", linespacing=1.4)  # fmt: skip


def draw_fields(
    path: Path,
    pattern: Pattern,
    designs: Sequence[tuple[str, Mapping[str, Floats]]],
    title: str = "",
) -> None:
    """Draw the density fields of each design on the wall, from white (0) to black (1)."""
    from toros_fem.results.pictures.style import SOFT, page

    cells = pattern.cells_of("wall")
    left, bottom, right, top = pattern.outline(pattern.panel_index("wall")).bounds
    columns = len(designs[0][1]) * IN_A_ROW
    down = -(-len(designs) // IN_A_ROW)
    width, head = 0.98 / columns, 0.55
    wall = 8 * 0.90 * width * (top - bottom) / (right - left)
    height = 0.35 + down * (wall + head) + 0.1
    with page(path, title, (8.0, height)) as figure:
        for k, (name, fields) in enumerate(designs):
            start = 0.01 + (k % IN_A_ROW) * len(fields) * width
            low = height - 0.35 - (k // IN_A_ROW + 1) * (wall + head)
            middle = start + len(fields) * width / 2
            figure.text(middle, (low + wall + 0.26) / height, name, ha="center")
            for i, (field, values) in enumerate(fields.items()):
                box = (start + (i + 0.05) * width, low / height, 0.90 * width, wall / height)
                axes = figure.add_axes(box)
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set(visible=True, color=SOFT, linewidth=0.5)
                axes.set_title(field, pad=3)
                axes.tripcolor(
                    *(1e3 * pattern.flat_points.T), pattern.flat_triangles[cells],
                    facecolors=values[cells], cmap="gray_r", vmin=0, vmax=1,
                )  # fmt: skip
                axes.set(aspect="equal", xlim=(1e3 * left, 1e3 * right),
                         ylim=(1e3 * bottom, 1e3 * top))  # fmt: skip


def row(name: str, found: PrintedResult) -> dict[str, Any]:
    """Return the figures of one variant; widths, islands and border are of the bare contours."""
    made, last = found.printed.before.summary(), found.design.history[-1]
    simulated = found.printed.evaluation
    return {
        "variant": name,
        "shape_designed": last.shape,
        "shape_printed": None if simulated is None else simulated.shape,
        "angle_designed_deg": last.metrics["angle_deg"],
        "angle_printed_deg": found.metrics.get("angle_deg"),
        "pressure_pa": found.design.final.equilibrium.pressure,
        "grey_level": last.grey_level,
        "islands": made["islands"],
        "pieces": made["pieces"],
        "holes": made["holes"],
        "smallest_width_mm": made["smallest_width_mm"],
        "smallest_gap_mm": made["smallest_gap_mm"],
        "border_mm": made["border_mm"],
        "iterations": last.iteration,
        "seconds": found.seconds["total"],
    }


def number(value: float | None, form: str = ".2f") -> str:
    """Return a number as text, "-" for None."""
    return "-" if value is None else f"{value:{form}}"


def caption(r: dict[str, Any]) -> str:
    """Return the caption of a picture."""
    return (
        f"T {r['shape_designed']:.1e} → {number(r['shape_printed'], '.1e')}\n"
        f"{r['angle_designed_deg']:.0f}° → {number(r['angle_printed_deg'], '.0f')}° printed\n"
        f"grey {r['grey_level']:.3f}\nislands {r['islands']}\n"
        f"line ≥ {number(r['smallest_width_mm'])} mm\nborder {r['border_mm'] / 1e3:.2f} m"
    )


def table(rows: list[dict[str, Any]]) -> str:
    """Return all variants as lines of text."""
    lines = [
        "variant                T designed  T printed  angle  printed  grey   islands  line/mm"
        "  gap/mm  border/m  kPa"
    ]
    lines += [
        f"{r['variant']:21s}  {r['shape_designed']:10.2e}  {number(r['shape_printed'], '.2e'):>9s}"
        f"  {r['angle_designed_deg']:5.1f}  {number(r['angle_printed_deg'], '.1f'):>7s}"
        f"  {r['grey_level']:5.3f}"
        f"  {r['islands']:7d}  {number(r['smallest_width_mm']):>7s}"
        f"  {number(r['smallest_gap_mm']):>6s}  {r['border_mm'] / 1e3:8.2f}"
        f"  {r['pressure_pa'] / 1e3:4.1f}"
        for r in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Compare six designs of a bending tube.")
    parser.add_argument("--coarse", action="store_true", help="a coarse mesh and few steps")
    parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
    parser.add_argument(
        "--output", type=Path, default=Path("output/three_field"), help="folder of the files"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
    given = parser.parse_args()
    scene = ThreeFieldScene().coarse() if given.coarse else ThreeFieldScene()
    run(MPI.COMM_WORLD, given.output, scene.updated(seed=given.seed), overwrite=given.overwrite)
