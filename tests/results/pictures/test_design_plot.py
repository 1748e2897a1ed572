"""Start, projected density and print beside each other."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from helpers.scenes import square

from toros_fem.results.pictures.design_plot import plot_design
from toros_fem.results.pictures.drawing import FABRIC, PRINTED


def test_three_stages_of_a_design(tmp_path: Path) -> None:
    """Each third has its own colours: the mean of both, either one by triangle, the print."""
    coarse, fine = square(n=3), square(n=8)
    right = (fine.centroids[:, 0] > 0.5 * fine.flat_points[:, 0].max()).astype(float)
    low, high = fine.flat_points.min(axis=0), fine.flat_points.max(axis=0)
    path = tmp_path / "design.png"
    start = coarse, np.full(len(coarse.panel), 0.5)
    plot_design(path, start, fine, right, [shapely.box(*low, high[0], 0.25 * high[1])])
    thirds = np.array_split(plt.imread(path)[..., :3], 3, axis=1)

    def share(image: np.ndarray, colour: np.ndarray) -> float:
        return float(np.all(np.abs(image - colour) < 0.02, axis=2).mean())

    grey, fabric, printed = (
        [share(third, c) for third in thirds] for c in ((FABRIC + PRINTED) / 2, FABRIC, PRINTED)
    )
    assert grey[0] > 0.4 > 0.01 > max(grey[1:])
    assert 0.4 < printed[1] / (printed[1] + fabric[1]) < 0.6
    assert 0.2 < printed[2] / (printed[2] + fabric[2]) < 0.3
    assert max(fabric[0], printed[0]) < 0.01
