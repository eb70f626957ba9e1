"""What is drawn and judged: figures, claims, and the report that shows them.

Room of the report. It reads datasets and computes no contact.

==============  ===============================================================`captions`      their captions
`page`          the report as one HTML page
`html`          elements, tables and figures in HTML, with escaped text
`style`         style sheet of the page
`text`          the report as JSON, as Markdown and as lines for a terminal
`write`         its files, and the comparison with an expectation
`convergence`   results of a trade-off in words
==============  ======================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
