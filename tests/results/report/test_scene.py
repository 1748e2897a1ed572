"""What is packed into a page is what the run holds, to the stated resolution."""

import base64
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.runs import STRIPE, bent, regions_of, tube

from toros_fem.making.print.printability import printed_cells
from toros_fem.meshes import Pattern, twist
from toros_fem.meshes.surfaces.flatten import triangle_stretches
from toros_fem.results.report import page_file
from toros_fem.results.report.page_file import (
    FlatPatterns,
    eye,
    packed_scene,
)
from toros_fem.results.runs.frames import Frame, ShownSkin, write_frame, write_skin
from toros_fem.results.runs.record import repeated
from toros_fem.results.runs.stored_run import read_run


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
    scene, text, _ = packed_scene(read_run(run))
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
    assert np.array_equal(read(skin["sewn"])[read(skin["triangles"])], pattern.triangles.ravel())


def in_mm(text: str) -> shapely.Geometry:
    """The region of path data, filled by the even-odd rule."""
    rings = [re.findall(r"(-?[\d.]+),(-?[\d.]+)", ring) for ring in text.split("Z") if ring.strip()]
    lines = shapely.union_all([shapely.linearrings(np.array(r, dtype=float)) for r in rings])
    return shapely.build_area(shapely.node(lines))


def test_the_print_is_that_of_the_panels_at_its_places(run: Path, pattern: Pattern) -> None:
    """A point of a panel, seen in its drawing, is printed where the region has it."""
    scene, text, (drawn,) = packed_scene(read_run(run))
    skin = scene["skins"][scene["series"]["pressure"][0]["skin"]]
    assert skin["pattern"] == 0
    assert [panel["name"] for panel in drawn["panels"]] == list(pattern.panel_names)
    size = [drawn["width"], drawn["height"]]
    places = (Reader(text)(skin["places"]).reshape(-1, 2) / 65535 * size)[pattern.flat_triangles]
    for k, panel in enumerate(drawn["panels"]):
        printed, cut = in_mm(panel["print"]), in_mm(panel["cut"])
        region = regions_of(pattern)[k]
        assert np.isclose(printed.area, 1e6 * region.area, rtol=1e-5)
        here = pattern.panel == k
        assert np.isclose(cut.area, 1e6 * pattern.areas[here].sum(), rtol=1e-5)
        # Upwards from the lower border of the drawing.
        origin = [panel["x"], drawn["height"] - panel["y"]]
        corners = 1e3 * pattern.corners[here]
        assert np.abs(places[here] - origin - corners).max() < 0.51 * max(size) / 65535
        assert places[here].min(axis=(0, 1)).min() > 0
    boxes = [
        shapely.MultiPoint(places[pattern.panel == k].reshape(-1, 2)).envelope for k in range(3)
    ]
    assert min(boxes[0].distance(boxes[1]), boxes[1].distance(boxes[2])) > 9


def test_copies_of_a_skin_share_its_drawing(run: Path, pattern: Pattern) -> None:
    """Another print has a drawing of its own."""
    patterns = FlatPatterns()
    regions = regions_of(pattern)
    one, places = patterns.of(ShownSkin(pattern, regions=regions))
    every, prints = repeated(pattern, regions, 3)
    three, copies = patterns.of(ShownSkin(every, regions=prints))
    assert one == three == 0
    assert np.array_equal(copies, np.tile(places, (3, 1)))
    other, _ = patterns.of(ShownSkin(pattern, regions=regions[::-1]))
    assert other == 1
    assert len(patterns.shown) == 2


