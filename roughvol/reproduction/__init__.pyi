from .model import Report as Report
from .model import assemble as assemble
