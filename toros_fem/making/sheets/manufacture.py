"""What is made of a design: panels on beds and sheets, the bladder, and the order of sewing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.bladder import bladder_sheets
from toros_fem.making.panels.panel_drawing import panel_drawings, printed_face
from toros_fem.making.panels.seam_lines import SewnSeam, sewn_seams
from toros_fem.making.sheets.layout import Layout, Sheet, film_sheet, layout
from toros_fem.making.sheets.sewing_order import SewingStep, sewing_order
from toros_fem.meshes.pattern import Pattern, Regions


@dataclass(frozen=True, eq=False)
class Manufacture:
    """What is made of a design; files, manifest and page show it.

    Attributes:
        layout: Panels on beds and sheets.
        film: The film with the sheets of the bladder; None without one.
        seams: All seams.
        order: The order in which they are sewn.
    """

    options: ManufactureOptions
    layout: Layout
    film: Sheet | None
    seams: Sequence[SewnSeam]
    order: Sequence[SewingStep]


def manufacture(pattern: Pattern, regions: Regions, options: ManufactureOptions) -> Manufacture:
    """Return what is made of a design on a whole pattern.

    Raises:
        SheetError: A panel fits on no sheet.
        PatternError: The skin is moulded, so that it has no flat panels.
        MissingPackageError: Panels must be nested, and u-nesting is not installed.
    """
    pattern, regions = printed_face(pattern, regions, options)
    seams, film = sewn_seams(pattern), bladder_sheets(pattern, options)
    closing = [] if film.tab_seam is None else [film.tab_seam]
    return Manufacture(
        options=options,
        layout=layout(panel_drawings(pattern, regions, options), options),
        film=film_sheet(film.drawings, options) if film.drawings else None,
        seams=seams,
        order=sewing_order(pattern, seams, closing),
    )
