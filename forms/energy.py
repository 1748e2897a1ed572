"""Total energy of a skin, its first variation and its tangent, eqs. (8-10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.bending import Edges, bending_blocks, bending_energy, curvature, moment
from toros_fem.forms.blocks import Blocks, balanced_sum, components, sum_of_pairs
from toros_fem.forms.eccentric import Offset, coupling_moment, coupling_stress
from toros_fem.forms.interpolation import interpolate
from toros_fem.forms.kinematics import (
    CELL,
    deformation_gradient,
    flat_area,
    right_cauchy_green,
    stretch_invariants,
)
from toros_fem.forms.lines import (
    Family,
    Lines,
    bending_stiffness,
    stretching_energy,
    stretching_pairs,
    stretching_stress,
)
from toros_fem.forms.membrane import (
    barrier_membrane,
    barrier_value,
    membrane_pairs,
    neo_hooke,
    squared_difference,
)
from toros_fem.forms.periodic import placed
from toros_fem.forms.pressure import enclosed_volume, pressure_blocks
from toros_fem.forms.tension_field import (
    relaxed_membrane,
    relaxed_value,
    tension_field,
    tension_pairs,
    tension_stress,
)
from toros_fem.forms.weight import weight_potential


@dataclass(frozen=True)
class SheetStiffness:
    """Membrane and bending stiffness of one material, as UFL constants.

    Attributes:
        mu, lam: Membrane Lamé parameters times thickness, in N/m.
        mu_bend, lam_bend: The same times h³/12 instead of h, in N m.
    """

    mu: Any
    lam: Any
    mu_bend: Any
    lam_bend: Any


@dataclass(frozen=True)
class Masses:
    """Masses of two materials, as UFL constants.

    Attributes:
        fabric, reinforcement: Mass per flat area in kg/m².
        gravity: Acceleration in m/s², a vector.
    """

    fabric: Any
    reinforcement: Any
    gravity: Any


@dataclass(frozen=True)
class SkinForms:
    """UFL forms of one skin; `None` where it has no such term.

    Attributes:
        energy: E of eq. (8), in J.
        volume: Enclosed volume, in m³; of several chambers the sum weighted by `chosen`.
        residual: First variation of E, the negative of the force of eq. (9), in N.
        volume_variation: First variation of the volume, in m²: the force of a unit pressure.
        weight: First variation of the weight's potential, in N: the negative of its force.
        tangent: Entries of the second variation of E, in N/m: for each triangle the upper
            triangle of its element matrix, row by row, as a linear form on piecewise constants.
        sensitivity: ∂(residual · adjoint)/∂ρ̄ as a linear form on the density space, in J.
        lines_sensitivity: The same by the state of the lines, on its space.
    """

    energy: Any
    volume: Any | None
    residual: Any
    volume_variation: Any | None
    weight: Any | None
    tangent: Any
    sensitivity: Any
    lines_sensitivity: Any | None


def skin_forms(
    q: Any,
    adjoint: Any,
    entries: Any,
    density: Any,
    fabric: SheetStiffness,
    reinforcement: SheetStiffness,
    bounds: tuple[Any, Any],
    pressure: Any | None,
    chosen: Any | None,
    geometric: Any,
    edges: Edges | None,
    bladder: Any | None,
    masses: Masses | None,
    shifts: Sequence[Any] | None = None,
    lines: Lines | None = None,
    knit: Family | None = None,
    origin: Any | None = None,
    residual_stiffness: Any | None = None,
    offset: Offset | None = None,
) -> SkinForms:
    """Return energy, first variation, tangent and density sensitivity of a skin, eqs. (8-10, 19).

    UFL derives the first variations of membrane, pressure and weight, and the sensitivity. Written
    by hand are the first variations of bending and of lines (`curvature`, `stretching_stress`) and
    the tangent (`membrane_pairs`, `stretching_pairs`, `bending_blocks`, `pressure_blocks`);
    tests/forms ties both to `ufl.derivative`.

    Args:
        q: Patch positions: a function of three corners; with bending of three flaps too, and of
            the rotation unknowns as a seventh vector, if there are any.
        adjoint: A function of the same space, for the density sensitivity.
        entries: Test function of the tangent's entries: n(n + 1)/2 piecewise constants for a
            patch of n components.
        density: Projected density ρ̄, one value a triangle.
        fabric, reinforcement: Stiffness of the two materials.
        bounds: c₁ and c₂ of eq. (1).
        pressure: Pressure in Pa; None for a skin without pressure.
        chosen: With several chambers, the weight of each in the volume; None for one.
        geometric: 1 for the tangent, 0 for its material part.
        edges: Constants of each triangle's edges; None for a skin without bending.
        bladder: Shear modulus times thickness of a rubber layer, in N/m; None for none.
        masses: Masses of the materials; None for a skin without weight.
        shifts: Lattice shifts of the corners and flaps of a tile that repeats, as for `placed`;
            then F̄n and F̄t are the patch's last two vectors. None otherwise.
        lines: Line families of a relaxed design; they stiffen the fabric between them, in
            stretching and in bending. None for a skin without.
        knit: Courses of the plain fabric, which the reinforcement does not have; None where the
            fabric is isotropic.
        residual_stiffness: Fraction of the stiffness that a tension field keeps against
            compression; None for a sheet that takes compression as eq. (1) does.
        offset: That of the reinforcement, without families; None for a print in the fabric's
            middle.
    """
    space = q.ufl_function_space()
    mesh = space.ufl_domain()
    test = ufl.TestFunction(space)
    jacobian = ufl.Jacobian(mesh)
    dx = ufl.dx(domain=mesh, metadata=CELL)
    patch, variations = ufl.split(q), ufl.split(test)
    if shifts is not None:
        patch, variations = placed(patch, shifts), placed(variations, shifts)
    corners = patch[:3]

    families = [] if lines is None else lines.families
    factor = None if lines is None else lines.fabric_factor
    if knit is not None:
        plain = interpolate(density, 1, 0)
        families.append(knit.weighted(plain if lines is None else plain * lines.gap_factor))

    def mixed(name: str) -> Any:
        value = interpolate(density, getattr(fabric, name), getattr(reinforcement, name))
        return value if factor is None else factor * value

    C = right_cauchy_green(deformation_gradient(corners, jacobian))
    s, p = stretch_invariants(C)
    sheet = mixed("mu"), mixed("lam")
    state = None
    # Bounds of their own may be narrow: then the strains need all their digits.
    narrow = not all(isinstance(bound, ufl.Constant) for bound in bounds)
    if residual_stiffness is None:
        energy = barrier_value(C, *sheet, *bounds) * dx
        difference = squared_difference(C, s) if narrow else None
        stretching = barrier_membrane(s, p, *sheet, *bounds, difference)
    else:
        state = tension_field(C, *sheet, *bounds)
        energy = relaxed_value(C, sheet, bounds, residual_stiffness) * dx
        stretching = relaxed_membrane(s, p, state, sheet, bounds, residual_stiffness)
    if bladder is not None:
        energy += neo_hooke(s, p, bladder) * dx
        stretching += neo_hooke(s, p, bladder)
    nodes = [components(node) for node in patch]
    blocks = Blocks(len(nodes))
    if state is None:
        pairs = membrane_pairs(
            nodes[:3], jacobian, sheet, bounds, bladder, geometric, narrow=narrow
        )
    else:
        pairs = sum_of_pairs(
            membrane_pairs(
                nodes[:3], jacobian, sheet, bounds, bladder, geometric,
                lambda s, p: relaxed_membrane(s, p, state, sheet, bounds, residual_stiffness),
            ),
            tension_pairs(nodes[:3], jacobian, sheet, bounds, residual_stiffness),
        )  # fmt: skip
    if families:
        energy += stretching_energy(families, C) * dx
        more = stretching_pairs(families, nodes[:3], jacobian, geometric)
        pairs = sum_of_pairs(pairs, more)
    residual = ufl.derivative(stretching * dx, q, test)
    change = ufl.derivative(C, q, test)
    if state is not None:
        stress = tension_stress(state, sheet, bounds, residual_stiffness)
        residual += ufl.inner(stress, change) * dx
    if families:
        residual += ufl.inner(stretching_stress(families, C), change) * dx
    blocks.add_edges(pairs)

    if edges is not None:
        Lambda, variation = curvature(patch, variations, edges)
        stiffness = mixed("mu_bend"), mixed("lam_bend")
        D = bending_stiffness(families) if families else None
        energy += bending_energy(Lambda, *stiffness, D) * dx
        residual += ufl.inner(moment(Lambda, *stiffness, D), variation) * dx
        if offset is not None:
            printed = density if factor is None else factor * density
            offset = offset.weighted(printed)
            if lines is not None:
                offset = Offset(offset.mu, offset.lam, lines.offset_families)
            strain_moment = coupling_moment(C, offset)
            energy += ufl.inner(strain_moment, Lambda) * dx
            residual += ufl.inner(strain_moment, variation) * dx
            residual += ufl.inner(coupling_stress(C, Lambda, offset), change) * dx
        bending_blocks(blocks, patch, edges, stiffness, geometric, D, offset, jacobian)

    weight = None
    if masses is not None:
        printed = density if lines is None else density + lines.cover
        mass = interpolate(printed, masses.fabric, masses.reinforcement)
        potential = weight_potential(nodes[:3], mass, masses.gravity) * dx
        weight = ufl.derivative(potential, q, test)
        energy += potential
        residual += weight

    # Only stiffness and weight depend on the density: the pressure is left out.
    parts = ufl.replace(residual, {test: adjoint})
    sensitivity, lines_sensitivity = (
        ufl.derivative(parts, by, ufl.TestFunction(by.ufl_function_space()))
        if by is not None
        else None
        for by in (density, None if lines is None else lines.state)
    )

    volume = volume_variation = None
    if pressure is not None:
        arms = corners if origin is None else [corner - origin for corner in corners]
        enclosed = enclosed_volume(arms) / flat_area(jacobian)
        volume = (enclosed if chosen is None else chosen * enclosed) * dx
        volume_variation = ufl.derivative(volume, q, test)
        energy += -pressure * enclosed * dx
        residual += ufl.derivative(-pressure * enclosed * dx, q, test)
        pressure_blocks(blocks, [components(arm) for arm in arms], jacobian, geometric * pressure)

    tangent = balanced_sum([value * entries[n] for n, value in enumerate(blocks.upper())]) * dx
    return SkinForms(
        energy,
        volume,
        residual,
        volume_variation,
        weight,
        tangent,
        sensitivity,
        lines_sensitivity,
    )
