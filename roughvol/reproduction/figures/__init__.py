"""Figures of the paper, and theories beside computed curves.

=================  ======================================================================
`registry`         tables of these figures, `figures.toml`, and the run that each is drawn from
`paper`            Figs. 1 to 12, each a function of a dataset
`theory`           theories, second readings and many seeds, from several runs
`element_volumes`  element volumes of a state, and their densities
`relief`           lit surfaces in perspective
`conditions`       conditions of the paper, and how a drawing differs from them
=================  ======================================================================
"""
