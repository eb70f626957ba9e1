from . import regions as regions
from .reduction import Reduction as Reduction
