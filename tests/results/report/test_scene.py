"""What is packed into a page is what the run holds, to the stated resolution."""

import base64
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from helpers.runs import STRIPE, bent, tube

from toros_fem.meshes import Pattern
from toros_fem.results.frames.files import Frame, write_frame
from toros_fem.results.frames.shown_skin import ShownSkin, write_skin
from toros_fem.results.report import scene as scene_module
from toros_fem.results.report.run_folder import read_run
from toros_fem.results.report.scene import packed_scene, principal_stretches


class Reader:
    """Reads arrays as the page does."""

    def __init__(self, text: str) -> None:
        self.content = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)

    def __call__(self, entry: dict[str, Any]) -> np.ndarray:
        kind = np.dtype(entry["type"])
        size = kind.itemsize * entry["count"]
        planes = self.content[entry["at"] : entry["at"] + size].reshape(kind.itemsize, -1)
        return np.ascontiguousarray(planes.T).view(kind.newbyteorder("<")).ravel()


def test_positions_come_back_to_the_resolution(run: Path, pattern: Pattern) -> None:
    scene, text = packed_scene(read_run(run))
    read = Reader(text)
    assert scene["step"] < 5e-6
    sums: dict[str, np.ndarray] = {}
    for k, entry in enumerate(scene["series"]["iteration"]):
        for name in ("positions", "density"):
            change = read(entry[name])
            sums[name] = sums.get(name, np.zeros_like(change)) + change
        places = sums["positions"].reshape(-1, 3) * scene["step"] + scene["low"]
        shape = bent(pattern, (k + 1) / 12 * np.pi / 2)
        assert np.abs(places - shape).max() < 0.51 * scene["step"] + 1e-7
    drawn = np.random.default_rng(1).random(len(pattern.triangles))
    assert np.array_equal(sums["density"] == 255, drawn > 0.6)
    assert np.array_equal(sums["density"] == 0, drawn <= 0.6)
    skin = scene["skins"][scene["series"]["iteration"][0]["skin"]]
    assert np.array_equal(read(skin["triangles"]).reshape(-1, 3), pattern.triangles)


def test_the_print_is_cut_and_bordered_exactly(run: Path, pattern: Pattern) -> None:
    scene, text = packed_scene(read_run(run))
    read = Reader(text)
    skin = scene["skins"][scene["series"]["pressure"][0]["skin"]]
    packed = {name: read(entry) for name, entry in skin["print"].items()}
    second, third = packed["weights"].reshape(2, -1) / 65535
    weights = np.column_stack([1 - second - third, second, third])
    ends = np.cumsum(packed["counts"])
    area = 0.0
    for ring, polygon in enumerate(packed["polygons"]):
        if not packed["inside"][polygon]:
            continue
        begin = ends[ring] - packed["counts"][ring]
        points = weights[begin : ends[ring]] @ pattern.corners[packed["cells"][polygon]]
        hole = ring > 0 and packed["polygons"][ring - 1] == polygon
        area += (-1 if hole else 1) * shapely.Polygon(points).area
    caps = pattern.areas[pattern.panel != pattern.panel_index("wall")].sum()
    assert np.isclose(area, STRIPE.area + caps, rtol=1e-4)
    second, third = read(skin["border"]["weights"]).reshape(2, -1) / 65535
    weights = np.column_stack([1 - second - third, second, third])
    cells = np.repeat(read(skin["border"]["cells"]), 2)
    ends = np.einsum("kc,kcd->kd", weights, pattern.corners[cells]).reshape(-1, 2, 2)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert np.isclose(lengths.sum(), STRIPE.length, rtol=1e-3), "the caps' border is a seam"
    assert shapely.distance(STRIPE.boundary, shapely.points(ends)).max() < 1e-6


def test_stretches_of_an_affine_map(tmp_path: Path) -> None:
    """They come back in hundredths, of a skin that has shrunk too."""
    pattern = tube()
    positions = pattern.points * [1.0, 1.0, 1.3]
    wall = pattern.panel == pattern.panel_index("wall")
    stretches = principal_stretches(pattern, positions)[wall]
    assert np.allclose(stretches[:, 1], 1.3, rtol=0.01)
    assert np.allclose(stretches[:, 0], 1.0, atol=0.02)
    (tmp_path / "frames").mkdir()
    name, shrunk = write_skin(tmp_path / "frames", ShownSkin(pattern)), 0.6 * positions
    write_frame(tmp_path / "frames", Frame("iteration", 0, name, shrunk, None, {}))
    scene, text = packed_scene(read_run(tmp_path))
    packed = Reader(text)(scene["series"]["iteration"][0]["stretch"])
    assert np.abs(packed / 100 - principal_stretches(pattern, shrunk)[:, 1]).max() < 5.1e-3


def test_aligned_shapes_lie_on_their_target(tmp_path: Path, pattern: Pattern) -> None:
    (tmp_path / "frames").mkdir()
    target = bent(pattern, 1.0)
    name = write_skin(tmp_path / "frames", ShownSkin(pattern, target, aligned=True))
    c, s = np.cos(0.7), np.sin(0.7)
    moved = target @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) + [0.3, 0.1, -0.2]
    write_frame(tmp_path / "frames", Frame("iteration", 0, name, moved, None, {}))
    scene, text = packed_scene(read_run(tmp_path))
    grid = Reader(text)(scene["series"]["iteration"][0]["positions"]).reshape(-1, 3)
    assert np.abs(grid * scene["step"] + scene["low"] - target).max() < 0.6 * scene["step"]


def test_too_many_shapes_are_thinned(run: Path, pattern: Pattern, monkeypatch: Any) -> None:
    monkeypatch.setattr(scene_module, "MOST_BYTES", 2 * 5 * 6 * len(pattern.points))
    scene, _ = packed_scene(read_run(run))
    numbers = [entry["number"] for entry in scene["series"]["iteration"]]
    assert numbers == [0, 4, 8, 11]
    assert scene["left_out"] == {"pressure": 6, "iteration": 8}
