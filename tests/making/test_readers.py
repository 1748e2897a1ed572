"""Machine files of demo patterns and of random skins, as readers of other makers see them."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.browser import opened
from helpers.machine_files import read_regions
from helpers.panels import pattern_of, striped
from helpers.surfaces import sphere
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.files import write_json
from toros_fem.making.contours import even_odd
from toros_fem.making.layout import Manufacture, manufacture
from toros_fem.making.machine_files import machine_files
from toros_fem.making.manifest import NAME, manifest
from toros_fem.making.options import ManufactureOptions
from toros_fem.meshes import Pattern, two_panels, unwrap
from toros_fem.meshes.surface import Surface

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
ezdxf = pytest.importorskip("ezdxf", reason="ezdxf is not installed")
lib3mf = pytest.importorskip("lib3mf", reason="lib3mf is not installed")
ALONE = MPI.COMM_SELF
HEIGHT = 0.5e-3
# Skins, each by its seed; 200 were tried once.
SEEDS = range(10)


def random_skin(rng: np.random.Generator) -> Pattern:
    """Two panels with a wavy outline, or a dented ball that is cut and laid flat."""
    phase, size = rng.uniform(0, 6, 3), rng.uniform(0.02, 0.05)
    if rng.random() < 0.5:
        turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        waves = rng.uniform(0, 0.15, 3) * np.cos(np.outer(turn, [2, 3, 5]) + phase)
        radius = size * (1 + waves.sum(axis=1))
        outline = np.column_stack(
            [radius * np.cos(turn), rng.uniform(0.4, 1) * radius * np.sin(turn)]
        )
        return two_panels(ALONE, outline, size / 5)
    ball = sphere(2, size)
    dents = rng.uniform(0, 0.2, 3) * np.cos(ball.points / size * [2, 3, 4] + phase)
    return unwrap(
        ALONE, Surface(ball.points * (1 + dents.sum(axis=1))[:, None], ball.triangles)
    ).pattern


def random_print(pattern: Pattern, rng: np.random.Generator) -> list[BaseGeometry]:
    """Lines, spots and holes anywhere, some of which touch or cross the border; often nothing."""
    found = []
    for panel in range(len(pattern.panel_names)):
        outline = pattern.outline(panel)
        low, high = np.reshape(outline.bounds, (2, 2))
        lines = shapely.linestrings(rng.uniform(low, high, (4, 2, 2)))
        spots = shapely.points(rng.uniform(low, high, (6, 2)))
        holes = shapely.buffer(shapely.points(rng.uniform(low, high, (5, 2))), 0.6e-3, quad_segs=4)
        print_ = [*shapely.buffer(lines, 1e-3, cap_style="flat"), *shapely.buffer(spots, 2e-3)]
        region = shapely.union_all(print_).difference(shapely.union_all(holes)) & outline
        found.append(shapely.Polygon() if rng.random() < 0.2 else region)
    return found


def rings_of(text: str, layer: str) -> list[np.ndarray]:
    """The closed lines of a layer of a DXF drawing, in mm."""
    document = ezdxf.read(io.StringIO(text))
    assert not document.audit().errors
    lines = [line for line in document.modelspace().query("LWPOLYLINE") if line.closed]
    return [np.array(line.get_points("xy")) for line in lines if line.dxf.layer == layer]


def checked(made: Manufacture, contents: dict[str, bytes]) -> None:
    """Each file by a reader of its own against the drawings."""
    for number, sheet in enumerate(made.sheets, 1):
        text = contents[f"cut_{number}.dxf"].decode()
        for layer, shapes in (
            ("print", [one.printed for one in sheet.drawings]),
            ("cut", [one.cut for one in sheet.drawings]),
        ):
            drawn = even_odd(1e-3 * ring for ring in rings_of(text, layer))
            off = drawn.symmetric_difference(shapely.union_all(shapes))
            assert off.area < 1e-9 * np.prod(sheet.size)
    for number, bed in enumerate(made.beds, 1):
        areas = {one.name: one.printed.area for one in bed.drawings if not one.printed.is_empty}
        if not areas:
            assert f"print_{number}.stl" not in contents
            continue
        mesh = trimesh.load_mesh(io.BytesIO(contents[f"print_{number}.stl"]), file_type="stl")
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        scene = trimesh.load(io.BytesIO(contents[f"print_{number}.3mf"]), file_type="3mf")
        assert scene.units == "millimeter"
        assert {*areas} == {n for n in scene.geometry if not n.endswith(" registration")}
        for name, area in areas.items():
            body = scene.geometry[name]
            assert body.is_watertight
            assert body.volume == pytest.approx(1e9 * area * HEIGHT, rel=2e-3, abs=1e-3)
        whole = sum(body.volume for body in scene.geometry.values())
        assert mesh.volume == pytest.approx(whole, rel=1e-4)
        model = lib3mf.get_wrapper().CreateModel()
        reader = model.QueryReader("3mf")
        reader.ReadFromBuffer(contents[f"print_{number}.3mf"])
        assert reader.GetWarningCount() == 0
        objects = model.GetMeshObjects()
        while objects.MoveNext():
            assert objects.GetCurrentMeshObject().IsManifoldAndOriented()


def through_all_files(
    pattern: Pattern, regions: list[BaseGeometry], options: ManufactureOptions, folder: Path
) -> None:
    made = manufacture(pattern, regions, options)
    files = list(machine_files(made))
    write_json(folder / NAME, manifest(made, files))
    contents = {file.name: file.content for file in files}
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    checked(made, contents)
    again = list(machine_files(manufacture(pattern, regions, options)))
    assert again == files, "equal skins give equal bytes"
    for one, other in zip(read_regions(folder, pattern), regions, strict=True):
        assert one.symmetric_difference(other).area < 1e-4 * other.area + 1e-12


@pytest.mark.parametrize("kind", ["tube", "walker", "gripper", "finger"])
def test_patterns_of_demos(kind: str, tmp_path: Path) -> None:
    pattern = pattern_of(kind)
    options = ManufactureOptions(bed_width=0.35, bed_depth=0.35, layer_height=HEIGHT)
    through_all_files(pattern, striped(pattern), options, tmp_path)


@pytest.mark.slow
def test_a_browser_draws_what_is_cut(tmp_path: Path) -> None:
    """Each layer of the drawing at its place, in mm on the sheet."""
    pattern = pattern_of("walker")
    made = manufacture(pattern, striped(pattern), ManufactureOptions(bed_width=0.35))
    drawings = [one for one in machine_files(made) if re.fullmatch(r"cut_\d+\.svg", one.name)]
    assert len(drawings) == len(made.sheets)
    for file, sheet in zip(drawings, made.sheets, strict=True):
        path = tmp_path / file.name
        path.write_bytes(file.content)
        with opened(path, ready="document.readyState === 'complete'") as page:
            assert page.complaints == []
            for layer in ("print", "cut"):
                box = page.run(
                    f"const b = document.getElementById('{layer}').getBBox();"
                    "return [b.x, b.y, b.x + b.width, b.y + b.height]"
                )
                shapes = [
                    getattr(one, "printed" if layer == "print" else "cut") for one in sheet.drawings
                ]
                left, low, right, high = 1e3 * shapely.total_bounds(shapes)
                depth = 1e3 * sheet.size[1]  # y goes down in SVG
                assert box == pytest.approx([left, depth - high, right, depth - low], abs=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_random_skins(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    pattern = random_skin(rng)
    options = ManufactureOptions(
        bed_width=0.4, bed_depth=0.4, layer_height=HEIGHT, grain=rng.choice([None, 90.0]),
        print_side=str(rng.choice(["inside", "outside"])), copies=int(rng.integers(1, 3)),
        seam_allowance=rng.choice([None, 5e-3]),
    )  # fmt: skip
    through_all_files(pattern, random_print(pattern, rng), options, tmp_path)
