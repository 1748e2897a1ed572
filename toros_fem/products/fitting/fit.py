"""The fit of a material to tensile tests (`fit_material`), its result and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from itertools import cycle
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.files import guarded, if_plotting, replace_file, write_json, write_table
from toros_fem.base.validation import Floats, checked_list, require_kind
from toros_fem.materials.library.material import LENGTHS, LibraryMaterial
from toros_fem.materials.sheet import Knit, Material, Threads
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.origin import from_rest
from toros_fem.products.fitting.samples import (
    CONFIDENCE,
    NORMAL_MAD,
    Model,
    Problem,
    RobustFit,
    Samples,
    TensileTest,
    drawn_again,
    minimise,
    remembered,
    robust_fit,
    samples_of,
)
from toros_fem.products.fitting.uniaxial import (
    RubberScales,
    Scales,
    rubber_scales_of,
    scales_of,
    tension,
)

# Title and SI unit of each constant.
CONSTANTS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "young": ("Young's modulus E", "Pa"),
        "poisson": ("Poisson's ratio ν", ""),
        "mu": ("Lamé parameter μ", "Pa"),
        "lam": ("Lamé parameter λ", "Pa"),
        "c1": ("bound c₁ on a stretch", ""),
        "c2": ("bound c₂ on their sum", ""),
        "course_stiffness": ("courses: stiffness k", "N/m"),
        "course_strain": ("courses: strain s", ""),
        "wale_stiffness": ("wales: stiffness k", "N/m"),
        "wale_strain": ("wales: strain s", ""),
        "knit_ratio": ("ratio of the directions", ""),
        "second": ("Yeoh's C₂₀", "Pa"),
        "third": ("Yeoh's C₃₀", "Pa"),
    }
)
# A mean residual beyond this part of the stress there is a misfit; stresses count as this part of
# the largest at least.
MISFIT, FLOOR = 0.1, 0.3
# Parts of the range of stretch that the misfit is looked at in.
PARTS = 12
# A fit is in doubt below this R² of the stress, or where stresses of specimens differ by this part
LEAST_R2, SCATTER = 0.95, 0.25
# An interval of Poisson's ratio that is this wide tells nothing.
WIDE_POISSON = 0.35
FILES = ("fit.json", "fit.txt", "fit.csv", "fit.png")
COLOURS = ("#1F3A5F", "#D55E00", "#0072B2", "#6B7280")


def fit_material(tests: Sequence[TensileTest], options: FitOptions | None = None) -> FitResult:
    """Fit μ, λ, c₁ and c₂ of eq. (1) to tensile tests, or Yeoh's law of a rubber.

    The strip narrows freely: at each stretch the lateral one is solved for exactly. Residuals of
    stress and lateral stretch are weighted by their own spread. c₁ lies beyond the largest
    measured stretch, c₂ beyond the largest measured sum. Tests in two perpendicular directions
    ("course" and "wale", "x" and "y", "along" and "across", "warp" and "weft") are fitted together,
    by seven constants: E h, ν, c₂, and stiffness and strain of the `Threads` in each direction. The
    courses of this `Knit` run along the stiffer one. Tests in one direction are fitted as those of
    an isotropic sheet. Shear is not measured: it is that of the sheet. A rubber, by the `kind` of
    the options, is the same in all directions: E, C₂₀ and C₃₀ are those of a `Bladder`.

    Args:
        tests: Tests of one material.
        options: Kind of the material, branch, loss and intervals.

    Returns:
        The constants with 95 % intervals.

    Raises:
        FileError: There is no test, a test has too few points, thicknesses differ, or
            directions are not those of one fabric.
    """
    options = FitOptions() if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    return _Fit(tests, options).result()


def _thickness(tests: Sequence[TensileTest]) -> float:
    heights = [test.thickness for test in tests]
    thickness = float(np.mean(heights))
    if np.ptp(heights) > 0.5 * thickness:
        raise ParameterError(
            f"the thicknesses {min(heights):.4g} to {max(heights):.4g} m are not those of one "
            "material: fit them apart."
        )
    return thickness


class _Fit:
    """The fit of some tests."""

    def __init__(self, tests: Sequence[TensileTest], options: FitOptions) -> None:
        tests = checked_list("tests", tests, TensileTest, "TensileTests, at least one", least=1)
        begun = [from_rest(test, options) for test in tests]
        tests, self.spreads = [test for test, _ in begun], [spread for _, spread in begun]
        self.options, self.samples = options, samples_of(tests, options, whole=True)
        self.remarks = [text for test in tests for text in test.remarks]
        self.doubts = [text for test in tests for text in test.doubts]
        self.thickness = _thickness(tests)
        self.scales: Scales | RubberScales
        self._tension: Callable[..., tuple[Floats, Floats]]
        if options.kind == "rubber":
            self.scales = rubber_scales_of(self.samples)
            self._tension = self.scales.tension
        else:
            self.scales = scales_of(self.samples)
            courses = self.samples.along(self.scales.stiff)
            coefficients = partial(self.scales.coefficients, course=courses)
            self._tension = partial(tension, coefficients=coefficients)
        self.curve = remembered(partial(self._at, self.samples.strain))

    def problem(self, curve: Model) -> Problem:
        """Return the fit of a model curve to the tests."""
        return self.samples.problem(curve, self.scales.bounds, self.options.loss)

    def result(self) -> FitResult:
        """Return the constants with their intervals."""
        scales, options, problem = self.scales, self.options, self.problem(self.curve)
        solution = robust_fit(problem, scales.starts)
        drawn = drawn_again(problem, solution, self.samples, options.draws, options.seed)
        drawn = np.clip(drawn + self._moved(solution, len(drawn)), *scales.bounds)
        (stress, lateral), _ = self.curve(solution.theta)
        far, near = (scales.values(end, self.thickness) for end in scales.bounds)
        return FitResult(
            estimates=estimates_of(
                scales.values(solution.theta, self.thickness),
                scales.values(drawn.T, self.thickness),
                {
                    name: tuple(sorted((near[name], far[name])))
                    for name in ("c1", "c2", "course_strain", "wale_strain")
                    if name in near
                },
            ),
            samples=self.samples,
            stress=stress,
            lateral=lateral,
            options=options,
            thickness=self.thickness,
            far=scales.far,
            stiff=scales.stiff,
            taken=self.remarks,
            doubts=self.doubts,
        )

    def _moved(self, solution: RobustFit, draws: int) -> Floats:
        """Return by how much parameters move with the origins of the tests, (draws, p)."""
        rng, found = np.random.default_rng(self.options.seed + 1), np.zeros(len(solution.theta))
        moved = np.tile(found, (draws, 1))
        for number, spread in enumerate(self.spreads):
            if spread > 1e-5 * self.scales.strain:
                by = np.where(self.samples.test == number, spread, 0.0)
                strain = np.maximum(self.samples.strain - by, 1e-9)
                curve = remembered(partial(self._at, strain))
                theta, _ = minimise(self.problem(curve), solution.theta, solution.sigma)
                moved += np.outer(rng.standard_normal(draws), theta - solution.theta)
        return moved

    def _at(self, strain: Floats, theta: Floats) -> tuple[Floats, Floats]:
        return self._tension(strain, theta=theta)


@dataclass(frozen=True)
class Estimate:
    """One constant, in SI units.

    Attributes:
        low, high: Ends of the 95 % interval; `high` is infinite for a bound c₁ or c₂ that the data
            do not reach.
        identified: Whether the data tell it: its interval ends within the bounds of the fit.
        unit: Its unit; empty for a pure number.
    """

    value: float
    low: float
    high: float
    identified: bool
    unit: str = ""

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, eq=False, kw_only=True)
class FitResult:
    """Eq. (1) fitted to tensile tests, beside the data.

    Attributes:
        estimates: Constants by name: young, poisson, mu, lam, c1, c2; knit_ratio of a knit; young,
            second and third of a rubber, as of `Bladder`.
        samples: The points that were fitted.
        stress, lateral: The model's values at these points, (n,) each.
        thickness: In m; stresses are per width, so that only E h is measured.
        far: c₁ of the sheet beside threads, beyond what they let it stretch.
        stiff: Direction of the courses of `knit`, the stiffer of two; None of one direction.
        taken: What was taken for granted of files and tests, as sentences.
        doubts: What of it moves the values.
    """

    estimates: Mapping[str, Estimate]
    samples: Samples
    stress: Floats
    lateral: Floats
    options: FitOptions
    thickness: float
    far: float = np.inf
    stiff: str | None = None
    taken: Sequence[str] = ()
    doubts: Sequence[str] = ()

    @property
    def specimens(self) -> tuple[str, ...]:
        """Names of the specimens."""
        return self.samples.specimen

    @property
    def r2_stress(self) -> float:
        """Coefficient of determination of the stress."""
        return r_squared(self.samples.stress, self.stress)

    @property
    def r2_lateral(self) -> float | None:
        """Coefficient of determination of the lateral stretch; None if it was not measured."""
        seen = np.isfinite(self.samples.lateral)
        return r_squared(self.samples.lateral[seen], self.lateral[seen]) if seen.any() else None

    @property
    def measured_to(self) -> float:
        """Largest stretch that was fitted."""
        return 1 + float(self.samples.strain.max())

    @cached_property
    def trusted_to(self) -> float:
        """Largest stretch up to which the mean residuals are within 10 %.

        The mean is taken over twelfths of the range and each direction; what three of its standard
        errors explain is no misfit. The noise is that between neighbouring points.
        """
        samples, residual = self.samples, self.samples.stress - self.stress
        largest, worst = float(samples.strain.max()), PARTS
        part = np.minimum((samples.strain / largest * PARTS).astype(np.int64), PARTS - 1)
        for name in set(samples.direction):
            own = samples.curve_along(name)
            least = FLOOR * np.abs(samples.stress[own]).max()
            noise = NORMAL_MAD / np.sqrt(2) * np.median(np.abs(np.diff(residual[own])))
            for k in np.unique(part[own]):
                rows = own[part[own] == k]
                mean = abs(residual[rows].mean()) - 3 * noise / np.sqrt(len(rows))
                if mean > MISFIT * max(samples.stress[rows].mean(), least):
                    worst = min(worst, int(k))
        return 1 + (largest if worst == PARTS else largest * worst / PARTS)

    @property
    def doubted(self) -> list[str]:
        """Why the values are in doubt, as sentences; none if they are as good as measured."""
        found = list(self.doubts)
        if self.r2_stress < LEAST_R2:
            found.append(f"R² of the stress is {self.r2_stress:.3g}, below {LEAST_R2}.")
        samples = self.samples
        for name in dict.fromkeys(samples.direction):
            rows = samples.along(name)
            tests = np.unique(samples.test[rows])
            common = min(samples.strain[samples.test == k].max() for k in tests)
            found_of = []
            for k in tests:
                own = (samples.test == k) & (samples.strain <= common)
                fitted = self.stress[own]
                found_of.append(float(samples.stress[own] @ fitted) / float(fitted @ fitted))
            if np.ptp(found_of) > SCATTER * np.mean(found_of):
                found.append(
                    f"the specimens {f'along {name!r} ' if name else ''}differ by "
                    f"{np.ptp(found_of) / np.mean(found_of):.0%} in stress."
                )
        return found

    @property
    def material(self) -> Material:
        """The sheet with its bounds; of a knit the plain fabric under its courses."""
        young = self.estimates["young"].value
        if self.rubber:
            return Material(young, 0.5, self.thickness)
        return Material(young, self.estimates["poisson"].value, self.thickness, self.c1, self.c2)

    @property
    def rubber(self) -> dict[str, float]:
        """C₂₀ and C₃₀ by the names that a `Bladder` has for them; none of a fabric."""
        names = ("second", "third")
        return {name: self.estimates[name].value for name in names if name in self.estimates}

    @property
    def c1(self) -> float:
        """Bound on a principal stretch; with threads that of the sheet beside them."""
        return self.estimates["c1"].value if "c1" in self.estimates else self.far

    @property
    def c2(self) -> float:
        """Bound on the sum of both less 1."""
        return self.estimates["c2"].value

    @property
    def knit(self) -> Knit | None:
        """Threads of the fabric, if both directions were fitted."""
        if self.stiff is None:
            return None
        course, wale = (
            Threads(*(self.estimates[f"{name}_{of}"].value for of in ("stiffness", "strain")))
            for name in ("course", "wale")
        )
        return Knit(course=course, wale=wale)

    @property
    def remarks(self) -> list[str]:
        """What a reader must know, as sentences."""
        found = [*self.taken, *(f"In doubt: {text}" for text in self.doubted)]
        if self.stiff is not None:
            found.append(
                f"{self.stiff!r} is the stiffer direction: the courses of `Knit` run along it. "
                "Shear was not measured: it is that of the sheet, unless you give shear_stiffness."
            )
        if self.r2_lateral is None and not self.rubber:
            found.append(
                "No lateral stretch was measured: poisson and c2 follow from the stress alone."
            )
        far = "reaches infinity: the data do not come near this bound."
        end = "has 0 in it." if self.rubber else "reaches an end of what the fit allows."
        found += [
            f"{name} is not identified: its interval, {one.low:.4g} to {one.high:.4g}, "
            + (end if np.isfinite(one.high) else far)
            for name, one in self.estimates.items()
            if not one.identified
        ]
        if self.trusted_to < self.measured_to:
            found.append(
                f"Beyond a stretch of {self.trusted_to:.3g} the mean residual exceeds 10 %: fit "
                "fewer data by --up-to, or mistrust the model there."
            )
        found.append(
            f"The tests are uniaxial, with stretches from 1 to {self.measured_to:.3g}: larger "
            "ones, compression, shear and biaxial stretching are extrapolated."
        )
        return found

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        return {
            "estimates": {
                name: asdict(one) | {"high": one.high if np.isfinite(one.high) else None}
                for name, one in self.estimates.items()
            },
            "r2_stress": self.r2_stress,
            "r2_lateral": self.r2_lateral,
            "stretch_measured_to": self.measured_to,
            "stretch_trusted_to": self.trusted_to,
            "specimens": list(self.specimens),
            "directions": list(self.samples.direction),
            "points": len(self.samples.strain),
            "remarks": self.remarks,
            "inputs": self.options.as_dict(),
            "thickness_m": self.thickness,
            "membrane_stiffness_n_per_m": self.material.membrane_stiffness,
            "stiff_direction": self.stiff,
            "doubts": self.doubted,
        }


def r_squared(measured: Floats, model: Floats) -> float:
    """Return 1 − Σ residual²/Σ (measured − mean)²; −∞ of constant data that are missed."""
    missed = float(np.sum((measured - model) ** 2))
    spread = float(np.sum((measured - measured.mean()) ** 2))
    if spread == 0:
        return 1.0 if missed == 0 else -np.inf
    return 1 - missed / spread


def estimates_of(
    values: Mapping[str, float],
    draws: Mapping[str, Floats],
    ranges: Mapping[str, tuple[float, float]],
) -> dict[str, Estimate]:
    """Return constants with their intervals.

    Args:
        draws: The same constants of each draw, (draws,).
        ranges: Smallest and largest value that the fit allows for c₁ and c₂.
    """
    found = {}
    for name, value in values.items():
        ends = [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)]
        # Of n draws n + 1 gaps are alike: other percentiles of few draws are too near.
        low, high = np.percentile(draws[name], ends, method="weibull")
        low, high = min(low, value), max(high, value)
        identified = name != "poisson" or high - low < WIDE_POISSON
        identified &= name not in ("second", "third") or not low <= 0 <= high
        if name in ranges:
            least, most = ranges[name]
            margin = 1e-3 * (most - least)
            identified = least + margin < low and high < most - margin
            high = np.inf if high >= most - margin else high
        unit = CONSTANTS[name][1]
        found[name] = Estimate(float(value), float(low), float(high), bool(identified), unit)
    return found


def fit_table(result: FitResult) -> str:
    """Return the result as lines of text: constants, fit, range and remarks."""
    lines = [f"{'':24}{'value':>12}   {'95 % interval':<24}"]
    for name, one in result.estimates.items():
        factor, unit = 1.0, one.unit
        if unit == "Pa":
            factor, unit = (1e-6, "MPa") if one.value >= 1e6 else (1e-3, "kPa")
        interval = f"{factor * one.low:.4g} … {factor * one.high:.4g} {unit}"
        note = "" if one.identified else "not identified"
        title = f"{CONSTANTS[name][0]:24}{factor * one.value:12.4g}"
        lines.append(f"{title}   {interval:<24} {note}".rstrip())
    stiffness = result.material.membrane_stiffness
    lines += [
        f"{'E h':24}{stiffness:12.4g} N/m at h = {1e3 * result.thickness:.3g} mm",
        _quality(result, "not measured"),
        f"fitted to a stretch of {result.measured_to:.3g}, to be trusted to "
        f"{result.trusted_to:.3g}",
        f"{len(result.specimens)} tests, {len(result.samples.strain)} points",
        *result.remarks,
    ]
    return "\n".join(lines)


def _quality(result: FitResult, lacking: str) -> str:
    lateral = lacking if result.r2_lateral is None else f"{result.r2_lateral:.4f}"
    return f"R² of the stress {result.r2_stress:.4f}, of the lateral stretch {lateral}"


def write_fit(comm: MPI.Comm, folder: str | Path, result: FitResult) -> None:
    """Write fit.json, fit.txt, fit.csv and fit.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / "fit.json", result.summary())
        replace_file(folder / "fit.txt", f"{fit_table(result)}\n".encode())
        write_table(folder / "fit.csv", _rows(result))
        if_plotting(lambda: plot_fit(folder / "fit.png", result))

    guarded(comm, folder, write)