def test_the_best_view_shows_the_print(pattern: Pattern) -> None:
    """The stripe lies at one side of the tube."""
    x, y, z = eye(ShownSkin(pattern, regions=regions_of(pattern)), None, pattern.points)
    stripe = printed_cells(pattern, [STRIPE, shapely.Polygon(), shapely.Polygon()])
    middle = pattern.points[pattern.triangles[stripe]].mean(axis=(0, 1)) - pattern.points.mean(
        axis=0
    )
    assert np.isclose(np.hypot(np.hypot(x, y), z), 1)
    assert (middle[0] * x + middle[1] * y) / np.hypot(*middle[:2]) > 0.8
    assert z > 0


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8)])
def test_a_ground_is_two_triangles_that_face_outwards(
    tmp_path: Path, pattern: Pattern, normal: tuple[float, float, float]
) -> None:
    """They lie in its plane, around the middle of what is shown; it is looked at from above."""
    frames = tmp_path / "frames"
    frames.mkdir()
    point = (0.3, 0.0, -0.01)
    name = write_skin(frames, ShownSkin(pattern, grounds=np.array([(point, normal)])))
    write_frame(frames, Frame("gait", 0, name, pattern.points, None, {}))
    scene, _, _ = packed_scene(read_run(tmp_path))
    corners = np.reshape(scene["skins"][name]["grounds"], (-1, 3, 3)) / 1e3 + scene["low"]
    assert np.abs((corners - point) @ normal).max() < 1e-9
    for a, b, c in corners:
        face = np.cross(b - a, c - a)
        assert np.allclose(face / np.linalg.norm(face), normal)
    size = 65535 * scene["step"]
    middle = np.array(scene["low"]) + size / 2
    assert np.linalg.norm(np.cross(corners.mean(axis=(0, 1)) - middle, normal)) < 0.1 * size
    assert scene["from"]["gait"][2] > 0


def test_stretches_of_an_affine_map(tmp_path: Path) -> None:
    """They come back in hundredths, of a skin that has shrunk too."""
    pattern = tube()
    positions = pattern.points * [1.0, 1.0, 1.3]
    wall = pattern.panel == pattern.panel_index("wall")
    stretches = triangle_stretches(pattern.corners, positions[pattern.triangles])[wall]
    assert np.allclose(stretches[:, 0], 1.3, rtol=0.01)
    assert np.allclose(stretches[:, 1], 1.0, atol=0.02)
    (tmp_path / "frames").mkdir()
    name, shrunk = write_skin(tmp_path / "frames", ShownSkin(pattern)), 0.6 * positions
    write_frame(tmp_path / "frames", Frame("iteration", 0, name, shrunk, None, {}))
    scene, text, _ = packed_scene(read_run(tmp_path))
    packed = Reader(text)(scene["series"]["iteration"][0]["stretch"])
    largest = triangle_stretches(pattern.corners, shrunk[pattern.triangles])[:, 0]
    assert np.abs(packed / 100 - largest).max() < 5.1e-3


def test_aligned_shapes_lie_on_their_target(tmp_path: Path, pattern: Pattern) -> None:
    (tmp_path / "frames").mkdir()
    target = bent(pattern, 1.0)
    name = write_skin(tmp_path / "frames", ShownSkin(pattern, target, aligned=True))
    c, s = np.cos(0.7), np.sin(0.7)
    moved = target @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) + [0.3, 0.1, -0.2]
    write_frame(tmp_path / "frames", Frame("iteration", 0, name, moved, None, {}))
    scene, text, _ = packed_scene(read_run(tmp_path))
    grid = Reader(text)(scene["series"]["iteration"][0]["positions"]).reshape(-1, 3)
    assert np.abs(grid * scene["step"] + scene["low"] - target).max() < 0.6 * scene["step"]


def test_an_outline_is_as_long_as_the_last_shape_where_no_length_is_asked(
    tmp_path: Path, pattern: Pattern
) -> None:
    (tmp_path / "frames").mkdir()
    target, compared = twist(1.0, 0.15)(pattern.points), (True, True, False)
    name = write_skin(tmp_path / "frames", ShownSkin(pattern, target, compared=compared))
    longer = target * [1.0, 1.0, 1.16]
    for number, shape in enumerate((target, longer)):
        write_frame(tmp_path / "frames", Frame("iteration", number, name, shape, None, {}))
    scene, text, _ = packed_scene(read_run(tmp_path))
    grid = Reader(text)(scene["skins"][name]["target"]).reshape(-1, 3)
    assert np.abs(grid * scene["step"] + scene["low"] - longer).max() < 0.6 * scene["step"]


def test_too_many_shapes_are_thinned(run: Path, pattern: Pattern, monkeypatch: Any) -> None:
    monkeypatch.setattr(page_file, "MOST_BYTES", 2 * 5 * 6 * len(pattern.points))
    scene, _, _ = packed_scene(read_run(run))
    numbers = [entry["number"] for entry in scene["series"]["iteration"]]
    assert numbers == [0, 4, 8, 11]
    assert scene["left_out"] == {"pressure": 6, "iteration": 8}
