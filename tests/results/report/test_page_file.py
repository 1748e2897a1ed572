"""The page holds all of a run, and nothing from elsewhere."""

import base64
import csv
import html
import json
import re
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.runs import STRIPE, bent, change_summary, regions_of, tube

from toros_fem.base.errors import FileError, MissingPackageError, OutputError
from toros_fem.making.printability import printed_cells
from toros_fem.measures.figures import Figure
from toros_fem.meshes import Pattern, twist
from toros_fem.meshes.unwrapped import triangle_stretches
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.inflate import InflationResult
from toros_fem.products.tiles.report import TileRun
from toros_fem.results.report import page_file
from toros_fem.results.report.page_file import (
    FlatPatterns,
    eye,
    packed_scene,
    read_summary,
    write_report,
)
from toros_fem.results.report.tables import as_text, key_figures
from toros_fem.results.result import RunResult
from toros_fem.results.runs.frames import Frame, ShownSkin, write_frame, write_skin
from toros_fem.results.runs.record import repeated
from toros_fem.results.runs.stored_run import read_run, summary_of


def test_a_run_is_a_table_of_its_figures(run: Path) -> None:
    table = read_summary(run)._repr_html_()
    assert "<td>angle</td><td>88.2 ± 1.5°</td><td>90 ± 2.7°</td><td>not certain" in table
    change_summary(run, figures=[Figure("<b>", "deg", None).as_dict()])
    assert "&lt;b&gt;</td><td>no equilibrium" in read_summary(run)._repr_html_()


def test_a_view_is_the_page_in_a_frame_of_its_own(run: Path) -> None:
    shown = read_summary(run).show(height=321)
    frame = shown._repr_html_()
    assert "height: 321px" in frame
    assert 'sandbox="allow-scripts"' in frame
    assert frame.count('"') == 6, "the page is escaped"
    assert 'id="canvas"' in shown.page
    assert 'id="figures"' not in shown.page
    assert repr(shown) == "EmbeddedPage(height=321)", "beside HTML a notebook keeps this text"
    with pytest.raises(FileError, match="is no folder"):
        read_summary(run / "missing").show()


def test_a_result_is_told_in_a_line() -> None:
    """A notebook and a console show it, and not the arrays of a run."""
    known = [*RunResult.__subclasses__()]
    for kind in known:
        known += kind.__subclasses__()
    assert {SkinDesign, InflationResult, TileRun} < set(known)
    assert [kind for kind in known if kind.__repr__ is not RunResult.__repr__] == []
    empty = object.__new__(SkinDesign)
    assert repr(empty) == "SkinDesign()"
    object.__setattr__(empty, "folder", Path("output/bend"))
    assert repr(empty) == "SkinDesign('output/bend')"


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
def test_a_missing_package_is_named_with_its_extra(
    run: Path, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.partition(".")[0] == package:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackageError, match=rf"{package}.*pip install '\.\[plot\]'"):
        write_report(run)


def test_tables_have_one_line_of_names_and_plain_numbers(run: Path) -> None:
    """So that `pandas.read_csv` needs no arguments."""
    for name in ("history.csv", "curve.csv"):
        text = (run / name).read_text(encoding="ascii")
        head, *rows = csv.reader(text.splitlines())
        assert all(name.isidentifier() for name in head)
        assert len(set(head)) == len(head)
        assert len(rows) == text.count("\n") - 1 > 1
        assert all([float(value) for value in row] and len(row) == len(head) for row in rows)


def scene_of(page: str) -> dict:
    found = re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def test_all_parts_are_there(run: Path) -> None:
    path = write_report(run)
    assert path == run / "report.html"
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"@[A-Z]+@", page), "every place is filled"
    for text in ("88.25°", "± 1.5°", "90°", "89°", "fabric", "summary.json", "1.0", "cone"):
        assert text in page
    assert page.count('<svg class="chart"') == 2, "one over the pressure, one over iterations"
    assert "70° (paper)" in page
    scene = scene_of(page)
    assert scene["start"] == {"series": "pressure", "index": 4}
    assert [entry["label"] for entry in scene["series"]["iteration"]][-1] == "11 of 11"
    assert ["angle", "60°"] in scene["series"]["pressure"][4]["shown"]
    assert ">88.2 ± 1.5°<" in page, "what the summary says, on the curve"
    change_summary(run, figures=[Figure("pressure", "pa", 2e4).as_dict()])
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "at 20 kPa" not in page, "the curve ends before it"


def test_a_finer_mesh_is_named(run: Path) -> None:
    for other, said in (("1.5", False), ("0.5", True)):
        change_summary(run, errors={"meshes": {"1.0": {}, other: {}}})
        page = write_report(run).read_text(encoding="utf-8")
        assert ("key figures those of a finer one" in page) is said
        assert ("dots with intervals are of a finer mesh" in page) is said


def test_an_interval_that_is_not_known_is_told_in_words(run: Path) -> None:
    """Warnings tell the reason."""
    told = Figure("angle", "deg", 88.25, None, 90.0, 2.7).as_dict()
    change_summary(run, figures=[told])
    (line,) = key_figures(read_run(run)).rows
    assert line[2] == "not estimated"
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "not estimated" in page
    assert "not certain (error not estimated)" in as_text(summary_of(run))