def _rows(result: FitResult) -> list[dict[str, object]]:
    """Return measured and fitted values of all points as rows of a table, in SI units."""
    samples = result.samples
    columns = {
        "specimen": [result.specimens[test] for test in samples.test],
        "direction": [samples.direction[test] for test in samples.test],
        "stretch": (1 + samples.strain).tolist(),
        "stress_n_per_m": samples.stress.tolist(),
        "stress_fitted_n_per_m": result.stress.tolist(),
        "lateral_stretch": samples.lateral.tolist(),
        "lateral_stretch_fitted": result.lateral.tolist(),
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def plot_fit(path: Path, result: FitResult) -> None:
    """Draw stress and lateral stretch beside the data, and the residuals below (one rank)."""
    from toros_fem.results.pictures.style import GRID, SOFT, TALL, page

    samples = result.samples
    shown = [("stress", " (N/m)", samples.stress, result.stress)]
    if result.r2_lateral is not None:
        shown.append(("lateral stretch", "", samples.lateral, result.lateral))
    where = {"left": 0.09, "right": 0.97, "bottom": 0.09, "top": 0.88, "hspace": 0.12}
    with page(path, _quality(result, "not measured"), TALL) as figure:
        grid = figure.subplots(
            2, len(shown), sharex=True, squeeze=False, height_ratios=[2.4, 1],
            gridspec_kw={**where, "wspace": 0.25},
        )  # fmt: skip
        for (top, bottom), (what, unit, measured, fitted) in zip(grid.T, shown, strict=True):
            names = dict.fromkeys(samples.direction)
            for k, (name, colour) in enumerate(zip(names, cycle(COLOURS), strict=False)):
                rows = samples.curve_along(name)
                stretch, words = 1 + samples.strain[rows], f"{name}: " if name else ""
                tests = samples.direction.count(name)
                law = "Yeoh's law" if result.rubber else "eq. (1)"
                told = f"{words}{tests} test{'s' * (tests > 1)} (dots), {law} (line)"
                dots = {"ls": "", "marker": ".", "ms": 4, "color": colour, "alpha": 0.5}
                top.plot(stretch, measured[rows], **dots)
                top.plot(stretch, fitted[rows], color=colour, lw=1.8)
                if top is grid[0, 0]:  # colours are the same in both, and here a corner is free
                    top.text(0.03, 0.95 - 0.07 * k, told, color=colour, transform=top.transAxes)
                bottom.plot(stretch, (measured - fitted)[rows], **dots)
            bottom.axhline(0.0, color=SOFT, lw=0.8)
            bottom.set(xlabel="stretch", ylabel=f"measured − fitted{unit}")
            top.set_ylabel(what + unit)
            for axis in (top, bottom):
                axis.grid(axis="y")
                if result.trusted_to < result.measured_to:  # the fit is not to be trusted there
                    axis.axvspan(result.trusted_to, result.measured_to, color=GRID, zorder=0)


def library_entry(
    result: FitResult,
    name: str,
    *,
    with_fabric: bool = False,
    title: str | None = None,
    source: str | None = None,
) -> LibraryMaterial:
    """Return a fitted material as an entry of a library, for `materials.library.write_material`.

    Args:
        with_fabric: Whether a print was tested together with its fabric.
        title: What it is; None for the name.
        source: Where the tests come from; None for their specimens.

    Raises:
        FileError: No stretch is to be trusted.
        ParameterError: Name, title or source are refused by the library.
    """
    if not result.trusted_to > 1:
        raise FileError(
            "the fit is to be trusted nowhere: its mean residuals exceed 10 % from the start. Fit "
            "fewer data by --up-to, or one direction by --direction."
        )
    unknown = [name for name, one in result.estimates.items() if not one.identified]
    notes = [f"doubted: {text}" for text in result.doubted]
    notes += [f"not identified: {', '.join(unknown)}"] if unknown else []
    tested = f"{len(result.specimens)} tensile tests: {', '.join(result.specimens)}"
    sheet = result.material
    note = "; ".join([_quality(result, "none measured"), *notes])
    return LibraryMaterial(
        name=name,
        kind=result.options.kind,
        title=title or name,
        **{one: getattr(sheet, one) for one in ("young", "poisson", "thickness", "c1", "c2")},
        **_threads(result.knit),
        **result.rubber,
        stretch_range=(1.0, result.trusted_to),
        source=source or (tested if len(tested) < 200 else f"{tested[:199]}…"),
        trust="doubted" if result.doubted else "measured",
        with_fabric=with_fabric,
        note=note if len(note) <= LENGTHS["note"] else f"{note[: LENGTHS['note'] - 1]}…",
    )


def _threads(knit: Knit | None) -> dict[str, Any]:
    """Return the threads of a fitted fabric by the keys of a library."""
    if knit is None or knit.course is None or knit.wale is None:
        return {}
    return {
        "course_stiffness": knit.course.stiffness,
        "course_strain": knit.course.strain,
        "wale_stiffness": knit.wale.stiffness,
        "wale_strain": knit.wale.strain,
    }
