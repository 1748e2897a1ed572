"""Make the pictures of README, docs and demos from the runs of the figures.

    python3 -m benchmarks figures --only coarse --rows output/figures.csv
    python3 docs/copy_pictures.py

The pictures of each run are drawn anew from its folder, copied, and marked with the run, its seed
and its figures, as text in the file. `make pictures` does all of it.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.figures import DEMOS, folder_of  # noqa: E402
from toros_fem.results.pictures.film import write_animation  # noqa: E402
from toros_fem.results.pictures.of_run import draw_run, facts_of  # noqa: E402
from toros_fem.results.runs.stored_run import read_run  # noqa: E402

SIZE, PICTURES = "coarse", ROOT / "demos" / "pictures"
# Pictures by their names: the run that each is of, as the table of figures names it, and the file.
COPIES: Mapping[str, tuple[str, str]] = {
    **{
        f"{run}{ending}": (run, file)
        for run in ("bend", "contract", "twist", "bend_twist", "walker", "gripper")
        for ending, file in {
            ".png": "shape.png", "_hero.png": "hero.png", "_miss.png": "miss.png",
            "_pattern.png": "pattern.png", "_curve.png": "curve.png",
            "_design.png": "design.png", ".gif": "inflation.gif",
        }.items()
        # Legs and fingers are not compared with a target point by point.
        if not (run in ("walker", "gripper") and file == "miss.png")
    },
    **{f"{run}_lines.png": (run, "lines.png") for run in ("contract", "twist", "bend_twist")},
    "box_hero.png": ("gripper shape=box", "hero.png"),
    "box.gif": ("gripper shape=box", "inflation.gif"),
    "crawl_hero.png": ("walker motion=crawl", "hero.png"),
    "gait.png": ("walker motion=crawl", "gait.png"),
    "gait.gif": ("walker motion=crawl", "gait.gif"),
    "tracks.png": ("walker motion=crawl", "tracks.png"),
    "lift.png": ("gripper", "lift.png"),
    "inflate.png": ("inflate", "inflation.png"),
    "inflate.gif": ("inflate", "inflation.gif"),
    "inflate_curve.png": ("inflate", "curve.png"),
    "own_design.png": ("own_design", "shape.png"),
    "own_design_hero.png": ("own_design", "hero.png"),
    **{
        f"tile{'_' * bool(target)}{target}.png": (name, "profile.png")
        for target in ("", "orthotropic", "isotropic", "auxetic")
        for name in (f"tile target={target}" if target else "tile",)
    },
    "tile_pattern.png": ("tile", "pattern.png"),
    "tile_deformed.png": ("tile", "deformed.png"),
}  # fmt: skip
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def with_facts(content: bytes, facts: Mapping[str, str]) -> bytes:
    """Return a PNG that has these texts and no others."""
    chunks, at = [], len(SIGNATURE)
    while at < len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        if content[at + 4 : at + 8] not in (b"tEXt", b"iTXt", b"zTXt"):
            chunks.append(content[at : at + 12 + length])
        at += 12 + length
    texts = []
    for key, text in facts.items():
        data = key.encode("latin-1") + b"\0\0\0\0\0" + text.encode()
        check = zlib.crc32(b"iTXt" + data)
        texts.append(struct.pack(">I", len(data)) + b"iTXt" + data + struct.pack(">I", check))
    return b"".join([SIGNATURE, chunks[0], *texts, *chunks[1:]])


def with_comment(content: bytes, facts: Mapping[str, str]) -> bytes:
    """Return a GIF that has these texts as its last comment, a line each."""
    text = "\n".join(f"{key}: {value}" for key, value in facts.items()).encode()
    parts = (text[k : k + 255] for k in range(0, len(text), 255))
    comment = b"".join(bytes([len(part)]) + part for part in parts)
    return content[:-1] + b"!\xfe" + comment + b"\0" + content[-1:]


def main() -> int:
    """Draw and copy; return the exit code, 1 where a run is missing."""
    demos = {demo.name: demo for demo in DEMOS}
    missing = []
    for name in dict.fromkeys(run for run, _ in COPIES.values()):
        folder = folder_of(demos[name], SIZE)
        if not (folder / "summary.json").exists():
            missing.append(name)
            continue
        run = read_run(folder)
        draw_run(folder)
        wanted = {picture: file for picture, (of, file) in COPIES.items() if of == name}
        for series in ("pressure", "gait"):
            file = "inflation.gif" if series == "pressure" else f"{series}.gif"
            if file in wanted.values() and len(run.series.get(series, ())) > 1:
                write_animation(folder, series)
        facts = {**facts_of(run), "Title": f"{name}, {SIZE}"}
        for picture, file in wanted.items():
            told = with_comment if file.endswith(".gif") else with_facts
            (PICTURES / picture).write_bytes(told((folder / file).read_bytes(), facts))
    for path in PICTURES.iterdir():
        if path.name not in COPIES:
            path.unlink()
    if missing:
        print(f"no runs of {', '.join(missing)}: python3 -m benchmarks figures makes them")
    return bool(missing)


if __name__ == "__main__":
    sys.exit(main())
