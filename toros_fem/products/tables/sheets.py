"""Tables of the sheets of a skin: fabric, print and bladder."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Angle, In, Length, Modulus, OneOf, Poisson, Stretch, Table, key
from toros_fem.materials.sheet import (
    CURVATURES,
    PRINT_SIDES,
    SEAMS,
    WRINKLINGS,
    Bending,
    Bladder,
    Composite,
    Knit,
    Material,
    Membrane,
)


class Sheets(Table):
    """Fabric, print and bladder."""

    fabric_young: Modulus = key(0.1e6, "Young's modulus of the fabric")
    poisson: Poisson = key(0.3, "Poisson's ratio of the fabric")
    thickness: Length = key(0.5e-3, "thickness of the fabric")
    c1: Stretch = key(1.9, "bound on a principal stretch, eq. (1)")
    c2: Stretch = key(2.6, "bound on the sum of both principal stretches less 1")
    tested_stretch: Stretch | None = key(
        None,
        "stretch up to which the fabric was tested, beyond which a warning comes; none: unknown",
    )
    reinforcement_young: Modulus = key(70e6, "Young's modulus of the reinforced fabric")
    reinforcement_poisson: Poisson | None = key(
        None, "Poisson's ratio of the reinforced fabric; none takes that of the fabric"
    )
    reinforcement_thickness: Length | None = key(
        0.4e-3, "thickness of the reinforced fabric; none takes that of the fabric"
    )
    print_height: Length | None = key(
        None,
        "height of the printed layer on the fabric, for the machine files; none takes the "
        "thickness of the reinforced fabric",
    )
    reinforcement_c1: Stretch | None = key(
        None, "bound on a principal stretch of the reinforced fabric; none takes that of the fabric"
    )
    reinforcement_c2: Stretch | None = key(
        None,
        "bound on the sum of both less 1 in the reinforced fabric; none takes that of the fabric",
    )

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement as membranes."""
        poisson, thickness = self.reinforcement_poisson, self.reinforcement_thickness
        return Composite(
            fabric=Material(self.fabric_young, self.poisson, self.thickness),
            reinforcement=Material(
                self.reinforcement_young,
                self.poisson if poisson is None else poisson,
                self.thickness if thickness is None else thickness,
                self.reinforcement_c1,
                self.reinforcement_c2,
            ),
            c1=self.c1,
            c2=self.c2,
            bending=None,
        )


class SkinSheets(Sheets):
    """Fabric, print and bladder."""

    bending: Annotated[str, OneOf(CURVATURES)] | None = key(
        Bending.curvature, "curvature term of the sheet; none for a membrane"
    )
    seams: Annotated[str, OneOf(SEAMS)] = key(Bending.seams, "how seams carry moments")
    wrinkling: Annotated[str, OneOf(WRINKLINGS)] | None = key(
        None, "fine wrinkles, which carry no compression; none leaves wrinkles to the mesh"
    )
    print_side: Annotated[str, OneOf(PRINT_SIDES)] | None = key(
        None,
        "face of the fabric that carries the print, seen from the pressure; none takes the print "
        "in the fabric's middle",
    )
    print_offset: Length | None = key(
        None,
        "distance from the middle of the fabric to that of the print on its face; none takes the "
        "mean of both thicknesses",
    )
    bladder_young: Modulus = key(
        0.29e6, "Young's modulus of a rubber bladder that moves with the skin"
    )
    bladder_thickness: Length | None = key(None, "thickness of the bladder; none leaves it out")
    knit_ratio: Annotated[float, In(at_least=1)] | None = key(
        None,
        "modulus of the fabric along its courses over that along its wales; none for an isotropic "
        "fabric",
    )
    grain_angle: Angle = key(
        0.0,
        "angle of the courses from the first axis of the flat panels; on a tube 0 is around and 90 "
        "along it",
    )

    NEEDS: ClassVar = {
        "bladder_young": ("bladder_thickness", ()),
        "grain_angle": ("knit_ratio", ()),
    }

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement, with bending, wrinkling, the bladder and the knit."""
        thickness, ratio = self.bladder_thickness, self.knit_ratio
        return replace(
            super().composite,
            bending=None if self.bending is None else Bending(self.bending, self.seams),
            membrane=Membrane(self.wrinkling),
            print_side=self.print_side,
            print_offset=self.print_offset,
            bladder=None if thickness is None else Bladder(self.bladder_young, thickness),
            knit=None if ratio is None else Knit(ratio, float(np.radians(self.grain_angle))),
        )

    def require_symmetric(self, planes: tuple[int, ...]) -> None:
        """Check that a knit has the mirrored grain where the skin is cut at symmetry planes.

        Raises:
            ParameterError: It has not.
        """
        if planes and self.knit_ratio is not None and self.grain_angle % 90:
            raise ParameterError(
                f"grain_angle = {self.grain_angle} deg is not symmetric: the other part would "
                "have the mirrored grain. Set 0 or 90, or design the whole skin.",
                "grain_angle",
            )
