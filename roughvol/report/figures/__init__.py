"""Figures, each a function of a dataset that returns a matplotlib ``Figure``.

==================  ==================================================================
`registry`          tables of all figures, one row a figure
`figure`            row of a table: variables, drawing, caption, cases
`cases`             surfaces, states and cases that a figure shows
`seal`              flow through the gap
`yielding`          paths of legs, and plastic displacement
`content`           figures named by content, of one run or several overlaid
`spectra`           power spectral density, and slope by scale
`leak_card`         drawings of the leak card
`card_print`        its page of print
`work_precision`    speed against accuracy of a trade-off
`surface_picture`   one surface before it is pressed (``roughvol check --look``)
`families`          curves, states and densities read from a dataset
`ways`              flow along a direction, where it stops, how both are drawn
`curves`            curves of several surfaces on one axes
`origin`            the note below a figure
`style`             sizes, colours, labels, units, legends
==================  ==================================================================
"""
