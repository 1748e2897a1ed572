"""Cut files hold their layers true to scale, as independent readers find."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.panels import pattern_of, striped
from shapely.geometry import LinearRing, Polygon

from toros_fem.making.panels import ManufactureOptions, PanelDrawing, panel_drawings
from toros_fem.making.sheets import write_cut_dxf, write_cut_svg
from toros_fem.making.sheets.cut_files import LAYERS

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
SHEET = 0.45, 0.3


def sheet_of(kind: str) -> list[PanelDrawing]:
    """All panels side by side on a sheet."""
    pattern = pattern_of(kind)
    x, placed = 0.02, []
    for drawing in panel_drawings(pattern, striped(pattern), ManufactureOptions()):
        left, low, right, _ = drawing.footprint.bounds
        placed.append(drawing.moved(0.0, np.array([x - left, 0.02 - low])))
        x += right - left + 5e-3
    assert x < SHEET[0]
    return placed


def rings_of(shape: shapely.Geometry) -> list[np.ndarray]:
    return [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(shape))]


def areas(rings: list[np.ndarray]) -> np.ndarray:
    return np.sort([Polygon(ring).area for ring in rings])


@pytest.mark.parametrize("kind", ["tube", "gripper", "sphere"])
def test_dxf(kind: str, tmp_path: Path) -> None:
    """What is pinned, lines and texts of each layer, is not looked at again."""
    ezdxf = pytest.importorskip("ezdxf", reason="ezdxf is not installed")
    drawings = sheet_of(kind)
    write_cut_dxf(tmp_path / "cut.dxf", drawings, SHEET)
    document = ezdxf.readfile(tmp_path / "cut.dxf")
    assert not document.audit().errors
    assert document.header["$INSUNITS"] == 4  # mm
    assert document.header["$MEASUREMENT"] == 1  # metric
    assert set(LAYERS) <= {layer.dxf.name for layer in document.layers}
    space = document.modelspace()

    def lines(layer: str, *, closed: bool) -> list[np.ndarray]:
        found = space.query(f'LWPOLYLINE[layer=="{layer}"]')
        return [np.array(line.get_points("xy")) for line in found if line.closed == closed]

    printed = lines("print", closed=True)
    assert not lines("print", closed=False)
    # Outer rings are counter-clockwise, holes clockwise.
    signed = [Polygon(ring).area * (1 if LinearRing(ring).is_ccw else -1) for ring in printed]
    assert min(signed) < 0
    assert sum(signed) == pytest.approx(1e6 * sum(d.printed.area for d in drawings), rel=1e-6)
    lengths = [np.linalg.norm(line[-1] - line[0]) for line in lines("marks", closed=False)]
    assert max(lengths) == pytest.approx(100, rel=1e-9)  # the ruler


def path_rings(data: str) -> list[np.ndarray]:
    return [
        np.array([[float(v) for v in pair.split(",")] for pair in ring.strip(" Z").split("L")])
        for ring in data.split("M")[1:]
    ]


@pytest.mark.parametrize("kind", ["tube", "gripper", "sphere"])
def test_svg(kind: str, tmp_path: Path) -> None:
    drawings = sheet_of(kind)
    write_cut_svg(tmp_path / "cut.svg", drawings, SHEET)
    root = ET.parse(tmp_path / "cut.svg").getroot()
    assert (root.get("width"), root.get("height")) == ("450.000mm", "300.000mm")
    assert root.get("viewBox") == "0 0 450.000 300.000"
    layers = {group.get("id"): group for group in root.findall(f"{SVG}g")}
    assert list(layers) == list(LAYERS)
    for name, layer in layers.items():
        assert layer.get(f"{INKSCAPE}groupmode") == "layer"
        assert layer.get(f"{INKSCAPE}label") == name

    def data(layer: str, panel: str) -> list[str]:
        (group,) = (g for g in layers[layer].findall(f"{SVG}g") if g.get("class") == panel)
        return [path.get("d", "") for path in group.findall(f"{SVG}path")]

    height = 1e3 * SHEET[1]
    turns = {
        (text.text, round(float(text.get("transform", "").split("rotate(")[-1].strip(")"))))
        for text in layers["labels"].iter(f"{SVG}text")
    }
    labels = {(label.text, label.angle) for drawing in drawings for label in drawing.labels}
    expected = {(text, round(float(-np.degrees(angle)) + 0.0)) for text, angle in labels}
    assert turns == expected | {("100 mm", 0)}
    for drawing in drawings:
        outline, *notches = data("cut", drawing.name)
        (ring,) = path_rings(outline)
        flipped = Polygon(ring * [1, -1] + [0, height])
        wanted = shapely.transform(drawing.cut, lambda points: 1e3 * points)
        assert flipped.symmetric_difference(wanted).area < 1e-3 * drawing.cut.length * 1e3
        assert len(notches) == len(drawing.notches)
        (printed,) = data("print", drawing.name)
        assert layers["print"].get("fill-rule") == "evenodd"
        rings = path_rings(printed)
        assert areas(rings) == pytest.approx(1e6 * areas(rings_of(drawing.printed)), abs=0.05)
        assert len(data("seam", drawing.name)) == len(drawing.seams)
    ruler = path_rings(data("marks", "sheet")[0])[0]
    assert np.linalg.norm(ruler[1] - ruler[0]) == pytest.approx(100, abs=1e-3)
    assert len(data("marks", "sheet")) == 12
    texts = [text.text for text in layers["labels"].iter(f"{SVG}text")]
    assert {"1", "100 mm", "outside up", *(d.name for d in drawings)} <= set(texts)
    # All that a machine does lies on the sheet.
    for path in root.iter(f"{SVG}path"):
        for ring in path_rings(path.get("d", "")):
            assert ring.min() >= 0
            assert (ring <= [450, 300]).all()


def test_a_full_sheet_has_its_ruler_below(tmp_path: Path) -> None:
    drawings = sheet_of("finger")[:1]
    left, low, right, high = drawings[0].footprint.bounds
    size = right - left, high - low
    write_cut_svg(tmp_path / "cut.svg", [drawings[0].moved(0.0, np.array([-left, -low]))], size)
    root = ET.parse(tmp_path / "cut.svg").getroot()
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    points = path_rings(ruler.findall(f"{SVG}path")[0].get("d", ""))[0]
    assert points[:, 1].min() > 1e3 * size[1]
    assert points[:, 1].max() < height
