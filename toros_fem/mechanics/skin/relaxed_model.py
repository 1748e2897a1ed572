"""Model of a relaxed design: triangles carry families of lines beside their fabric."""

from __future__ import annotations

from typing import Any

import basix.ufl
import numpy as np
from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.errors import DensityError, ParameterError
from toros_fem.base.mpi import together
from toros_fem.base.validation import require_between, require_count, require_positive
from toros_fem.forms.lines import Lines, fabric_factor
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.coefficients import assembled, check_density, work_vector
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin

# Factor c of bonded crossings in `fabric_factor`, over the ratio of the stiffnesses of print and
# fabric: fitted to simulated nets of lines of equal width (docs/discovery.md).
CROSSING = 0.71
# Lines of widths in the ratio r to each other reduce it by 2/(rᵐ + r⁻ᵐ), fitted there as well.
WIDTH_EXPONENT = 1.6
# Largest part of a triangle that lines may cover: the fabric between them stiffens as 1/(1 − S).
MAX_COVER = 0.9


def crossing_of_widths(ratio: float) -> float:
    """Return the factor c of bonded crossings, over the ratio of the stiffnesses of the materials.

    Few wide lines and many thin ones stiffen less than lines of equal width and the same shares.

    Args:
        ratio: Width of the lines of one family over those of the other, either way round.

    Raises:
        ParameterError: The ratio is not positive.
    """
    require_positive(ratio=ratio)
    power = float(ratio) ** WIDTH_EXPONENT
    return 2 * CROSSING / (power + 1 / power)


