"""`toros materials` and `toros fit`: materials by name, and constants from tensile tests."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.files import require_unused
from toros_fem.base.keys import File, Flag, Length, OneOf, Table, Text, key, write_quantity
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.cli.process import UsageError
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import MATERIAL_KINDS, LibraryMaterial
from toros_fem.products.common.options import FitOptions

if TYPE_CHECKING:
    from toros_fem.products.fitting.fit import FitResult
    from toros_fem.products.fitting.samples import TensileTest

WIDTH = 96
# Heading of each kind.
TITLES: Mapping[str, str] = MappingProxyType(
    {"fabric": "Fabrics", "print": "Prints", "rubber": "Rubbers, for bladders"}
)
HEADER = ("name", "E", "ν", "thickness", "E h", "stretches", "trust")


class Materials(Command, kw_only=True):
    """Lists materials that scenes know by name.

    Each has its modulus, thickness, range of stretches, trust and source. Scenes name them:
    fabric = "jersey-light", reinforcement = "tpu-95a", bladder = "dragon-skin-20".
    """

    name: Text | None = key(None, "show all of this material; none: a table of all")
    file: tuple[File, ...] = key(
        (),
        "file of materials of your own, over the shipped ones; may be given several times",
    )
    kind: Annotated[str, OneOf(MATERIAL_KINDS)] | None = key(None, "only this kind; none: all")

    WORDS: ClassVar = ("name",)
    TAKES: ClassVar = {"file": "FILE", "kind": "KIND"}
    EXAMPLES: ClassVar = (
        "toros materials",
        "toros materials tpu-95a",
        "toros materials --kind rubber --file my_materials.toml --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Read and tell them (collective)."""
        library = read_library(*self.file, comm=comm)
        if self.name is not None:
            entry = named(library, self.name, self.kind)
            return Answer(material_details(entry), entry.as_dict())
        found = [entry for entry in library.values() if self.kind in (None, entry.kind)]
        return Answer(table_text(found), {"materials": [entry.as_dict() for entry in found]})


def table_text(entries: Iterable[LibraryMaterial]) -> str:
    """Return materials as lines for a terminal, by kind, each with its source below."""
    found, gap = list(entries), 4 * " "
    widths = [max(map(len, cells)) for cells in zip(HEADER, *map(row, found), strict=True)]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(map(str.ljust, cells, widths)).rstrip()

    lines: list[str] = []
    for kind in MATERIAL_KINDS:
        of_kind = [entry for entry in found if entry.kind == kind]
        lines += ["", TITLES[kind], line(HEADER)] if of_kind else []
        for entry in of_kind:
            text = f"{entry.title}. {sentence(entry.source)}"
            below = textwrap.wrap(
                text, WIDTH, initial_indent=gap, subsequent_indent=gap, break_on_hyphens=False
            )
            lines += [line(row(entry)), *below]
    return "\n".join(lines[1:])


def material_details(entry: LibraryMaterial) -> str:
    """Return all that is known of a material, as lines for a terminal."""
    lines, gap = [f"{entry.name}: {entry.title}"], 12 * " "
    for label, text in _cells(entry).items():
        if label != "name":
            head = label.ljust(len(gap))
            lines += textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=gap)
    return "\n".join(lines)


def row(entry: LibraryMaterial) -> list[str]:
    """Return the cells of a material below `HEADER`."""
    return [_cells(entry)[label] for label in HEADER]


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def _cells(entry: LibraryMaterial) -> dict[str, str]:
    """Return what is known of a material, by its label."""
    (low, high), stiffness = entry.stretch_range, entry.membrane_stiffness
    thousands, unit = (1e3, "kN/m") if stiffness >= 1e3 else (1.0, "N/m")
    cells = {
        "name": entry.name,
        "kind": entry.kind,
        "E": write_quantity(entry.young, "Pa"),
        "ν": f"{entry.poisson:g}",
        "thickness": write_quantity(entry.thickness, "m"),
        "E h": f"{stiffness / thousands:.3g} {unit}",
        "c1": entry.c1 and f"{entry.c1:g}",
        "c2": entry.c2 and f"{entry.c2:g}",
        "C₂₀": entry.second and write_quantity(entry.second, "Pa"),
        "C₃₀": entry.third and write_quantity(entry.third, "Pa"),
        "knit ratio": entry.knit_ratio and f"{entry.knit_ratio:g}",
        "courses": _threads(entry.course_stiffness, entry.course_strain),
        "wales": _threads(entry.wale_stiffness, entry.wale_strain),
        "shear": entry.shear_stiffness and write_quantity(entry.shear_stiffness, "N/m"),
        "mass": entry.density and write_quantity(entry.density, "kg/m²"),
        "sheet": entry.with_fabric and "print and fabric as one",
        "stretches": f"{low:g} to {high:g}",
        "trust": entry.trust,
        "source": entry.source,
        "note": entry.note,
    }
    return {label: str(text) for label, text in cells.items() if text}


