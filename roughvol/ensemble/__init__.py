"""Means over surfaces to a wanted accuracy: samples, estimates, and the number of samples on each level.

Room of the ensembles: pure, starts nothing and opens no files. `design.Design` names the cases that it needs, and a
campaign computes them.

==============  ====================================================================
`design`        rounds of samples until each mean is as accurate as requested, and their number on each level
`targets`       quantities of one surface at a state
`samples`       values and modelled cost of each sample
`multilevel`    the mean from nested samples on several levels
`step_error`    the error between the steps of the sweeps
`estimate`      means, intervals and errors from all samples, the bias by the resolution
`allocation`    the optimal number of samples on each level
`answer`        the means as stored variables and in sentences
`prediction`    expected samples and cost before a run
`cost`          modelled seconds of a case
==============  ====================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
