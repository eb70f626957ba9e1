"""The leak at one load along x and y, and where the last way closes, each with its error, from the runs of a card.

=========  ==================================================================================================
solver     the flow falls where a gap falls, and every gap is right to η: certified, under fluid pressure estimated
grid       on a finer grid loads rise with the slope: closing load and leak move along with it
window     several surfaces: t interval of the logarithms; one map: that of its quadrants
levelling  change with another levelling of a file
=========  ==================================================================================================

A part of the closing load is a factor of loads. The leak at p of a joint that closes at f times the load is about the
leak at p/f: so a part of the leak follows where the leak itself cannot be compared, as of a way that closes.
"""

from roughvol.analysis.leak_budget.card import card_of, check_reached, is_reached

__all__ = ["card_of", "check_reached", "is_reached"]
