from . import levelling as levelling
from . import texture as texture
from .body import Body as Body
from .body import Treatment as Treatment
from .midpoint import midpoint_levels as midpoint_levels
from .midpoint import random_midpoint_displacement as random_midpoint_displacement
from .surface import Surface as Surface
