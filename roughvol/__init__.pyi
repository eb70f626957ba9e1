from ._version import __version__ as __version__
from .campaign.running import run as run
from .study.reading import load as load