class _Entry(Table, kw_only=True):
    """Entry of a file of materials."""

    name: Text | None = key(None, "name of the material; none: no entry")
    library: File | None = key(
        None, "file of materials, made if missing, in which NAME is added or replaced"
    )
    with_fabric: Flag = key(False, "a print was tested together with its fabric")
    source: Text | None = key(None, "where it comes from; none: the specimens")


class _Unsaid(Table, kw_only=True):
    """What the files do not say."""

    thickness: Length | None = key(None, "thickness of the sheet; none: that of the files")
    width: Length | None = key(None, "width of the strips; none: that of the files")
    gauge_length: Length | None = key(
        None, "length that the extension refers to; none: that of the files"
    )
    direction: Text | None = key(
        None, "fit the tests along this direction alone, and those of none; none: all"
    )
    unit: tuple[Text, ...] = key(
        (), "unit of a column, 'force=N', as often as needed; none: that in the header"
    )
    column: tuple[Text, ...] = key(
        (),
        "name of a column by what it holds, 'force=Channel 3', as often as needed; none: by the "
        "known names",
    )


class _OfSkin(Table, kw_only=True):
    """A skin that was inflated, in the place of tensile tests."""

    scene: File | None = key(
        None,
        "scene file of the skin, whose readings over pressure DATA has; none: tensile tests",
    )
    pattern: File | None = key(
        None, "its print: folder of a design, or a drawing; none: a plain skin"
    )
    coarse: Flag = key(False, "the scene's quick variant, with a coarse mesh")


