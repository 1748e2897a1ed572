"""Damaged and odd files for all readers, from fresh seeds: `make fuzz SECONDS=600`.

What ends in anything but a typed error of one line is kept in tests/data/found, where
tests/contracts/test_hostile_files.py reads it from then on.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path

import meshio
import numpy as np
from contracts.test_hostile_files import FOUND, READERS, raised, wrong
from helpers.line_fields import two_sheets
from helpers.runs import regions_of, tube
from helpers.scenes import ROOT

from toros_fem.base.files import HEADER, Archive, write_archive
from toros_fem.making.printability import DEFAULT_LIMITS, write_print_polygons
from toros_fem.meshes import write_pattern

SECONDS_OF_ONE = 20.0
# Numbers, words and signs that readers stumble over.
ODD = (
    b"", b"-1", b"0", b"1e308", b"-1e-320", b"nan", b"inf", b"9" * 400, b"2147483648", b"1e999 m",
    b"none", b"true", b"\x00", b"\xff", b"\xc3", b'"', b"'''", b"[", b"]]", b"{", b"=", b",", b";",
    b"\n", b"\r", b"#", b"\t", b"-", b".", b"5 kPa", "µm °".encode(), b"a" * 5000,
)  # fmt: skip


def good_files(folder: Path) -> dict[str, list[bytes]]:
    """Files that are read, by the names of their readers."""
    pattern, shape = two_sheets(0.3), tube()
    write_pattern(folder / "pattern.npz", pattern)
    write_print_polygons(folder / "print.npz", shape, regions_of(shape), DEFAULT_LIMITS)
    for end in ("stl", "ply", "vtu"):
        mesh = meshio.Mesh(shape.points, [("triangle", shape.triangles)])
        mesh.write(folder / f"skin.{end}", binary=bool(len(end) % 2))
    found = {path.name: [path.read_bytes()] for path in folder.iterdir()}
    found["deformed.vtu"] = found["skin.vtu"]
    found["scene.toml"] = [path.read_bytes() for path in (ROOT / "demos/scenes").glob("*.toml")]
    found["materials.toml"] = [
        path.read_bytes() for path in (ROOT / "toros_fem/materials").rglob("*.toml")
    ]
    found["tests.csv"] = [
        b"# thickness = 0.5 mm\n# width = 25 mm\nstrain [%],force [N],specimen\n"
        + b"".join(b"%d,%d,a\n" % (k, 2 * k) for k in range(1, 9)),
        b"stretch;stress [MPa];lateral strain\n1,1;0,2;-0,01\n1,2;0,4;-0,02\n",
    ]
    figure = {"key": "angle_deg", "value": 1.0}
    found["summary.json"] = [json.dumps({"figures": [figure], "inputs": {}}).encode()]
    found["state/run.json"] = [json.dumps({"format": 3, "inputs": {}, "identity": "a"}).encode()]
    found["history.csv"] = [b"iteration,objective\n0,1.5\n1,1.25\n"]
    found["curve.csv"] = [b"pressure_pa,angle_deg\n0,0\n1000,12.5\n5000,90\n"]
    return {name: of for name, of in found.items() if name in READERS}


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """A file with some bytes changed, cut out, doubled, or odd words put in."""
    made = bytearray(content)
    for _ in range(int(random.integers(1, 5))):
        at = int(random.integers(len(made) + 1))
        size = int(random.choice([1, 3, 20, 200]))
        match random.integers(5):
            case 0 if made:
                made[at % len(made)] ^= 1 << int(random.integers(8))
            case 1:
                del made[at : at + size]
            case 2:
                made[at:at] = made[at : at + size]
            case 3:
                made[at : at + int(random.integers(4))] = ODD[random.integers(len(ODD))]
            case _:
                del made[at:]
    return bytes(made)


def forged(path: Path, content: bytes, random: np.random.Generator) -> bytes:
    """An archive with odd arrays or numbers, and a digest that fits them."""
    path.write_bytes(content)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    about = json.loads(arrays.pop(HEADER).tobytes())
    arrays.pop("sha256")
    name = str(random.choice([*arrays]))
    number = random.choice([np.nan, -1.0, 1e300, 2.0**40, 0.0])
    match random.integers(5):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = arrays[name][: len(arrays[name]) // 2]
        case 2 if arrays[name].dtype.kind in "fiub":
            with np.errstate(all="ignore"):
                arrays[name] = np.where(
                    random.random(arrays[name].shape) < 0.1, number, arrays[name]
                )
        case 3 if arrays[name].dtype.kind in "fiub":
            arrays[name] = arrays[name].reshape(-1).astype(random.choice(["f4", "i1", "?", "U3"]))
        case _:
            about["numbers"] = dict.fromkeys(
                about["numbers"], (None, [], "a", 7)[random.integers(4)]
            )
    write_archive(path, Archive(about["is"].removeprefix("toros_fem "), arrays, about["numbers"]))
    return path.read_bytes()


def main(seconds: float, seed: int) -> int:
    """Read files for some time; return how many were not refused as they should be."""
    print(f"seed {seed}: python3 -m kit.fuzz {seconds:g} {seed}", flush=True)
    random, end, count, bad = np.random.default_rng(seed), time.monotonic() + seconds, 0, 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "good").mkdir()
        good = good_files(folder / "good")
        while time.monotonic() < end:
            reader = str(random.choice([*good]))
            content = good[reader][random.integers(len(good[reader]))]
            place = folder / "tried"
            shutil.rmtree(place, ignore_errors=True)
            path = place / reader
            path.parent.mkdir(parents=True)
            odd = reader.endswith("npz") and random.random() < 0.7
            made = forged(path, content, random) if odd else damaged(content, random)
            path.write_bytes(made)
            count, bad = count + 1, bad + tried(reader, path, made)
    print(f"{count} files, {bad} found")
    return bad


def tried(reader: str, path: Path, made: bytes) -> bool:
    """Read a file; keep it if its error is wrong, or if it took long."""
    begin = time.monotonic()
    error: BaseException | None = raised(lambda: READERS[reader](path))
    fault = wrong(error, path)
    if time.monotonic() - begin > SECONDS_OF_ONE:
        fault = fault or "it took too long"
    if not fault:
        return False
    kept = FOUND / f"{reader.replace('/', '+')}-{hashlib.sha1(made).hexdigest()[:8]}"
    FOUND.mkdir(exist_ok=True)
    kept.write_bytes(made)
    print(f"{kept}: {fault}", flush=True)
    if error is not None:
        traceback.print_exception(error, limit=-4)
    return True


if __name__ == "__main__":
    fresh = secrets.randbits(32)
    sys.exit(main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else fresh) > 0)
