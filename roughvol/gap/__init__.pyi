from . import box_counting as box_counting
from . import clusters as clusters
from . import free_volume as free_volume
from . import quick_estimates as quick_estimates
from . import transport as transport
