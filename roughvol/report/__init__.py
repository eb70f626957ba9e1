"""What is drawn and shown of results: figures, tables of numbers, and pages.

Room of the report. It reads datasets and computes no contact.

=============  ======================================================================
`figures`      every figure, a function of a dataset
`page`         the report of runs as HTML, Markdown and JSON
`document`     a page as data: sections of facts, tables and figures
`html`         a document as HTML
`markdown`     a document as Markdown
`terminal`     sections as lines for a terminal
`report`       style sheet and frame of the pages (report.css, report.html)
`states`       states as tables: a row a state, a column a stored number
`run_facts`    one run in words and tables: surface, loading, states, closing
`card_page`    the leak card as HTML, PDF and lines for a terminal
`card_text`    its words
`screen`       tables of numbers for a screen
`convergence`  results of a trade-off in words
=============  ======================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