class RelaxedModel(SkinModel):
    """Model of a skin whose triangles carry K families of fine lines beside their fabric.

    Where a density ρ̄ stands elsewhere, a design stands here: one row for each owned triangle,
    (n, 1 + 3 K), with columns ρ̄, the shares s₁ … s_K of the area, cos 2t₁ … cos 2t_K and sin 2t₁ …
    sin 2t_K. t is the angle of the lines from the first axis of the panel's flat chart. Only the
    direction of (cos 2t, sin 2t) counts, not its length; the zero vector means t = 0.

    Attributes:
        families: Number K of families.
        lines: Shares, cosines and sines as a function; the vectors of the angles have length 1.

    Args:
        skin: The sewn skin.
        composite: Lines are made of its reinforcement.
        supports: Fixed components and directions.
        families: Number of families.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        crossing: Factor c of bonded crossings in `fabric_factor`, over the ratio of the stiffnesses
            of print and fabric.

    Raises:
        ParameterError: There is no family, the factor is negative, or the sheet wrinkles; or as
            `SkinModel` does.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        families: int,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        crossing: float = CROSSING,
    ) -> None:
        require_count(1, families=families)
        require_between(0.0, np.inf, crossing=crossing)
        supports.require_no_rigid_motion(skin.pattern, bends=composite.bending is not None)
        if composite.membrane.relaxed:
            raise ParameterError(
                f"wrinkling = {composite.membrane.wrinkling!r}: line families take compression and "
                "have no relaxed energy here. Use wrinkling = None for relaxed designs."
            )
        self.families = families
        print_stiffness = composite.reinforcement.membrane_stiffness
        self._crossing = crossing * print_stiffness / composite.fabric.membrane_stiffness
        element = basix.ufl.element("DG", "triangle", 0, shape=(3 * families,))
        space = fem.functionspace(skin.mesh, element)
        self.lines = fem.Function(space, name="line families")
        owned = skin.mesh.topology.index_map(2).size_local
        self._row = space.dofmap.list[:owned, 0]  # of each triangle among the lines' values
        self._place = skin.density_space.dofmap.list[:owned, 0]  # and among owned values
        self._angles: Floats = np.zeros((owned, 2, families))
        self._lines_sensitivity: Any = None  # compiled for the first gradient
        self._set_up(
            skin,
            composite,
            supports,
            chambers,
            weight,
            closed=supports.close(skin.pattern),
            lines=_coefficients(self.lines, composite, self._crossing),
        )

    def check(self, density: Floats) -> Floats:
        """Return owned rows of a design as an array, with one result on all ranks.

        Raises:
            DensityError: The shape is wrong, a value is not finite, a density leaves [0, 1], a
                share is negative, or lines cover more than `MAX_COVER` of a triangle.
        """
        skin, count = self.skin, self.families
        shape = (len(skin.owned_cells), 1 + 3 * count)
        with together(skin.comm):
            if np.shape(density) != shape:
                raise DensityError(
                    f"the design has shape {np.shape(density)}; on this rank it must be {shape}: "
                    f"density, shares, cosines and sines of {count} families."
                )
        density = np.asarray(density)
        check_density(skin, density[:, 0])
        shares = density[:, 1 : 1 + count]
        cover = shares.sum(axis=1)
        wrong = ~((shares >= 0).all(axis=1) & (cover <= MAX_COVER))
        wrong |= ~np.isfinite(density).all(axis=1)
        with together(skin.comm):
            if wrong.any():
                k = int(np.flatnonzero(wrong)[0])
                raise DensityError(
                    f"the lines of triangle {skin.owned_cells[k]} have the shares {shares[k]}, the "
                    f"sum {cover[k]} and the angles' vectors {density[k, 1 + count :]}; all must "
                    f"be finite, no share below 0, their sum at most {MAX_COVER}. Clip the shares, "
                    "or look for an earlier error."
                )
        return density

    def set_density(self, density: Floats) -> None:
        """Set the design from owned rows; linear combinations of designs are designs too."""
        super().set_density(density[:, 0])
        count = self.families
        angles = density[:, 1 + count :].reshape(-1, 2, count)
        self._angles = angles.copy()
        length = np.linalg.norm(angles, axis=1, keepdims=True)
        unit = angles / np.where(length > 0, length, 1.0)
        unit[:, 0] = np.where(length[:, 0] > 0, unit[:, 0], 1.0)
        values = np.hstack([density[:, 1 : 1 + count], unit.reshape(len(density), -1)])
        self.lines.x.array.reshape(-1, 3 * count)[self._row] = values[self._place]
        self.lines.x.scatter_forward()

    def _owned_lines(self) -> Floats:
        """Return shares, cosines and sines of the owned triangles, (n, 3, K)."""
        values = np.empty((len(self._row), 3 * self.families))
        values[self._place] = self.lines.x.array.reshape(-1, 3 * self.families)[self._row]
        return values.reshape(-1, 3, self.families)

    def density_sensitivity(self, state: Floats, adjoint: Floats) -> Floats:
        """Return ∂(residual · adjoint) by the columns of the design, (n, 1 + 3 K), in J.

        By the zero vector of an angle, where there is no derivative, it is zero.
        """
        by_density = super().density_sensitivity(state, adjoint)
        if self._lines_sensitivity is None:
            self._lines_sensitivity = compiled(self.ufl_forms.lines_sensitivity)
            self._lines_gradient = work_vector(self.lines.function_space)
        count = self.families
        parts = np.empty((len(self._row), 3 * count))
        found = assembled(self._lines_sensitivity, self._lines_gradient)
        parts[self._place] = found.reshape(-1, 3 * count)[self._row]
        # Only the part across the vector turns it.
        by_unit, unit = parts[:, count:].reshape(-1, 2, count), self._owned_lines()[:, 1:]
        length = np.linalg.norm(self._angles, axis=1, keepdims=True)
        across = by_unit - unit * (by_unit * unit).sum(axis=1, keepdims=True)
        by_angles = np.where(length > 0, across / np.where(length > 0, length, 1.0), 0.0)
        return np.column_stack([by_density, parts[:, :count], by_angles.reshape(-1, 2 * count)])

    def _moduli(self, sheet: Floats | float = 1.0, courses: Floats | float = 1.0) -> Floats:
        """Return h (2μ + λ) of fabric and lines of the owned triangles in N/m."""
        shares, cosines, sines = (list(part.T) for part in np.moveaxis(self._owned_lines(), 1, 0))
        cover = np.asarray(sum(shares))
        factor = fabric_factor(shares, cosines, sines, self._crossing)
        fabric = super()._moduli(sheet * factor, courses / (1 - cover))
        return fabric + cover * self.composite.reinforcement.membrane_stiffness


def _coefficients(state: fem.Function, composite: Composite, crossing: float) -> Lines:
    """Return the constants of lines made of the reinforcement."""
    domain, strip = state.function_space.mesh, composite.reinforcement
    h = strip.thickness
    e = composite.eccentricity
    bending = strip.young * h**3 / 12 + e**2 * h * strip.young
    values = [strip.young * h, bending, strip.mu * h**3 / 3, crossing]
    if composite.print_side is not None:
        values.append(e)
    return Lines(state, *(fem.Constant(domain, value) for value in values))
