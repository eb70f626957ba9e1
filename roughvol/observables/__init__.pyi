from . import box_counting as box_counting
from . import free_volume as free_volume
from . import regions as regions
from . import transport as transport
from .reduction import Reduction as Reduction
