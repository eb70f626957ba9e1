"""What is drawn and shown of results: figures, tables of numbers, and pages.

Room of the report. It reads datasets and computes no contact.

=============  ======================================================================
`figures`      every figure, a function of a dataset
`drawings`     figures that a page shows, with caption and run
`run_facts`    one run in words and tables: surface, loading, states, closing
`card_page`    the leak card as HTML, PDF and lines for a terminal
`card_text`    its words
`screen`       tables of numbers for a screen
`html`         elements, tables and figures in HTML, with escaped text
`style`        style sheet of the page
`convergence`  results of a trade-off in words
=============  ======================================================================
"""

__all__: list[str] = []
