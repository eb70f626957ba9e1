"""Studies: one YAML file in, a frozen `Study` and its `Case` list out.

The file is read once and strictly. Whatever is wrong with it is reported together, in the order of the file, as a
`StudyError` whose problems carry the line, the key path, the value given and what is allowed.

`yamltext` turns text into plain data with places (the only user of yaml), `settings` and `recording` hold the sections
and `cases` the whole, its cases and the rules across sections, and `reading` brings the problems together in plain
words.
"""

from __future__ import annotations

from roughvol.study.cases import ANSWER_FORMAT, Case, Study, json_schema
from roughvol.study.reading import load, loads
from roughvol.study.recording import EVERY_STEP, BoxCounting, Record, Region, Select, Transport, VolumeDensity
from roughvol.study.settings import (
    ACCURACY,
    EXPECTED,
    HEIGHT_FORMATS,
    ContactModulus,
    GeneratedSurface,
    HeightFile,
    Level,
    Solver,
    Sweep,
    Target,
    YoungPoisson,
)

__all__ = [
    "ACCURACY",
    "ANSWER_FORMAT",
    "EVERY_STEP",
    "EXPECTED",
    "HEIGHT_FORMATS",
    "BoxCounting",
    "Case",
    "ContactModulus",
    "GeneratedSurface",
    "HeightFile",
    "Level",
    "Record",
    "Region",
    "Select",
    "Solver",
    "Study",
    "Sweep",
    "Target",
    "Transport",
    "VolumeDensity",
    "YoungPoisson",
    "json_schema",
    "load",
    "loads",
]