def test_nothing_is_fetched(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    assert "default-src 'none'" in page
    own = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    links = re.findall(r'(?:src|href)="([^"]*)"', own)
    assert links
    assert not [link for link in links if re.match(r"(https?:)?//", link)]
    assert set(re.findall(r"https?://[\w./]+", page)) <= {
        "http://www.w3.org/1999/xhtml", "http://www.w3.org/2000/svg",
    }  # fmt: skip


def test_names_of_panels_are_no_identifiers(run: Path) -> None:
    """A panel may be called like a part of the page."""
    named = {f"<title>{name}</title>" for name in ("wall", "base", "tip")}
    page = write_report(run).read_text(encoding="utf-8")
    assert all(title in page for title in named)
    body = re.sub(r'<script.*?</script>|<svg class="chart".*?</svg>', "", page, flags=re.DOTALL)
    known = re.findall(r'\bid="([^"]*)"', body)
    assert known
    assert len(set(known)) == len(known)
    assert not {"wall", "base", "tip"} & set(known)


def test_what_is_unusual_is_told(run: Path) -> None:
    """In the page and in the terminal; of a run without a summary, by its frames."""
    warnings = ["At 10 kPa: It is near a limit point.", "1 place is narrower than <that>."]
    change_summary(run, manufacture={"pieces": 3, "islands": 1}, warnings=warnings)
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    for text in (*warnings, "of these 1 island<"):
        assert text in page
    assert as_text(read_run(run).summary).endswith("Warnings:\n  " + "\n  ".join(warnings))
    (run / "summary.json").unlink()
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "This run has no summary" in page
    assert "At 10 kPa: It is near a limit point." in page


def test_the_page_says_what_was_missed(run: Path) -> None:
    """By how much, what binds, and the state of each figure, those of the shape too."""
    figures = [
        Figure("angle", "deg", 80.0, 1.5, 90.0, 2.7),
        Figure("shape_distance", "percent", 2.0, 0.5, 0.0, 3.0),
        Figure("tip_distance", "mm", 4.0, 0.5, 0.0),
    ]
    change_summary(
        run,
        figures=[figure.as_dict() for figure in figures],
        verdict={"state": "missed", "words": "", "binding": ["pressure at its bound, 5 kPa"]},
    )
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    for text in (
        '<section id="verdict"><h2>Missed</h2>',
        "<p>Angle 10.0° short of 90° (± 1.5°; within 2.7° is reached).</p>",
        "<p>What binds: pressure at its bound, 5 kPa.</p>",
        "<td>90 ± 2.7°</td>",
        ">shape distance</t",
        ">tip distance</t",
        "<td>reached</td>",
        "<td>missed</td>",
    ):
        assert text in page
    change_summary(run, figures=[Figure("angle", "deg", 80.0).as_dict()], verdict=None)
    assert 'id="verdict"' not in write_report(run).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["history.csv", "curve.csv"])
def test_a_row_that_a_kill_cut_off_is_left_out(run: Path, name: str) -> None:
    whole = (run / name).read_bytes()
    rows = whole.count(b"\n") - 1
    for missing in (2, 5, 9):
        (run / name).write_bytes(whole[:-missing])
        found = read_run(run)
        assert len(found.history if name == "history.csv" else found.curve) == rows - 1
        write_report(run)


def test_the_name_of_a_folder_is_no_place_to_fill(run: Path) -> None:
    named = run.rename(run.with_name("my @DATA@ run"))
    page = write_report(named).read_text(encoding="utf-8")
    assert "<h1>my @DATA@ run</h1>" in page
    assert "<title>my @DATA@ run – toros_fem</title>" in page


def test_a_run_without_a_curve_shows_its_print(run: Path) -> None:
    (run / "curve.csv").unlink()
    for path in (run / "frames").glob("pressure-*"):
        if path.stem == "pressure-000004":
            path.rename(path.with_name("print-000000.npz"))
        else:
            path.unlink()
    scene = scene_of(write_report(run).read_text(encoding="utf-8"))
    assert [entry["label"] for entry in scene["series"]["pressure"]] == ["5 kPa"]


def test_history_alone_makes_a_report(run: Path) -> None:
    for path in (*run.glob("frames/*"), run / "summary.json", run / "curve.csv"):
        path.unlink()
    page = write_report(run).read_text(encoding="utf-8")
    assert scene_of(page) == {"series": {}}
    assert page.count('<svg class="chart"') == 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("summary.json", "{", "summary.json cannot be read"),
        ("summary.json", "[]", "holds no table"),
        ("summary.json", '{"angle_deg": 1.0}', "written by an earlier version of toros_fem"),
        ("summary.json", '{"figures": [{"name": "angle"}]}', "is no figure"),
        ("summary.json", '{"figures": [], "inputs": [3], "seconds": "x"}', "no run writes"),
        ("history.csv", "a,b\n1,x\n", "history.csv cannot be read"),
        ("history.csv", "iteration,objectiv\n1,2\n", "line 2 has not .* and objective"),
        ("history.csv", "iteration,objective,x\n1,2,3\n1,2\n", "line 3 has not as many cells"),
        ("curve.csv", "pressure_pa,x\n1,2,3\n", "line 2 has not as many cells"),
        ("frames/iteration-000003.npz", "no archive", "iteration-000003.npz cannot be read"),
    ],
)
def test_damaged_files_are_named(run: Path, name: str, content: str, words: str) -> None:
    (run / name).write_text(content, encoding="utf-8")
    with pytest.raises(OutputError, match=words):
        write_report(run)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="holds neither frames"):
        write_report(tmp_path)
    with pytest.raises(FileError, match="is no folder"):
        write_report(tmp_path / "missing")
    (tmp_path / "frames").mkdir()
    with pytest.raises(FileError, match="holds neither frames"):
        write_report(tmp_path)


def test_a_table_may_hold_the_direction_of_a_pull(run: Path) -> None:
    """Of a sheet of tiles `toros view` failed: "could not convert string to float: 'x'"."""
    (run / "curve.csv").write_text("direction,strain\nx,0.01\ny,0.02\n", encoding="utf-8")
    assert read_run(run).curve == [{"strain": 0.01}, {"strain": 0.02}]
    write_report(run)


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
