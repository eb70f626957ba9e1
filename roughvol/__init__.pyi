from . import errors as errors
from ._version import __version__ as __version__
from .campaign.python import press as press
from .campaign.python import run as run
from .errors import RoughvolWarning as RoughvolWarning
from .plotting import plot as plot
from .store.run import open as open
from .study.reading import load as load
