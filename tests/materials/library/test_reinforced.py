"""The reinforced sheet is as stiff as the laminate."""

from dataclasses import replace

import numpy as np
import pytest

from toros_fem.materials.library.files import read_library
from toros_fem.materials.sheet import Material, print_offset, reinforced


def laminate(layers: list[Material]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and D − B A⁻¹ B of layers upon each other, by quadrature over the thickness.

    B is about the middle of the first layer.
    """
    A, B, D = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    bottom = -layers[0].thickness / 2
    for layer in layers:
        nu, z = layer.poisson, bottom + layer.thickness * (np.arange(400) + 0.5) / 400
        Q = layer.young / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        dz = layer.thickness / 400
        A += Q * layer.thickness
        B += Q * z.sum() * dz
        D += Q * (z**2).sum() * dz
        bottom += layer.thickness
    return A, B, D - B @ np.linalg.solve(A, B)


@pytest.mark.parametrize("nu", [0.3, 0.48])
def test_stretching_and_bending(nu: float) -> None:
    fabric, layer = Material(0.8e6, 0.3, 0.7e-3), Material(5e6, nu, 0.4e-3)
    A, B, D = laminate([fabric, layer])
    sheet = reinforced(fabric, layer)
    A_one, _, D_one = laminate([sheet])
    assert A_one == pytest.approx(A, rel=1e-12)
    assert D_one[0, 0] == pytest.approx(D[0, 0], rel=1e-4 if nu == 0.3 else 0.02)
    assert A[0, 0] * print_offset(fabric, layer) == pytest.approx(B[0, 0], rel=1e-12)
    if nu == 0.3:
        assert D_one == pytest.approx(D, rel=1e-4, abs=1e-12)


def test_a_stiff_layer_on_a_soft_fabric_is_nearly_the_layer() -> None:
    library = read_library()
    fabric, layer = library["jersey-light"].material, library["tpu-95a"].material
    sheet = reinforced(fabric, layer)
    assert sheet.young * sheet.thickness == pytest.approx(13052, abs=1)
    assert sheet.thickness == pytest.approx(layer.thickness, rel=0.02)
    assert sheet.poisson == pytest.approx(layer.poisson, rel=2e-3)
    same = reinforced(layer, layer)
    assert same.thickness == pytest.approx(2 * layer.thickness)
    assert same.young == pytest.approx(layer.young)


def test_bounds_are_the_tighter_ones() -> None:
    fabric, layer = Material(1e5, 0.3, 5e-4, c1=1.9, c2=2.1), Material(2e7, 0.3, 5e-4)
    for own, expected in (
        ((None, None), (1.9, 2.1)),
        ((1.5, None), (1.5, 2.1)),
        ((2.0, 1.8), (1.9, 1.8)),
    ):
        sheet = reinforced(fabric, replace(layer, c1=own[0], c2=own[1]))
        assert (sheet.c1, sheet.c2) == expected
    assert reinforced(layer, layer).c1 is None
