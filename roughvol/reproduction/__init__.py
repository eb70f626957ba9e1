"""The reproduction of one paper, and numbers of the literature: claims, figures, formulas, and the report on them.

M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, Wear 336-337 (2015) 86-95. The room
knows all others, and only the command line knows it.

==============  ======================================================================
`claims`        every claim of the paper, a function of datasets, by topic
`figures`       Figs. 1 to 12, and theories beside computed curves
`formulas`      formulas of the paper and of the literature
`closed_forms`  indenters and loaded rectangles, as references
`literature`    numbers of the literature, judged as claims are
`paper_rules`   the paper's surface and state, and its slope A*/p*
`model`         contents of a report, and the words that all its forms share
`drawings`      figures that a report shows, and the run of each
`page`          the report as one HTML page
`text`          the report as JSON, as Markdown and as lines for a terminal
`write`         its files, and the comparison with an expectation
==============  ======================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
