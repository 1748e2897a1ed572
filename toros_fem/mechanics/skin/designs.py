"""What is designed on each triangle: a density, and the lines of a relaxed design."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, override

import numpy as np
from dolfinx import fem

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import together
from toros_fem.base.validation import Floats, checked_floats
from toros_fem.forms.kinematics import interpolate
from toros_fem.forms.lines import Lines, fabric_factor
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.patch_space import cell_space
from toros_fem.meshes.skin import Skin

# Factor c of bonded crossings in `fabric_factor`, over the ratio of the stiffnesses of print and
# fabric: fitted to simulated nets of lines of equal width (docs/discovery.md).
CROSSING = 0.71
# Lines of widths in the ratio r to each other reduce it by 2/(rᵐ + r⁻ᵐ), fitted there as well.
WIDTH_EXPONENT = 1.6


def crossing_of_widths(ratio: float) -> float:
    """Return the factor c of bonded crossings, over the ratio of the stiffnesses of the materials.

    Few wide lines and many thin ones stiffen less than lines of equal width and the same shares.
    The ratio is that of their widths, either way round.
    """
    power = float(ratio) ** WIDTH_EXPONENT
    return 2 * CROSSING / (power + 1 / power)


def check_density(skin: Skin, density: Any) -> Floats:
    """Return owned densities as an array, checked to be in [0, 1] on all ranks (collective)."""
    with together(skin.comm):
        return _checked_density(skin, density)


def _checked_density(skin: Skin, density: Any) -> Floats:
    owned = len(skin.owned_cells)
    what = "one for each owned triangle"
    found = checked_floats("density", density, what, (owned,), finite=False)
    outside = ~((found >= 0) & (found <= 1))
    if outside.any():
        k = int(np.flatnonzero(outside)[0])
        raise ParameterError(
            f"density of triangle {skin.owned_cells[k]} is {found[k]}; it must lie in "
            "[0, 1]. Clip the density, or look for an earlier error."
        )
    return found


class Densities:
    """Design of a projected density ρ̄: one number for each owned triangle.

    Attributes:
        density: ρ̄ as a function.
        lines: Line families in UFL; None.
    """

    lines: Lines | None = None

    def __init__(self, skin: Skin) -> None:
        self.skin = skin
        self.density = fem.Function(skin.density_space, name="projected density")

    @property
    def functions(self) -> Sequence[fem.Function]:
        """The coefficients by which a gradient is asked."""
        return [self.density]

    def check(self, design: Any) -> Floats:
        """Return an owned design as an array, or raise a ParameterError on all ranks."""
        return check_density(self.skin, design)

    def set(self, design: Floats) -> None:
        """Set the coefficients from an owned design."""
        self.density.x.array[: len(design)] = design
        self.density.x.scatter_forward()

    def backward(self, parts: Sequence[Floats]) -> Floats:
        """Return the derivatives by the design from the owned ones by `functions` (collective)."""
        return parts[0]

    @property
    def owned(self) -> Floats:
        """ρ̄ of the owned triangles."""
        return np.asarray(self.density.x.array[: len(self.skin.owned_cells)])

    def mix(self, fabric: float, reinforcement: float) -> Floats:
        """Return a stiffness of the sheet between the lines, of the owned triangles."""
        return np.asarray(interpolate(self.owned, fabric, reinforcement))

    def plain(self, stiffness: float) -> Floats:
        """Return a stiffness that the plain fabric alone has, of the owned triangles."""
        return np.asarray(interpolate(self.owned, stiffness, 0.0))


class LineDesign(Densities):
    """Relaxed design: each triangle carries K families of fine lines beside its fabric.

    It has one row for each owned triangle, (n, 1 + 3 K), with columns ρ̄, the shares s₁ … s_K of
    the area, cos 2t₁ … cos 2t_K and sin 2t₁ … sin 2t_K. t is the angle of the lines from the first
    axis of the panel's flat chart. Only the direction of (cos 2t, sin 2t) counts, not its length;
    the zero vector means t = 0. Linear combinations of designs are designs too.

    `crossing` is the factor c of bonded crossings in `fabric_factor`, over the ratio of the
    stiffnesses of print and fabric. A sheet that wrinkles has no such designs.

    Attributes:
        families: Number K of families.
    """

    def __init__(
        self, skin: Skin, composite: Composite, families: int, crossing: float = CROSSING
    ) -> None:
        if composite.membrane.relaxed:
            raise ParameterError(
                f"wrinkling = {composite.membrane.wrinkling!r}: line families take compression and "
                "have no relaxed energy here. Use wrinkling = None for relaxed designs."
            )
        super().__init__(skin)
        self.families = families
        ratio = composite.reinforcement.membrane_stiffness / composite.fabric.membrane_stiffness
        self._crossing = crossing * ratio
        space, owned = cell_space(skin, 3 * families), len(skin.owned_cells)
        self._values = fem.Function(space, name="line families")
        self.lines = Lines(self._values, fem.Constant(skin.mesh, self._crossing))
        # Rows of the lines' values in the order of the owned densities.
        rows, order = space.dofmap.list[:owned, 0], skin.density_space.dofmap.list[:owned, 0]
        self._rows = rows[np.argsort(order)]
        self._angles: Floats = np.zeros((owned, 2, families))

    @property
    @override
    def functions(self) -> Sequence[fem.Function]:
        return [self.density, self._values]

    @override
    def check(self, design: Any) -> Floats:
        check_density(self.skin, design[:, 0])
        return np.asarray(design)

    @override
    def set(self, design: Floats) -> None:
        super().set(design[:, 0])
        count = self.families
        angles = design[:, 1 + count :].reshape(-1, 2, count)
        self._angles = angles.copy()
        length = np.linalg.norm(angles, axis=1, keepdims=True)
        unit = angles / np.where(length > 0, length, 1.0)
        unit[:, 0] = np.where(length[:, 0] > 0, unit[:, 0], 1.0)
        values = np.concatenate([design[:, None, 1 : 1 + count], unit], axis=1)
        self._values.x.array.reshape(-1, 3, count)[self._rows] = values
        self._values.x.scatter_forward()

    @override
    def backward(self, parts: Sequence[Floats]) -> Floats:
        """Return the derivatives; by the zero vector of an angle, which has none, it is zero."""
        by_lines, lines = self._owned_lines(parts[1]), self._owned_lines(self._values.x.array)
        # Only the part across the vector turns it.
        by_unit, unit = by_lines[:, 1:], lines[:, 1:]
        length = np.linalg.norm(self._angles, axis=1, keepdims=True)
        across = by_unit - unit * (by_unit * unit).sum(axis=1, keepdims=True)
        by_angles = np.where(length > 0, across / np.where(length > 0, length, 1.0), 0.0)
        return np.column_stack([parts[0], by_lines[:, 0], by_angles.reshape(len(lines), -1)])

    @property
    def cover(self) -> Floats:
        """Covered part S of the owned triangles."""
        return np.asarray(self._owned_lines(self._values.x.array)[:, 0].sum(axis=1))

    @override
    def mix(self, fabric: float, reinforcement: float) -> Floats:
        lines = np.moveaxis(self._owned_lines(self._values.x.array), 1, 0)
        shares, cosines, sines = (list(part.T) for part in lines)
        factor = fabric_factor(shares, cosines, sines, self._crossing)
        return np.asarray(factor * super().mix(fabric, reinforcement))

    @override
    def plain(self, stiffness: float) -> Floats:
        return super().plain(stiffness) / (1 - self.cover)

    def _owned_lines(self, values: Floats) -> Floats:
        """Return what belongs to shares, cosines and sines of the owned triangles, (n, 3, K)."""
        return values.reshape(-1, 3, self.families)[self._rows]
