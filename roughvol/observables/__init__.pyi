from . import regions as regions
from .reduction import Reduction as Reduction
from .variables import VARIABLES as VARIABLES
from .variables import Variable as Variable
