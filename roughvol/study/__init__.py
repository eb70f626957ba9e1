"""Studies: one YAML file in, a frozen `Study` and its `Case` list out.

The file is read once and strictly. Whatever is wrong with it is reported together, in the order of the file, as a
`StudyError` whose problems carry the line, the key path, the value given and what is allowed.

`yamltext` turns text into plain data with places (the only user of yaml). `settings`, `measured`, `treatment`,
`material` and `recording` hold the sections, `agreement` what files of heights give beside them, and `cases` the whole,
its cases and the rules across sections. `reading` brings the problems together in plain words.
"""

from __future__ import annotations

from roughvol.study.cases import ANSWER_FORMAT, Case, Study, json_schema
from roughvol.study.material import ContactModulus, YoungPoisson
from roughvol.study.measured import HEIGHT_FORMATS, CounterBody, HeightFile
from roughvol.study.quantities import convert
from roughvol.study.reading import load, loads
from roughvol.study.recording import (
    EVERY_STEP,
    BoxCounting,
    Dimensional,
    Record,
    Region,
    RegionWidths,
    Select,
    Transport,
    VolumeDensity,
)
from roughvol.study.settings import (
    ACCURACY,
    EXPECTED,
    GeneratedSurface,
    Level,
    Solver,
    Sweep,
    Target,
)
from roughvol.study.treatment import Crop, Outliers

__all__ = [
    "ACCURACY",
    "ANSWER_FORMAT",
    "EVERY_STEP",
    "EXPECTED",
    "HEIGHT_FORMATS",
    "BoxCounting",
    "Case",
    "ContactModulus",
    "CounterBody",
    "Crop",
    "Dimensional",
    "GeneratedSurface",
    "HeightFile",
    "Level",
    "Outliers",
    "Record",
    "Region",
    "RegionWidths",
    "Select",
    "Solver",
    "Study",
    "Sweep",
    "Target",
    "Transport",
    "VolumeDensity",
    "YoungPoisson",
    "convert",
    "json_schema",
    "load",
    "loads",
]
