"""The report of `stability.py`: tables, a picture, JSON."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import dolfinx
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from petsc4py import PETSc
from stability_scenes import BUILDERS, DESIGNS, PRESSURES

import toros_fem
from toros_fem.materials.sheet import Bending

VERDICTS = ("converged", "error right", "failed", "wrong")
MANY_STEPS = 60
ALL_CASES = 5896
MARKERS = {"error right": ("o", "0.35"), "failed": ("X", "tab:red"), "wrong": ("D", "magenta")}


@dataclass(frozen=True)
class Case:
    """One cell of the matrix."""

    scene: str
    design: str
    contrast: float
    load: float
    start: str

    def label(self) -> str:
        """The case in one line."""
        return f"{self.scene} {self.design} x{self.contrast:g} {self.load:g} Pa {self.start}"


@dataclass(frozen=True)
class Request:
    """Design and load of one solve of a case.

    Attributes:
        scene, design, contrast: As of the case.
        load: Pressure in Pa.
        neighbour: Whether the neighbouring design was asked for.
        variation: Fraction of the design's variation about its mean.
    """

    scene: str
    design: str
    contrast: float
    load: float
    neighbour: bool = False
    variation: float = 1.0

    def label(self) -> str:
        """The request in one line."""
        near = " neighbour" if self.neighbour else ""
        part = "" if self.variation == 1 else f" of {self.variation:g} of its variation"
        return f"{self.scene} {self.design}{near}{part} x{self.contrast:g} {self.load:.6g} Pa"


@dataclass
class Row:
    """One case as it goes into the JSON file."""

    scene: str
    design: str
    contrast: float
    load: float
    start: str
    result: str
    reason: str
    newton_steps: int
    residual: float | None
    min_pivot_sign: int | None
    seconds: float

    @property
    def case(self) -> Case:
        """The cell of the matrix."""
        return Case(self.scene, self.design, self.contrast, self.load, self.start)

    @property
    def request(self) -> Request:
        """What the case asks for in the end."""
        return Request(self.scene, self.design, self.contrast, self.load)

    def label(self) -> str:
        """The case in one line."""
        return self.case.label()


@dataclass
class CaseResult:
    """A row and what is to be thought of it.

    Attributes:
        row: The row.
        verdict: One of `VERDICTS`; until it is settled, "error".
        why: What is wrong, or who solved what failed.
        moved: After up and down, the distance of the shapes over the size.
        failed: The request that failed, which may lie on the way; None if none did.
    """

    row: Row
    verdict: str
    why: str
    moved: float | None
    failed: Request | None = None

    @classmethod
    def of(cls, kept: dict[str, Any]) -> CaseResult:
        """Return what `asdict` made a dictionary of."""
        failed = kept.get("failed")
        request = None if failed is None else Request(**failed)
        return cls(**{**kept, "row": Row(**kept["row"]), "failed": request})


class Report:
    """Gathers outcomes."""

    def __init__(self, outcomes: Sequence[CaseResult]) -> None:
        self._outcomes = list(outcomes)

    @staticmethod
    def count(outcomes: Sequence[CaseResult]) -> dict[str, int]:
        """Number of outcomes of each verdict."""
        counted = Counter(outcome.verdict for outcome in outcomes)
        return {verdict: counted[verdict] for verdict in VERDICTS}

    @property
    def wrong(self) -> int:
        """Number of cases whose result is wrong."""
        return self.count(self._outcomes)["wrong"]

    @property
    def failed(self) -> int:
        """Number of cases that failed although they have a solution."""
        return self.count(self._outcomes)["failed"]

    def print_tables(self) -> None:
        """Counts by scene and design, then the cases that need a look."""
        print(
            "\nscene           design        cases  converged  right  failed  wrong"
            "   steps: median  max   slowest"
        )
        for scene in BUILDERS:
            for design in DESIGNS:
                group = self._of(scene, design)
                if not group:
                    continue
                counts = self.count(group)
                steps = [outcome.row.newton_steps for outcome in group]
                slowest = max(outcome.row.seconds for outcome in group)
                print(
                    f"{scene:15} {design:12} {len(group):6d} {counts['converged']:10d} "
                    f"{counts['error right']:6d} {counts['failed']:7d} {counts['wrong']:6d} "
                    f"{np.median(steps):15.0f} {max(steps):4d} {slowest:7.1f} s"
                )
        for verdict in ("wrong", "failed", "error right"):
            for outcome in self._outcomes:
                if outcome.verdict == verdict:
                    row = outcome.row
                    print(
                        f"{verdict.upper()}: {row.label()}, {row.newton_steps} steps: {row.reason}"
                    )
                    if verdict == "wrong":
                        print(f"    {outcome.why}")
        many = [o for o in self._outcomes if o.row.newton_steps > MANY_STEPS]
        for title, chosen in (
            (f"most Newton steps ({len(many)} cases with more than {MANY_STEPS})",
             sorted(many, key=lambda o: -o.row.newton_steps)[:15]),
            ("slowest", self._slowest(10)),
            ("furthest from where they were, after up and down", self._moved()[:10]),
        ):  # fmt: skip
            print(f"\n{title}:")
            for outcome in chosen:
                row, moved = outcome.row, outcome.moved
                away = "" if moved is None else f", moved by {moved:.1e}"
                print(f"    {row.label()}: {row.newton_steps} steps, {row.seconds:.1f} s{away}")
        total = sum(outcome.row.seconds for outcome in self._outcomes)
        counts = self.count(self._outcomes)
        listed = ", ".join(f"{number} {verdict}" for verdict, number in counts.items())
        print(f"\n{len(self._outcomes)} cases in {total:.0f} s: {listed}")

    @classmethod
    def read(cls, path: Path) -> Report:
        """Return what `write` wrote."""
        content = json.loads(path.read_text(encoding="utf-8"))
        found = {finding["row"]: finding for finding in content["findings"]}
        moved = {entry["case"]: entry["distance_over_size"] for entry in content["up_and_down"]}
        outcomes = []
        for index, kept in enumerate(content["rows"]):
            row, finding = Row(**kept), found.get(index, {"verdict": "converged", "why": ""})
            away = moved.get(row.label())
            outcomes.append(CaseResult(row, finding["verdict"], finding["why"], away))
        return cls(outcomes)

    def write(self, path: Path) -> None:
        """Write what was counted, and all rows, a line each, as JSON."""
        content = {
            "wrong": self.wrong,
            "failed_although_solvable": self.failed,
            "bending": asdict(Bending()),
            "cases": len(self._outcomes),
            "verdicts": self.count(self._outcomes),
            "seconds": sum(outcome.row.seconds for outcome in self._outcomes),
            "findings": [
                {"row": index, "verdict": outcome.verdict, "why": outcome.why}
                for index, outcome in enumerate(self._outcomes)
                if outcome.verdict != "converged"
            ],
            "up_and_down": [
                {"case": outcome.row.label(), "distance_over_size": outcome.moved}
                for outcome in self._moved()
            ],
            "versions": {
                "toros_fem": toros_fem.__version__,
                "dolfinx": dolfinx.__version__,
                "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
                "python": platform.python_version(),
            },
        }
        head = json.dumps(content, indent=1, allow_nan=False).removesuffix("\n}")
        rows = ",\n".join(
            json.dumps(asdict(outcome.row), allow_nan=False) for outcome in self._outcomes
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{head},\n "rows": [\n{rows}\n]}}\n', encoding="utf-8")

    def markdown(self) -> str:
        """Return the tables of docs/stability.md: by scene and by contrast, and what to look at."""
        heads = ("cases", *VERDICTS, "steps: median", "95 %", "most")
        bending = Bending()
        lines = [
            f"{len(self._outcomes)} of {ALL_CASES} cases were run, drawn at random if not all, "
            f"with `{bending}`.",
            "",
            f"| | {' | '.join(heads)} |",
            "|---" * (len(heads) + 1) + "|",
        ]
        contrasts = sorted({outcome.row.contrast for outcome in self._outcomes})
        groups = {scene: [o for o in self._outcomes if o.row.scene == scene] for scene in BUILDERS}
        groups |= {
            f"contrast {contrast:g}": [o for o in self._outcomes if o.row.contrast == contrast]
            for contrast in contrasts
        }
        groups["all"] = self._outcomes
        for name, group in groups.items():
            if not group:
                continue
            steps = [outcome.row.newton_steps for outcome in group]
            cells = [len(group), *self.count(group).values()]
            cells += [round(float(np.quantile(steps, q))) for q in (0.5, 0.95, 1)]
            lines.append(f"| {name} | {' | '.join(map(str, cells))} |")
        lines += ["", "Steps are those of all solves of a case."]
        for verdict in ("wrong", "failed", "error right"):
            found = [o for o in self._outcomes if o.verdict == verdict]
            if found:
                lines += ["", f"{verdict.capitalize()}:", ""]
            lines += [f"- {o.row.label()}, {o.row.newton_steps} steps: {o.why}" for o in found]
        many = sorted(self._outcomes, key=lambda o: -o.row.newton_steps)[:10]
        lines += ["", "Most steps:", ""]
        lines += [f"- {o.row.label()}: {o.row.newton_steps} steps, {o.verdict}" for o in many]
        return "\n".join(lines)

    def draw(self, path: Path) -> None:
        """Heat map of the most Newton steps over contrasts and starts, by scene, design, load."""
        present = {outcome.row.scene for outcome in self._outcomes}
        scenes = [scene for scene in BUILDERS if scene in present]
        columns = len(DESIGNS) * len(PRESSURES)
        steps = np.full((len(scenes), columns), np.nan)
        spots: dict[str, list[tuple[float, int]]] = {verdict: [] for verdict in MARKERS}
        for row, scene in enumerate(scenes):
            for number, design in enumerate(DESIGNS):
                for place, load in enumerate((*PRESSURES, 0.0)):
                    group = [o for o in self._of(scene, design) if o.row.load == load]
                    if not group:
                        continue
                    first = number * len(PRESSURES)
                    # A tile has no pressure: its one value fills the columns of the design.
                    cells = [first + place] if load else range(first, first + len(PRESSURES))
                    played = [o.row.newton_steps for o in group if o.row.result != "exception"]
                    if played:
                        steps[row, cells] = max(1, *played)
                    verdicts = {outcome.verdict for outcome in group}
                    worst = [verdict for verdict in MARKERS if verdict in verdicts]
                    if worst:
                        spots[worst[-1]].append((float(np.mean(cells)), row))
        figure, axes = plt.subplots(figsize=(15, 1.8 + 0.36 * len(scenes)), layout="constrained")
        image = axes.imshow(
            steps, aspect="auto", cmap="viridis", norm=LogNorm(1, 1000), interpolation="none"
        )
        axes.set_facecolor("0.93")
        for verdict, (marker, colour) in MARKERS.items():
            places = np.array(spots[verdict]).reshape(-1, 2)
            axes.scatter(
                places[:, 0], places[:, 1], marker=marker, s=55, color=colour, edgecolor="white",
                linewidth=0.8, label=f"{verdict} ({self.count(self._outcomes)[verdict]})",
            )  # fmt: skip
        axes.set_yticks(range(len(scenes)), scenes)
        names = [f"{pressure / 1e3:g}" for pressure in PRESSURES]
        axes.set_xticks(range(columns), names * len(DESIGNS), fontsize=7)
        axes.set_xlabel("pressure in kPa (a tile has none: one value a design)")
        for number, design in enumerate(DESIGNS):
            middle = (number + 0.5) * len(PRESSURES) - 0.5
            axes.annotate(
                design, (middle, 1), (0, 4), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center",
            )  # fmt: skip
            axes.axvline((number + 1) * len(PRESSURES) - 0.5, color="white", linewidth=2.5)
        figure.colorbar(image, label="most Newton steps of a case", pad=0.01, extend="max")
        axes.legend(
            loc="upper left", bbox_to_anchor=(0, -0.6 / len(scenes)), ncols=3, frameon=False
        )
        figure.savefig(path, dpi=130)
        plt.close(figure)

    def _of(self, scene: str, design: str) -> list[CaseResult]:
        return [o for o in self._outcomes if (o.row.scene, o.row.design) == (scene, design)]

    def _slowest(self, count: int) -> list[CaseResult]:
        return sorted(self._outcomes, key=lambda o: -o.row.seconds)[:count]

    def _moved(self) -> list[CaseResult]:
        returned = [outcome for outcome in self._outcomes if outcome.moved is not None]
        return sorted(returned, key=lambda o: -(o.moved or 0.0))
