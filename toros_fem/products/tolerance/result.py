"""How objective, metrics and widths move where a skin is not made as drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from toros_fem.making.print.printability import Printability
from toros_fem.measures.figures import NONE
from toros_fem.measures.metrics import Metric

# What is off, and how it reads where it is less and where it is more.
WORDS = {
    "print width": ("a print {} too narrow", "a print {} too wide"),
    "fabric modulus": ("fabric {} too soft", "fabric {} too stiff"),
    "fabric thickness": ("fabric {} too thin", "fabric {} too thick"),
    "print modulus": ("a print {} too soft", "a print {} too stiff"),
    "print thickness": ("a print {} too thin", "a print {} too thick"),
    "pressure": ("a pressure {} too low", "a pressure {} too high"),
}
OBJECTIVE = "objective"


@dataclass(frozen=True, eq=False)
class Variant:
    """A skin of which one quantity is off.

    Attributes:
        quantity: What is off, a key of `WORDS`.
        change: By how much: a width in m, all else as a fraction.
        values: Objective and metrics by key, simulated; empty without an equilibrium.
        notes: What is not as usual, as sentences: lines that vanish or merge, another equilibrium.
        steps: Number of Newton steps.
        made: Lines and gaps of the print; None where it is as drawn.
        areas: Change of the printed area in m², of the polygons and of the mesh; None where the
            print is as drawn.
    """

    quantity: str
    change: float
    values: Mapping[str, float]
    notes: tuple[str, ...] = ()
    steps: int = 0
    made: Printability | None = None
    areas: tuple[float, float] | None = None

    @property
    def amount(self) -> str:
        """Size of the change without its sign, such as "0.1 mm" or "20 %"."""
        size = abs(self.change)
        return f"{1e3 * size:g} mm" if self.quantity == "print width" else f"{100 * size:g} %"

    @property
    def label(self) -> str:
        """Change with its sign, such as "+0.1 mm"."""
        return f"{'−' if self.change < 0 else '+'}{self.amount}"

    @property
    def words(self) -> str:
        """The change in words, such as "a print 0.1 mm too narrow"."""
        return WORDS[self.quantity][self.change > 0].format(self.amount)


@dataclass(frozen=True, eq=False)
class ToleranceResult:
    """What a skin does that is not made as drawn.

    Attributes:
        metrics: Numbers that the design is judged by, the most important first.
        nominal: Objective and metrics by key as drawn, on the mesh along the print.
        own_mesh: Metrics by key on the mesh of the design; empty if not known.
        drawn: Lines and gaps of the print as drawn.
        pressure: Pressure in Pa.
        variants: All variants, by quantity and change.
        triangles: Number of triangles of the mesh.
        steps: Number of Newton steps as drawn, and of all variants together.
        seconds: Wall time as drawn, on its mesh, and of all variants together.
    """

    metrics: tuple[Metric, ...]
    nominal: Mapping[str, float]
    own_mesh: Mapping[str, float]
    drawn: Printability
    pressure: float
    variants: tuple[Variant, ...]
    triangles: int
    steps: tuple[int, int]
    seconds: tuple[float, float]

    def change(self, variant: Variant, key: str) -> float | None:
        """Return by how much a metric, or the objective, moves; None without an equilibrium."""
        found = variant.values.get(key)
        return None if found is None else found - self.nominal[key]

    def worst(self, key: str) -> Variant | None:
        """Return the variant that moves a metric most: one without an equilibrium before all."""
        failed = [v for v in self.variants if not v.values]
        if failed:
            return failed[0]
        nominal = self.nominal[key]
        return max(self.variants, key=lambda v: abs(v.values[key] - nominal), default=None)

    def sentence(self, variant: Variant, metric: Metric) -> str:
        """Return what a variant does to a metric, such as "… costs 4° of the angle"."""
        words = variant.words[:1].upper() + variant.words[1:]
        if not variant.values:
            return f"{words} has no equilibrium: {' '.join(variant.notes)}"
        before, after = self.nominal[metric.key], variant.values[metric.key]
        change = after - before
        what = f"changes the {metric.name} by {metric.formatted(change, 2, sign=True)}"
        if metric.target is not None and abs(after) < abs(before) <= abs(metric.target):
            what = f"costs {metric.formatted(abs(change), 2)} of the {metric.name}"
        return (
            f"{words} {what}: {metric.formatted(before, 4)} becomes {metric.formatted(after, 4)}."
        )

    @property
    def worst_of_each(self) -> list[tuple[Metric, Variant]]:
        """The variant that moves each metric most; empty without variants."""
        found = [(metric, self.worst(metric.key)) for metric in self.metrics]
        return [(metric, variant) for metric, variant in found if variant is not None]

    @property
    def worst_sentences(self) -> list[str]:
        """What moves each metric most, as sentences."""
        return list(dict.fromkeys(self.sentence(v, metric) for metric, v in self.worst_of_each))

    def report(self) -> str:
        """Return what a reader is told: as drawn, a table of all variants, the worst of them."""
        drawn, own = (
            ", ".join(f"{m.name} {m.formatted(v[m.key], 4)}" for m in self.metrics if m.key in v)
            for v in (self.nominal, self.own_mesh)
        )
        ways = zip(("line", "gap"), _thinnest(self.drawn).values(), strict=True)
        thinnest = [f"{name} {way:.2f} mm" for name, way in ways if way is not None]
        rows = [["", "", *(m.name for m in self.metrics), "objective", "line, gap (mm)"]]
        lines = [
            f"As drawn: {drawn} at {self.pressure / 1e3:.2f} kPa, {self.triangles} triangles that "
            f"follow the print; on the mesh of the design {own}.",
            *([f"Thinnest {', '.join(thinnest)}."] if thinnest else []),
            "Changes as simulated:",
            *_aligned([*rows, *map(self._cells, self.variants)]),
            *(f"{v.words}: {note}" for v in self.variants for note in v.notes),
            *self.worst_sentences,
            f"{self.seconds[0]:.1f} s and {self.steps[0]} Newton steps as drawn, "
            f"{self.seconds[1]:.1f} s and {self.steps[1]} for {len(self.variants)} variants",
        ]
        return "\n".join(lines)

    def _cells(self, v: Variant) -> list[str]:
        """Return the cells of a variant in the table of the report."""
        changes = [m.formatted(self.change(v, m.key), sign=True) for m in self.metrics]
        change = self.change(v, OBJECTIVE)
        objective = NONE if change is None else f"{change:+.2e}".replace("-", "−")
        ways = [] if v.made is None else _thinnest(v.made).values()
        made = ", ".join(NONE if way is None else f"{way:.2f}" for way in ways)
        return [v.quantity, v.label, *changes, objective, made]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each variant, as tables have them."""
        found = []
        for v in self.variants:
            row: dict[str, Any] = {"quantity": v.quantity, "change": v.label}
            for key in self.nominal:
                row[key] = v.values.get(key)
                row[f"{key}_change"] = self.change(v, key)
            found.append(row | _thinnest(v.made) | {"newton_steps": v.steps})
        return found

    def summary(self) -> dict[str, Any]:
        """Return all figures as plain numbers; keys end in their units."""
        rows = self.rows()
        for row, v in zip(rows, self.variants, strict=True):
            row["relative" if v.quantity != "print width" else "change_m"] = v.change
            row["words"], row["notes"] = v.words, list(v.notes)
            if v.areas is not None:
                polygons, mesh = v.areas
                row["printed_area_change_mm2"] = {"polygons": 1e6 * polygons, "mesh": 1e6 * mesh}
        return {
            "pressure_pa": self.pressure,
            "nominal": dict(self.nominal),
            "own_mesh": dict(self.own_mesh),
            "targets": {m.key: m.target for m in self.metrics},
            **_thinnest(self.drawn),
            "variants": rows,
            "worst": {
                metric.key: {
                    "quantity": v.quantity,
                    "change": v.label,
                    "value_change": self.change(v, metric.key),
                    "sentence": self.sentence(v, metric),
                }
                for metric, v in self.worst_of_each
            },
            "triangles": self.triangles,
            "newton_steps": {"nominal": self.steps[0], "variants": self.steps[1]},
            "seconds": {"nominal": self.seconds[0], "variants": self.seconds[1]},
        }


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, the first two columns to the left and others to the right."""
    columns = []
    for k, column in enumerate(zip(*rows, strict=True)):
        width = max(map(len, column))
        columns.append([cell.ljust(width) if k < 2 else cell.rjust(width) for cell in column])
    return ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]


def _thinnest(made: Printability | None) -> dict[str, float | None]:
    """Return the thinnest line and gap in mm; None where there is none, or no other print."""
    found = {} if made is None else made.summary()
    return {key: found.get(key) for key in ("smallest_width_mm", "smallest_gap_mm")}
