"""What the tests of leaks share: a study of rubber, and the parts of an error."""

from roughvol.analysis.closing import Closing
from roughvol.analysis.leak_card import Way
from roughvol.analysis.parts import Part

DIMENSIONAL = "dimensional: {pressure: MPa, leak_rate: {pressure_drop: 10 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}"
RUBBER = f"""name: seal
surface: {{D: 2.2, m: 4, seeds: 2, L: 200 um, Sq: 0.4 um}}
material: {{E_star: 10 MPa}}
sweep: {{steps: 20, to: {{pressure: 1.2}}}}
record: {{transport: {{transmissivity: every-step}}, {DIMENSIONAL}}}
"""


def part_of(found: Way | Closing, name: str) -> Part:
    """Return a part of the error of the leak of a way, or of its closing load."""
    return next(part for part in found.parts if part.name == name)
