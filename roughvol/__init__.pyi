from ._version import __version__ as __version__
from .campaign.pressing import press as press
from .campaign.running import run as run
from .report.plotting import plot as plot
from .study.reading import load as load
