"""Prints that somebody has drawn: the same from SVG, DXF and GeoJSON, and what is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from mpi4py import MPI

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.making.drawing import read_drawing, write_template
from toros_fem.making.panel_drawing import write_svg
from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern

ezdxf = pytest.importorskip("ezdxf", reason="ezdxf is not installed")
pytest.importorskip("svgpathtools", reason="svgpathtools is not installed")


@pytest.fixture(scope="module")
def tube(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.06, 0.02, 4.5e-3)


def borders_of_svg(path: Path) -> dict[str, tuple[float, float]]:
    """Left and lowest place of the border of each panel in a template, in mm, y downwards."""
    text = path.read_text(encoding="utf-8")
    found = {}
    for name, data in re.findall(r'<g id="(\w+)">.*?class="cut".*?d="([^"]*)"', text, re.DOTALL):
        points = np.array(re.findall(r"[-\d.]+,[-\d.]+", data))
        places = np.array([pair.split(",") for pair in points], dtype=float)
        found[name] = (places[:, 0].min(), places[:, 1].max())
    return found


def test_a_print_comes_back_as_it_was_written(
    alone: MPI.Comm, tube: Pattern, tmp_path: Path
) -> None:
    """From the drawing of a run: with holes, and islands in them."""
    wall = tube.panel_names.index("wall")
    left, low = tube.outline(wall).bounds[:2]
    at = shapely.Point(left + 0.02, low + 0.03)
    ring = at.buffer(8e-3) - at.buffer(5e-3) | at.buffer(2e-3)
    printed = [ring if k == wall else shapely.Polygon() for k in range(len(tube.panel_names))]
    write_svg(tmp_path / "pattern.svg", tube, printed)
    found = read_drawing(alone, tmp_path / "pattern.svg", tube)
    assert found[wall].area == pytest.approx(ring.area, rel=1e-4)
    assert shapely.symmetric_difference(found[wall], ring).area < 1e-4 * ring.area
    assert all(found[k].is_empty for k in range(len(found)) if k != wall)


def test_a_stripe_in_each_format(alone: MPI.Comm, tube: Pattern, tmp_path: Path) -> None:
    """A rectangle, a disc and a line 2 mm wide, drawn in templates."""
    wall = tube.panel_names.index("wall")
    left, low = tube.outline(wall).bounds[:2]
    expected = shapely.box(left + 0.01, low + 0.01, left + 0.03, low + 0.015)
    expected |= shapely.Point(left + 0.04, low + 0.04).buffer(4e-3)
    expected |= shapely.box(left + 0.005, low + 0.029, left + 0.025, low + 0.031)

    svg = tmp_path / "tube.svg"
    write_template(alone, svg, tube)
    x, y = borders_of_svg(svg)["wall"]
    drawn = (
        f'<g transform="translate({x} {y}) scale(1 -1)"><rect x="10" y="10" width="20" height="5"/>'
        '<circle cx="40" cy="40" r="4"/><path d="M5,30 L25,30" '
        'style="fill:none;stroke:black;stroke-width:2"/></g>'
    )
    text = svg.read_text(encoding="utf-8")
    svg.write_text(text.replace('<g id="wall">', f'<g id="wall">{drawn}'), encoding="utf-8")

    dxf = tmp_path / "tube.dxf"
    write_template(alone, dxf, tube)
    document = ezdxf.readfile(dxf)
    space, on = document.modelspace(), {"dxfattribs": {"layer": "wall"}}
    a, b = 1e3 * left, 1e3 * low
    corners = [(a + 10, b + 10), (a + 30, b + 10), (a + 30, b + 15), (a + 10, b + 15)]
    space.add_lwpolyline(corners, close=True, **on)
    space.add_circle((a + 40, b + 40), 4, **on)
    line = space.add_lwpolyline([(a + 5, b + 30), (a + 25, b + 30)], **on)
    line.dxf.const_width = 2
    space.add_text("by hand", **on)
    document.saveas(dxf)

    geojson = tmp_path / "tube.geojson"
    write_template(alone, geojson, tube)
    told = json.loads(geojson.read_text(encoding="utf-8"))
    shapes = [
        (shapely.Polygon(corners), {}),
        (shapely.Point(a + 40, b + 40).buffer(4), {}),
        (shapely.LineString([(a + 5, b + 30), (a + 25, b + 30)]), {"width_mm": 2}),
    ]
    told["features"] += [
        {"type": "Feature", "properties": {"panel": "wall", **more},
         "geometry": json.loads(shapely.to_geojson(one))}
        for one, more in shapes
    ]  # fmt: skip
    geojson.write_text(json.dumps(told), encoding="utf-8")

    for path in (svg, dxf, geojson):
        found = read_drawing(alone, path, tube)[wall]
        off = shapely.symmetric_difference(found, expected).area / expected.area
        assert off < 0.04, path  # ends of lines are round in two formats
    assert shapely.symmetric_difference(read_drawing(alone, svg, tube)[wall], expected).area < 1e-7


def test_what_is_no_drawing_of_these_panels(alone: MPI.Comm, tube: Pattern, tmp_path: Path) -> None:
    svg = tmp_path / "tube.svg"
    write_template(alone, svg, tube)
    with pytest.raises(FileError, match="prints nothing. Fill shapes"):
        read_drawing(alone, svg, tube)
    text = svg.read_text(encoding="utf-8")
    disc = '<circle cx="40" cy="40" r="4"/>'

    def refused(changed: str, words: str) -> None:
        svg.write_text(changed, encoding="utf-8")
        with pytest.raises(FileError, match=words):
            read_drawing(alone, svg, tube)

    refused(text.replace("</svg>", f"{disc}</svg>"), "1 shapes belong to no panel")
    refused(text.replace('<g id="wall">', f'<g id="wall">{disc}').replace('class="cut"', ""),
            "border of panel 'wall' is missing")  # fmt: skip
    # In another scale, as of a program that counts 72 units an inch.
    wide = re.sub(r'(width|height)="([\d.]+)mm"', r'\1="\2pt"', text)
    refused(wide.replace('<g id="wall">', f'<g id="wall">{disc}'), "in true scale")
    refused("no drawing", "cannot be read as a drawing.*toros check SCENE --drawing FILE")
    with pytest.raises(FileError, match="cannot be read"):
        read_drawing(alone, tmp_path / "none.svg", tube)
    with pytest.raises(ParameterError, match="ends in .pdf; a drawing ends in"):
        write_template(alone, tmp_path / "tube.pdf", tube)
