"""What is drawn and judged: figures, claims, and the report that shows them.

Room of the report. It reads datasets and computes no contact.

==============  ======================================================================
`figures`       every figure, a function of a dataset
`plotting`      one figure of datasets, by its name
`claims`        every claim of the paper, a function of datasets
`paper_rules`   the paper's state and the slope A*/p*, for figures and claims
`model`         contents of a report, and the words that all its forms share
`run_facts`     one run in words and tables: surface, loading, states, closing
`card_page`     the leak card as HTML, PDF and lines for a terminal
`card_text`     its words
`screen`        tables of numbers for a screen
`literature`    a number of the literature as the row of a table
`answers`       statements judged by ten seeds and by an ensemble
`drawings`      figures that a report shows, and the run of each
`captions`      their captions
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
