"""Report of a fit: text, JSON, table of points and picture, and the entry of a material library."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.errors import MeasurementError
from toros_fem.base.files import write_json, write_table, write_together
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.products.fitting.result import Estimate, Fit, FitResult
from toros_fem.results.writer import if_plotting

TITLES = {
    "young": "Young's modulus E",
    "poisson": "Poisson's ratio ν",
    "mu": "Lamé parameter μ",
    "lam": "Lamé parameter λ",
    "c1": "bound c₁ on a stretch",
    "c2": "bound c₂ on their sum",
    "knit_ratio": "ratio of the directions",
    "fabric": "E of the fabric",
    "reinforcement": "E of the reinforcement",
}


def fit_table(result: Fit) -> str:
    """Return the result as lines of text: constants, fit, range and remarks."""
    lines = [f"{'':24}{'value':>12}   {'95 % interval':<24}"]
    for name, one in result.estimates.items():
        value, low, high, unit = _in_handy_unit(one)
        note = "" if one.identified else "not identified"
        interval = f"{low:.4g} … {high:.4g} {unit}"
        lines.append(f"{TITLES[name]:24}{value:12.4g}   {interval:<24} {note}".rstrip())
    lateral = "not measured" if result.r2_lateral is None else f"{result.r2_lateral:.4f}"
    lines += [
        *result.sizes,
        f"R² of the stress {result.r2_stress:.4f}, of the lateral stretch {lateral}",
        f"fitted to a stretch of {result.measured_to:.3g}, to be trusted to "
        f"{result.trusted_to:.3g}",
        f"{len(result.specimens)} tests, {len(result.samples.strain)} points",
        *result.remarks,
    ]
    return "\n".join(lines)


def _in_handy_unit(one: Estimate) -> tuple[float, float, float, str]:
    factor, unit = 1.0, one.unit
    if unit == "Pa":
        factor, unit = (1e-6, "MPa") if one.value >= 1e6 else (1e-3, "kPa")
    return factor * one.value, factor * one.low, factor * one.high, unit


def write_fit(comm: MPI.Comm, folder: str | Path, result: Fit) -> None:
    """Write fit.json, fit.txt, fit.csv and fit.png (collective).

    Args:
        comm: Communicator.
        folder: Folder, made if missing.
        result: The fit, equal on all ranks.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / "fit.json", result.summary())
        (folder / "fit.txt").write_text(fit_table(result) + "\n", encoding="utf-8")
        write_table(folder / "fit.csv", fit_rows(result))

        def draw() -> None:
            from toros_fem.products.fitting.plot import plot_fit

            plot_fit(folder / "fit.png", result)

        if_plotting(draw)

    write_together(comm, folder, write)


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
        result: The fit.
        name: Name in scene files.
        kind: "fabric" or "print".
        with_fabric: Whether a print was tested together with its fabric.
        title: What it is; None for the name.
        source: Where the tests come from; None for their specimens.

    Raises:
        MeasurementError: No stretch is to be trusted.
        ParameterError: Name, title or source are refused by the library.
    """
    if not result.trusted_to > 1:
        raise MeasurementError(
            "the fit is to be trusted nowhere: its mean residuals exceed 10 % from the start. Fit "
            "fewer data by --up-to, or one direction by --direction."
        )
    rest = {} if result.knit is None else {"knit_ratio": result.knit.ratio}
    unknown = [name for name, one in result.estimates.items() if not one.identified]
    notes = [] if not unknown else [f"not identified: {', '.join(unknown)}"]
    lateral = "none measured" if result.r2_lateral is None else f"{result.r2_lateral:.4f}"
    notes.append(f"R² of the stress {result.r2_stress:.4f}, of the lateral stretch {lateral}")
    tested = f"{len(result.specimens)} tensile tests: {', '.join(result.specimens)}"
    sheet = result.material
    return LibraryMaterial(
        name=name,
        kind=kind,
        title=title or name,
        young=sheet.young,
        poisson=sheet.poisson,
        thickness=sheet.thickness,
        stretch_range=(1.0, result.trusted_to),
        source=source or (tested if len(tested) < 200 else f"{tested[:199]}…"),
        trust="measured",
        c1=result.c1,
        c2=result.c2,
        with_fabric=with_fabric,
        note="; ".join(notes),
        **rest,
    )


def fit_rows(result: Fit) -> Sequence[dict[str, object]]:
    """Return measured and fitted values of all points as rows of a table, in SI units."""
    samples = result.samples
    return [
        {
            "specimen": result.specimens[test],
            "direction": samples.direction[test],
            "stretch": 1 + float(samples.strain[k]),
            "stress_n_per_m": float(samples.stress[k]),
            "stress_fitted_n_per_m": float(result.stress[k]),
            "lateral_stretch": float(samples.lateral[k]),
            "lateral_stretch_fitted": float(result.lateral[k]),
        }
        for k, test in enumerate(samples.test)
    ]
