"""Figures, each a function of a dataset that returns a matplotlib ``Figure``.

`paper` holds the figures of the paper, `seal` those of the flow, `theory` those of the report, `work_precision` those
of a trade-off, `surface_picture` that of ``roughvol check --look``. `selection` decides which of them a dataset feeds.
"""
