"""The benchmark `stability`: the matrix, random scenes, contact, and the tables of their pages.

The exit code is 1 if a result is wrong, if a case that has a solution failed, or if something is
penetrated. All cells of the matrix take an hour of one core or more; `--cases 500` draws some.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import groupby

import numpy as np

from benchmarks.bench import (
    IN_ALL,
    Case,
    Command,
    Row,
    Rows,
    Table,
    markdown,
    values_of,
)
from benchmarks.stability import drawn, matrix
from benchmarks.stability.matrix import BUILDERS, CONTRASTS, Cell

VERDICTS = ("converged", "error right", "failed", "wrong")
# What there are hundreds of, and how it may end.
COUNTED = {
    "matrix": VERDICTS,
    "random": drawn.OUTCOMES,
    "random with contact": drawn.WITH_CONTACT,
}
STEPS = ("steps: median", "95 %", "most")
# Cells and seeds that the page names, besides those that did not end in an equilibrium.
MOST = 10
RANDOM, CONTACTS = range(5000), range(200)


def cases(quick: bool) -> list[Case]:
    """Return all cases; a quick selection has 60 cells, three seeds of each kind, coarse meshes."""
    from benchmarks.stability import contact

    cells = matrix.quick_matrix if quick else matrix.full_matrix
    found = [
        Case("matrix", partial(matrix.rows_of, cell), cell.label)
        for scene in BUILDERS
        for cell in cells(scene)
    ]
    for name, seeds, play in (
        ("random", RANDOM, drawn.outcome_of),
        ("random with contact", CONTACTS, contact.drawn_with_contact),
    ):
        found += [
            Case(name, partial(_random, name, seed, play), f"seed {seed}")
            for seed in (seeds[11:14] if quick else seeds)
        ]
    for name, (_, lengths) in contact.SCENES.items():
        run = partial(_scenes, name, lengths[:1] if quick else lengths)
        found.append(Case("contact", run, name))
    for coarse in (True,) if quick else (True, False):
        for name in ("gripper", "walker"):
            iterations = 4 if quick else 20
            steps = partial(contact.design_rows, name, coarse=coarse, iterations=iterations)
            size = "coarse" if coarse else "default mesh"
            found.append(Case("design in contact", steps, f"{name}, {size}"))
    return found


def cell_of(label: str) -> Cell:
    """Return the cell of a label."""
    scene, design, contrast, load, _, start = label.split()
    return Cell(scene, design, float(contrast[1:]), float(load), start)


def _random(name: str, seed: int, play: Callable[[int], drawn.Outcome]) -> list[Row]:
    found = play(seed)
    variant = f"seed {seed}"
    return [
        Row(name, variant, found.shape, found.outcome, float(found.steps), "steps",
            seconds=found.seconds, note=found.why),
        Row(name, variant, found.shape, "pairs", float(found.pairs)),
    ]  # fmt: skip


def _scenes(name: str, lengths: tuple[float, ...]) -> Iterator[Row]:
    from benchmarks.stability import contact

    for edge_length in lengths:
        yield from contact.scene_rows(name, edge_length)


def condense(rows: Rows) -> list[Row]:
    """Count what there are hundreds of; keep what did not end well, and what took most steps."""
    found: list[Row] = []
    for name, group in groupby(rows, lambda row: row.case):
        own = list(group)
        outcomes = COUNTED.get(name)
        counted = any(row.case == f"{name}{IN_ALL}" for row in rows)
        if outcomes is None or counted:
            found += own
            continue
        ends = [row for row in own if row.figure in outcomes]
        bad = [row for row in ends if row.figure not in ("converged", "equilibrium", "refused")]
        most = sorted(ends, key=lambda row: -(row.value or 0))[:MOST] if name == "matrix" else []
        found += [*bad, *(row for row in most if row not in bad)]
        pairs = {row.variant: row.value or 0 for row in own if row.figure == "pairs"}
        for variant, part in _groups(name, ends):
            found += _counts(name, variant, part, outcomes, pairs)
    return found


def _groups(name: str, rows: Rows) -> Iterator[tuple[str, Rows]]:
    if name == "matrix":
        for scene in BUILDERS:
            yield scene, [row for row in rows if row.variant.split()[0] == scene]
        for contrast in CONTRASTS:
            yield (
                f"contrast {contrast:g}",
                [row for row in rows if cell_of(row.variant).contrast == contrast],
            )
    else:
        for shape in drawn.SHAPES:
            yield shape, [row for row in rows if row.size == shape]
    yield "all", rows


def _counts(
    name: str, variant: str, rows: Rows, outcomes: tuple[str, ...], pairs: dict[str, float]
) -> Iterator[Row]:
    if not rows:
        return
    place, last = (f"{name}{IN_ALL}", variant, ""), rows[-1]
    counts = Counter(row.figure for row in rows)
    # Of scenes the steps of those that are solved, of cells those of all solves.
    solved = [r.value or 0 for r in rows if name == "matrix" or r.figure == "equilibrium"] or [0]
    figures = {"cases": len(rows)} | {outcome: counts[outcome] for outcome in outcomes}
    if "contact" in name:
        figures["in contact"] = sum(pairs.get(row.variant, 0) > 0 for row in rows)
    for figure, quantile in zip(STEPS, (0.5, 0.95, 1), strict=True):
        figures[figure] = round(float(np.quantile(solved, quantile)))
    for figure, value in figures.items():
        yield Row(*place, figure, float(value), machine=last.machine, measured=last.measured)


def _table(rows: Rows, name: str, *columns: str, without: Collection[str] = ()) -> str:
    found = {
        key[1]: figures
        for key, figures in values_of(rows, f"{name}{IN_ALL}").items()
        if key[1] not in without
    }
    lines = [
        (variant, *(f"{figures[column]:.0f}" for column in columns))
        for variant, figures in found.items()
    ]
    return markdown(("", *columns), lines)


def _listed(rows: Rows, name: str, figure: str) -> str:
    lines = [
        f"- {row.variant}{f', {row.size}' if row.size else ''}, {row.value:.0f} steps: {row.note}"
        for row in rows
        if row.case == name and row.figure == figure
    ]
    return "\n".join([f"\n\n{figure.capitalize()}:\n", *lines]) if lines else ""


def matrix_table(rows: Rows) -> str:
    """Return counts by contrast, and the cells that contradict the solver."""
    every = sum(len(matrix.full_matrix(scene)) for scene in BUILDERS)
    (played,) = (r.value for r in rows if r.case == f"matrix{IN_ALL}"
                 and r.variant == "all" and r.figure == "cases")  # fmt: skip
    text = f"{played:.0f} of {every} cells were run, drawn at random if not all.\n\n"
    text += _table(rows, "matrix", "cases", *VERDICTS, *STEPS, without=BUILDERS)
    text += "\n\nSteps are those of all solves of a cell."
    return text + "".join(_listed(rows, "matrix", verdict) for verdict in ("wrong", "failed"))


def random_table(rows: Rows) -> str:
    """Return outcomes and Newton steps by shape, and the scenes that contradict the solver."""
    text = "`refused`: a typed error before anything is solved. `no equilibrium`: an error of the "
    text += "solver that the reference solver does not contradict.\n\n"
    text += _table(rows, "random", "cases", *drawn.OUTCOMES, *STEPS)
    return text + "".join(_listed(rows, "random", outcome) for outcome in ("wrong", "failed"))


def random_contact_table(rows: Rows) -> str:
    """Return outcomes of random scenes beside a floor and balls."""
    columns = ("cases", "in contact", *drawn.WITH_CONTACT, STEPS[0], STEPS[2])
    return _table(rows, "random with contact", *columns)


def cost_table(rows: Rows) -> str:
    """Return what contact costs a cold solve."""
    lines = []
    for (_, scene, triangles), of in values_of(rows, "contact").items():
        value = {figure: number or 0.0 for figure, number in of.items()}
        spent = [value[f"seconds {way}"] for way in ("without", "with")]
        lines.append((
            scene, triangles, f"{value['pairs']:.0f}",
            f"{value['steps without']:.0f}, {value['steps with']:.0f}",
            f"{spent[0]:.1f}, {spent[1]:.1f}", f"{spent[1] / spent[0]:.1f}",
            f"{1e3 * value['smallest distance']:.3f} mm",
            "yes" if value["crosses without"] else "no",
        ))  # fmt: skip
    head = ("scene", "triangles", "pairs", "steps without, with", "seconds without, with", "ratio",
            "smallest distance", "crosses without")  # fmt: skip
    return markdown(head, lines)


def design_table(rows: Rows) -> str:
    """Return what contact costs an iteration of a design."""
    lines = []
    for (_, name, triangles), of in values_of(rows, "design in contact").items():
        steps, seconds, median = (
            [of[f"{figure} {way}"] or 0.0 for way in ("without", "with")]
            for figure in ("steps", "seconds", "median")
        )
        lines.append((
            name, triangles, f"{steps[0]:.1f}, {steps[1]:.1f}",
            f"{seconds[0]:.2f}, {seconds[1]:.2f}",
            f"{seconds[1] / seconds[0]:.2f}, {median[1] / median[0]:.2f}",
        ))  # fmt: skip
    head = ("design", "triangles", "Newton steps an iteration without, with",
            "seconds without, with", "ratio, of the medians")  # fmt: skip
    return markdown(head, lines)


def bad(row: Row) -> bool:
    """Return whether a row contradicts the solver."""
    crossed = row.figure == "crosses with" and row.value != 0
    return row.figure in ("wrong", "failed", "penetrated") or crossed


COMMAND = Command(
    about=__doc__,
    cases=cases,
    condense=condense,
    bad=bad,
    serial=True,
    tables=(
        Table("stability.md", "the matrix", matrix_table),
        Table("stability.md", "random scenes", random_table),
        Table("contact.md", "cost of contact", cost_table),
        Table("contact.md", "design steps with contact", design_table),
        Table("contact.md", "random contacts", random_contact_table),
    ),
)
