"""Report of a fit: text, JSON, table of points and picture, and the entry of a material library."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.base.files import guarded, if_plotting, replace_file, write_json, write_table
from toros_fem.materials.library.material import LENGTHS, LibraryMaterial
from toros_fem.products.fitting.result import CONSTANTS, FitResult

FILES = ("fit.json", "fit.txt", "fit.csv", "fit.png")
COLOURS = ("#1F3A5F", "#D55E00", "#0072B2", "#6B7280")


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
                told = f"{words}{tests} test{'s' * (tests > 1)} (dots), eq. (1) (line)"
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
    kind: str = "fabric",
    with_fabric: bool = False,
    title: str | None = None,
    source: str | None = None,
) -> LibraryMaterial:
    """Return a fitted material as an entry of a library, for `materials.library.write_material`.

    Args:
        kind: "fabric" or "print".
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
        kind=kind,
        title=title or name,
        **{one: getattr(sheet, one) for one in ("young", "poisson", "thickness", "c1", "c2")},
        knit_ratio=None if result.knit is None else result.knit.ratio,
        stretch_range=(1.0, result.trusted_to),
        source=source or (tested if len(tested) < 200 else f"{tested[:199]}…"),
        trust="doubted" if result.doubted else "measured",
        with_fabric=with_fabric,
        note=note if len(note) <= LENGTHS["note"] else f"{note[: LENGTHS['note'] - 1]}…",
    )
