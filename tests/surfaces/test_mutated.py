"""Headers that programs or people have changed: a file is read, or refused in one message, and never a traceback."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from written import surfer_6, surfer_7, surfer_text

from roughvol.errors import RoughvolError
from roughvol.study import loads
from roughvol.surfaces.files import reading

HEIGHTS = np.random.default_rng(4).normal(size=(6, 5)).round(4)
ROWS = "\n".join(" ".join(map(str, row)) for row in HEIGHTS.T.tolist()) + "\n"
X, Y = (axis.ravel() * 0.5 for axis in np.indices(HEIGHTS.shape))
POINTS = "\n".join(f"{x};{y};{z}" for x, y, z in zip(X, Y, HEIGHTS.ravel(), strict=True)) + "\n"
GRID = "ncols 6\nnrows 5\nxllcorner 0\nyllcorner 0\ncellsize 0.5\nNODATA_value -9999\n"

FILES: dict[str, bytes] = {
    "gwyddion.txt": f"# Channel: Topography\n# Width: 6 µm\n# Height: 5000 nm\n# Value units: nm\n{ROWS}".encode(),
    "hw.txt": f"h=5 w=6\npixel size = 5e-7 m\nheight conversion factor (-> m) = 1e-9\n{ROWS}".encode(),
    "grid.asc": f"{GRID}{ROWS}".encode(),
    "points.csv": f"X [µm];Y [µm];Z [nm]\n{POINTS}".encode("latin-1"),
    "text.grd": surfer_text(HEIGHTS),
    "surfer-6.grd": surfer_6(HEIGHTS),
    "surfer-7.grd": surfer_7(HEIGHTS),
}
HEAD = 130  # bytes of the longest header
TOKENS = [
    *(
        "",
        " ",
        "\n",
        ";",
        ",",
        ".",
        "-",
        "+",
        "#",
        "\0",
        "²",
        "µ",
        "nan",
        "inf",
        "-1",
        "0",
        "1e400",
        "1e-400",
        "9" * 400,
    ),
    *("nm", "m", "V", "kg", "1.70141e38", "DSAA", "DSBB", "DSRB", "GRID", "DATA", "ncols", "width:", "pixel size ="),
    *("\xff\xff\xff\x7f", "\x00\x00\x00\x80", "\x00\x00\x00\x00\x00\x00\xf8\x7f"),
]


@st.composite
def mutated(draw: st.DrawFn) -> tuple[str, bytes]:
    """A file with up to four places of its header replaced, and some cut off."""
    name = draw(st.sampled_from(sorted(FILES)))
    content = FILES[name]
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, min(HEAD, len(content))))
        token = draw(st.sampled_from(TOKENS)).encode("latin-1")
        content = content[:start] + token + content[start + draw(st.sampled_from([0, 1, len(token), 8])) :]
    return name, content[: draw(st.integers(0, len(content)))] if draw(st.integers(0, 9)) == 0 else content


@settings(derandomize=True, max_examples=60, deadline=None)
@given(mutated())
@example(("text.grd", b"DSAA"))
@example(("surfer-7.grd", surfer_7(HEIGHTS)[:12]))
@example(("gwyddion.txt", FILES["gwyddion.txt"].replace(b"6 ", b"61e-400 ")))  # a width that rounds to 0
def test_a_changed_header_is_read_or_refused_in_one_message(file: tuple[str, bytes]) -> None:
    name, content = file
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        for keys in ("", ", L: 3 um, heights_unit: nm", ", L: 3 um, heights_unit: nm, header: ignore"):
            said = ""
            try:
                heights = reading.read(path, holes=True, ignore_header="header" in keys)
                assert heights.dtype == np.float64
                assert min(heights.shape) >= 3
                (case,) = loads(f"surface: {{file: {name}{keys}}}", Path(folder, "study.yaml")).cases()
                assert case.L > 0.0
            except RoughvolError as error:
                said = str(error)
            assert not said or name in said
            assert len(said) < 1200
