"""A dataset in, an answer out: at a load, over surfaces, in units, read off, with its error.

Room of the analysis. It reads datasets, solves no contact, and draws nothing.

=============  ==================================================================
`stored_run`   a stored run: its name, dataset and study
`accessor`     ``ds.roughvol``: states at a load, derived numbers, means, units
`derived`      numbers that follow from stored numbers; surfaces that share a table
`leak`         the leak that counts: lifted by the fluid where a study asks for it
`at`           the states of stored surfaces at a load, on a step or between two
`average`      the one number of several surfaces: convention, range, counts
`closing`      the loads between which the last way closes
`parts`        the parts of the error of a leak or of a closing load
`legs`         legs of a path in a dataset
`units`        Sq in the unit of L, starred numbers, several runs in the units of the first
`hysteresis`   leak up and down a path, and with yield against without
`leak_curve`   the leak of a surface over the load, read between steps with its error
`read_off`     pressure, modulus or Sq at which a leak falls to a value, or a joint closes
`creep`        the leak of a seal over time
`seal`         the leak of a seal, and its closing load, from those of its patches
`leak_budget`  the leak at a load along x and y, its closing and its error budget
`leak_card`    what a leak card holds, and its plain data
`tables`       rows of text under a head
=============  ==================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