class Fit(Command, FitOptions, _Entry, _Unsaid, _OfSkin, kw_only=True):
    """Fits a material to tensile tests, or to an inflated skin.

    CSV files of tensile tests give E, ν and the bounds c1 and c2 of eq. (1), of a rubber the
    constants of Yeoh's law, with 95 % intervals. With a scene the file has readings of its skin:
    'pressure [kPa]', 'diameter [mm]', 'length [mm]', of a print 'angle [deg]' or 'twist [deg]'.
    What these cannot tell is held, and told. Headers name the columns with their units:
    'strain [%]', 'force [N]', 'lateral strain [%]'; tables of test machines are read as they
    are. Slack, set and break are left out, and told. The folder gets fit.txt, fit.json, fit.csv
    and fit.png.
    With a name and a file of materials, scenes can take the material by its name.
    """

    data: tuple[File, ...] = key(MISSING, "files of the tests, in CSV")
    output: File = key(Path("fit"), "folder for the report, made if missing")
    overwrite: Flag = key(False, "replace files of these names in the folder; all others stay")

    WORDS: ClassVar = ("data",)
    TAKES: ClassVar = {
        "unit": "COLUMN=UNIT",
        "column": "COLUMN=NAME",
        "library": "FILE",
        "kind": "KIND",
        "output": "FOLDER",
        "source": "TEXT",
    }
    EXAMPLES: ClassVar = (
        "toros fit jersey.csv --thickness '0.5 mm'",
        "toros fit jersey.csv --thickness '0.5 mm' --name my-jersey --library mine.toml",
        "toros fit course.csv wale.csv --width '25 mm' --thickness '0.5 mm' --output jersey",
        "toros fit inflated.csv --scene tube.toml --coarse",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Fit, and write the report and the entry (collective)."""
        from toros_fem.products.fitting.fit import FILES, fit_table, write_fit

        if (self.name is None) != (self.library is None):
            raise UsageError("--name and --library belong together: give both, or none.")
        unused = partial(require_unused, self.output, FILES, overwrite=self.overwrite)
        on_first_rank(comm, unused)
        if self.scene is not None:
            return self._of_skin(comm, self.scene)
        if self.pattern is not None or self.coarse:
            raise UsageError("--pattern and --coarse belong to --scene: give it, or none of them.")
        result = on_first_rank(comm, self._material)
        write_fit(comm, self.output, result)
        text = f"{fit_table(result)}\nsee {self.output}/"
        if self.name is not None:
            text += f"; {self.name} is in {self.library}"
            text += ', marked as "doubted"' if result.doubted else ""
        return Answer(text, {"folder": self.output, "library": self.library, **result.summary()})

    def _of_skin(self, comm: MPI.Comm, file: Path) -> Answer:
        """Fit to an inflated skin, and write the report (collective)."""
        from toros_fem.cli.scene_files import read_scene
        from toros_fem.products.fitting import inflation

        fits = {*_OfSkin.described(), "data", "output", "overwrite"}
        idle = sorted(vars(self)["given"] - fits)
        if idle or len(self.data) > 1:
            what = "one file of readings" if not idle else f"no --{idle[0].replace('_', '-')}"
            raise UsageError(f"with --scene, `toros fit` takes {what}.")
        scene = read_scene(file, comm=comm, coarse=self.coarse).config
        skin = inflation.MeasuredSkin(comm, scene, self.pattern)
        read = partial(inflation.read_inflation, self.data[0], scene, skin.metrics)
        result = inflation.fit_inflation(skin, on_first_rank(comm, read))
        inflation.write_inflation(comm, self.output, result)
        text = f"{result.table()}\nsee {self.output}/"
        return Answer(text, {"folder": self.output, **result.summary()})

    def _material(self) -> FitResult:
        """Return constants, and write them where a name asks for it (one rank)."""
        from toros_fem.materials.library.files import write_material
        from toros_fem.products.fitting.fit import fit_material, library_entry

        result = fit_material(self._tests(), self.updating(FitOptions()))
        if self.name is not None and self.library is not None:
            said = {name: getattr(self, name) for name in ("with_fabric", "source")}
            write_material(self.library, library_entry(result, self.name, **said))
        return result

    def _tests(self) -> list[TensileTest]:
        """Return the tests along the direction (one rank)."""
        from toros_fem.products.fitting.columns import UNITS, WORDS
        from toros_fem.products.fitting.reading import Given, read_tensile_tests

        units = _pairs("unit", self.unit, tuple(UNITS))
        columns = _pairs("column", self.column, (*UNITS, *WORDS))
        given = Given(self.thickness, self.width, self.gauge_length, units=units, columns=columns)
        tests = read_tensile_tests(self.data, given)
        if self.direction is None:
            return tests
        wanted = self.direction.lower()
        chosen = [test for test in tests if test.direction in ("", wanted)]
        if not chosen:
            known = ", ".join(sorted({repr(test.direction) for test in tests}))
            raise UsageError(f"--direction {wanted!r}: the tests have the directions {known}.")
        return [replace(test, direction=wanted) for test in chosen]


def _pairs(option: str, texts: tuple[str, ...], known: tuple[str, ...]) -> dict[str, str]:
    """Return what an option says of columns, by what they hold."""
    found = {}
    for text in texts:
        column, equals, said = text.partition("=")
        column = " ".join(column.replace("-", " ").lower().split())
        if not equals or column not in known:
            raise UsageError(
                f"--{option} {text!r} must be COLUMN={option.upper().replace('COLUMN', 'NAME')}, "
                f"with a column of {', '.join(known)}."
            )
        found[column] = said.strip()
    return found


def _threads(stiffness: float | None, strain: float | None) -> str | None:
    """Return threads of one direction in words; None for none."""
    if stiffness is None:
        return None
    stiffens = "" if strain is None else f", stiffen over a strain of {strain:.3g}"
    return f"{write_quantity(stiffness, 'N/m')}{stiffens}"
