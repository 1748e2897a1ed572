"""`toros fit`: material constants from tensile tests."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.mpi import on_first_rank
from toros_fem.base.units import read_quantity
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.cli.command_line.scripts import add_options
from toros_fem.materials.library import write_material
from toros_fem.products.fitting.columns import UNITS
from toros_fem.products.fitting.fit import fit_material
from toros_fem.products.fitting.options import FitOptions
from toros_fem.products.fitting.reading import Given, read_tensile_tests
from toros_fem.products.fitting.report import fit_table, library_entry, write_fit
from toros_fem.products.fitting.result import FitResult
from toros_fem.products.fitting.sheet_fit import fit_printed_sheet
from toros_fem.products.fitting.strip import ClampedStrip
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.tiles.printed_tile import read_tile

LENGTHS = ("thickness", "width", "gauge_length")


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="CSV files of the tests")
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("fit"),
        metavar="FOLDER",
        help="folder for the report, made if missing; default fit",
    )
    group = parser.add_argument_group("What the files do not say")
    for name, meaning in (
        ("thickness", "thickness of the sheet"),
        ("width", "width of the strips"),
        ("gauge-length", "length that the extension refers to"),
    ):
        group.add_argument(
            f"--{name}",
            default=None,
            metavar="LENGTH",
            help=f"{meaning}, with its unit, '0.5 mm', or in m; default that of the files",
        )
    group.add_argument(
        "--direction",
        default=None,
        metavar="NAME",
        help="fit the tests along this direction alone, and those of none; default all",
    )
    group.add_argument(
        "--unit",
        action="append",
        default=[],
        metavar="COLUMN=UNIT",
        help="unit of a column, 'force=N', as often as needed; default that in the header",
    )
    group.add_argument(
        "--clamped",
        action="store_true",
        help="simulate the strip between its clamps, which hold its width: the stretch is that of "
        "their distance, --gauge-length; needs --width too; default no",
    )
    group = parser.add_argument_group("Test of a sheet of printed tiles")
    group.add_argument(
        "--tile",
        type=Path,
        default=None,
        metavar="FOLDER",
        help="folder of the printed tile, tile.npz; the moduli of fabric and print are fitted to "
        "tests along its x or y; default none",
    )
    group.add_argument(
        "--along", type=int, default=10, metavar="N", help="tiles along the pull; default 10"
    )
    group.add_argument(
        "--across", type=int, default=5, metavar="N", help="tiles across the pull; default 5"
    )
    group = parser.add_argument_group("Entry of a file of materials")
    group.add_argument(
        "--name", default=None, metavar="NAME", help="name of the material; default no entry"
    )
    group.add_argument(
        "--library",
        type=Path,
        default=None,
        metavar="FILE",
        help="file of materials, made if missing, in which NAME is added or replaced; default none",
    )
    group.add_argument(
        "--kind", choices=("fabric", "print"), default="fabric", help="what it is; default fabric"
    )
    group.add_argument(
        "--with-fabric",
        action="store_true",
        help="a print was tested together with its fabric; default no",
    )
    group.add_argument(
        "--source", default=None, metavar="TEXT", help="where it comes from; default the specimens"
    )
    add_options(parser, FitOptions())


def _given(options: argparse.Namespace) -> Given:
    units = {}
    for text in options.unit:
        column, equals, unit = text.partition("=")
        column = " ".join(column.replace("-", " ").lower().split())
        if not equals or column not in UNITS:
            raise UsageError(
                f"--unit {text!r} must be COLUMN=UNIT, with a column of {', '.join(UNITS)}."
            )
        units[column] = unit.strip()
    thickness, width, gauge_length = (_length(getattr(options, name)) for name in LENGTHS)
    return Given(thickness, width, gauge_length, units=units)


def _length(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return read_quantity(text, "m")


def _read(
    options: argparse.Namespace, thickness: float | None = None
) -> tuple[list[TensileTest], FitOptions]:
    given = _given(options)
    if given.thickness is None:
        given = replace(given, thickness=thickness)
    tests = read_tensile_tests(options.data, given)
    if options.direction is not None:
        wanted = options.direction.lower()
        named = [replace(one, direction=one.direction or wanted) for one in tests]
        chosen = [test for test in named if test.direction == wanted]
        if not chosen:
            known = ", ".join(sorted({repr(test.direction) for test in tests}))
            raise UsageError(f"--direction {wanted!r}: the tests have the directions {known}.")
        tests = chosen
    values = vars(options)
    names = [entry.name for entry in fields(FitOptions) if entry.name in values]
    return tests, FitOptions(**{name: values[name] for name in names})


def _fit(comm: MPI.Comm, options: argparse.Namespace) -> FitResult:
    tests, how = on_first_rank(comm, lambda: _read(options))
    if not options.clamped:
        return on_first_rank(comm, lambda: fit_material(tests, how))
    length, width = _length(options.gauge_length), _length(options.width)
    if length is None or width is None:
        raise UsageError("--clamped needs --gauge-length, the clamps' distance, and --width.")
    return fit_material(tests, how, ClampedStrip(comm, length, width))


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    if (given.name is None) != (given.library is None):
        raise UsageError("--name and --library belong together: give both, or none.")
    if given.tile is not None:
        return _run_sheet(comm, given)
    result = _fit(comm, given)
    write_fit(comm, given.output, result)
    text = f"{fit_table(result)}\nsee {given.output}/"
    if given.name is not None:
        on_first_rank(comm, lambda: _write_entry(result, given))
        text += f"; {given.name} is in {given.library}"
    return Answer(text, {"folder": given.output, "library": given.library, **result.summary()})


def _run_sheet(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    if given.name is not None or given.clamped:
        raise UsageError("--tile gives two moduli: it takes neither --name nor --clamped.")
    tile = read_tile(comm, given.tile)
    # A stress per section needs a thickness; that of a sheet is the same everywhere.
    thickness = tile.composite.reinforcement.thickness
    tests, options = on_first_rank(comm, lambda: _read(given, thickness))
    result = fit_printed_sheet(comm, tests, tile, given.along, given.across, options)
    write_fit(comm, given.output, result)
    text = f"{fit_table(result)}\nsee {given.output}/"
    return Answer(text, {"folder": given.output, **result.summary()})


def _write_entry(result: FitResult, given: argparse.Namespace) -> None:
    entry = library_entry(
        result, given.name, kind=given.kind, with_fabric=given.with_fabric, source=given.source
    )
    write_material(given.library, entry)


COMMAND = Command(
    "CSV files of tensile tests give E, ν and the bounds c1 and c2 of eq. (1), with 95 %\n"
    "intervals. The header names the columns with their units: 'strain [%]', 'force [N]',\n"
    "'lateral strain [%]'. The folder gets fit.txt, fit.json, fit.csv and fit.png.\n"
    "With a name and a file of materials, scenes can take the material by its name.",
    (
        "toros fit jersey.csv --thickness '0.5 mm'",
        "toros fit jersey.csv --thickness '0.5 mm' --name my-jersey --library mine.toml",
        "toros fit sheet.csv --tile run --along 10 --across 5 --width '50 mm'",
        "toros fit course.csv wale.csv --width '25 mm' --thickness '0.5 mm' --output jersey",
    ),
    _options,
    _run,
)
