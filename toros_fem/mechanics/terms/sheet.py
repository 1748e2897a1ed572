"""Membrane energy of fabric and print, eqs. (1-3), relaxed by wrinkles, and of a bladder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, override

import numpy as np
from dolfinx import fem, la

from toros_fem.base.array_types import Floats
from toros_fem.forms.energy import LoadForms, SkinForms
from toros_fem.forms.interpolation import interpolate
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.membrane import Logarithm, barrier, neo_hooke, relaxed
from toros_fem.forms.smoothing import Smoothing, likeness
from toros_fem.materials.sheet import Bladder, Composite
from toros_fem.mechanics.skin.coefficients import (
    cell_function,
    cell_space,
    constants,
    lame_constants,
    set_cells,
)
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.skin.hinges import Flaps, find_flaps
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds, StretchBounds
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


class Sheet(Term):
    """Membrane of fabric and print with the energy of eq. (1), and its stretch bounds.

    Attributes:
        flaps: The triangles around, over which strains are smoothed; None: they are not.
    """

    bounds: StretchBounds

    def __init__(
        self, skin: Skin, composite: Composite, supports: Supports, design: Densities
    ) -> None:
        self._design, self._find = design, partial(find_flaps, skin, supports)
        flaps = self._find() if composite.membrane.smoothed else None
        self.flaps = flaps
        if flaps is not None:
            self.smoothing = self._smoothing(skin, composite, flaps)
        thicknesses = composite.fabric.thickness, composite.reinforcement.thickness
        self._mu, self._lam = lame_constants(skin, composite, thicknesses)
        # Owned triangles come first in the mesh, each with flat corners of its own.
        owned = len(skin.owned_cells)
        flat = skin.mesh.geometry.x[: 3 * owned].reshape(owned, 3, 3)[:, :, :2]
        self._limits: tuple[Any, Any]
        if composite.shares_bounds:
            shared, wrinkles = composite.fabric_bounds, composite.membrane.relaxed
            self.bounds = StretchBounds(skin.comm, flat, *shared, wrinkles=wrinkles, flaps=flaps)
            c1, c2 = constants(skin, *shared)
            self._limits = c1, c2
        else:
            self.bounds = MixedBounds(design.density, flat, composite, flaps)
            self._limits = self.bounds.coefficients

    def _smoothing(self, skin: Skin, composite: Composite, flaps: Flaps) -> Smoothing:
        """Return the constants of the flaps as coefficients."""
        both = composite.fabric.membrane_stiffness, composite.reinforcement.membrane_stiffness
        self._stiffnesses, space = both, cell_space(skin, 4)
        self._shares = cell_function(cell_space(skin, 3), flaps.share)
        charts = (flaps.chart[:, k].reshape(-1, 4) for k in range(3))
        self._charts = [cell_function(space, chart) for chart in charts]
        return Smoothing(self._charts, self._shares, self._design.around, constants(skin, *both))

    def _law(self, t: Triangle) -> tuple[Any, Any, Any, Any]:
        """Stiffnesses and bounds of a triangle."""
        return t.mix(*self._mu), t.mix(*self._lam), *self._limits

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return barrier(e, *self._law(t), log)

    @override
    def take_forms(self, forms: SkinForms, load: LoadForms | None, work: la.Vector) -> None:
        if isinstance(self.bounds, MixedBounds):
            self.bounds.take_residual(forms.residual, work)

    @override
    def after_design(self) -> None:
        if isinstance(self.bounds, MixedBounds):
            self.bounds.update()
        if self.flaps is not None:
            self._share_bounds(self.flaps.share)

    def _share_bounds(self, shares: Floats) -> None:
        """Let the bounds take the shares of the triangles around, where they are alike."""
        design, around = self._design, self._design.around
        assert around is not None
        owned = len(design.owned)
        place = around.function_space.dofmap.list[:owned, 0]
        rows = design.density.function_space.dofmap.list[:owned]
        own = interpolate(design.density.x.array[rows], *self._stiffnesses)
        other = interpolate(around.x.array.reshape(-1, 3)[place], *self._stiffnesses)
        self.bounds.set_shares(np.clip(shares[:owned] * likeness(own, other), 0.0, 1.0))

    @override
    def after_move(self) -> None:
        if self.flaps is None:
            return
        flaps = self._find()
        set_cells(self._shares, flaps.share)
        for k, chart in enumerate(self._charts):
            set_cells(chart, flaps.chart[:, k].reshape(-1, 4))

    @contextmanager
    def unsmoothed(self, part: float) -> Iterator[None]:
        """Take a part of the smoothing of strains away within a `with`."""
        assert self.flaps is not None
        shares = self.flaps.share
        self._share((1 - part) * shares)
        try:
            yield
        finally:
            self._share(shares)

    def _share(self, shares: Floats) -> None:
        set_cells(self._shares, shares)
        self._share_bounds(shares)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        both = zip(self._mu, self._lam, strict=True)
        return design.mix(*(2 * float(mu.value) + float(lam.value) for mu, lam in both))


class TensionSheet(Sheet):
    """The same sheet where it wrinkles instead of taking compression."""

    def __init__(
        self, skin: Skin, composite: Composite, supports: Supports, design: Densities
    ) -> None:
        super().__init__(skin, composite, supports, design)
        self._residual = fem.Constant(skin.mesh, composite.membrane.residual_stiffness)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return relaxed(e, *self._law(t), self._residual, log)


class RubberLayer(Term):
    """Neo-Hookean energy of a bladder that stretches with the fabric."""

    def __init__(self, skin: Skin, bladder: Bladder) -> None:
        self._stiffness = bladder.membrane_stiffness
        self._mu = fem.Constant(skin.mesh, self._stiffness / 3)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return neo_hooke(e, self._mu)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return 4 / 3 * self._stiffness  # μ = E/3, λ = 2 μ
