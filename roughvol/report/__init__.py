"""What is drawn and judged: figures, claims, and the page that shows them.

Room of the report. It reads datasets and computes no contact.

==============  ====================================================================
`figures`       each figure a function of a dataset
`claims`        each claim of the paper a function of datasets
`write`         the report written, and held against an expectation
`paper_rules`   the paper's state and the slope A*/p*, for figures and claims
`model`         what a report holds
`page`          as one HTML page
`text`          as JSON, Markdown and lines for a terminal
`run_page`      the part of the page about one run
`run_facts`     the numbers of one run
`drawings`      which figures a report shows
`captions`      their captions
`words`         words that all forms share
`html`          pieces of HTML
`style`         the style sheet
`convergence`   what a trade-off has measured, in words
==============  ====================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
