"""The gap of a solved state: its free volume, its clusters, and the flow through it.

The room of the gap. It knows arrays alone: no study, no solver.

=================  ===================================================================
`free_volume`      element volumes, their total, density and domains
`box_counting`     boxes of side r, and the local dimension
`clusters`         percolation, connected and trapped volume, sizes of contact and pockets
`perimeter`        edges between contact and void, and the contact area corrected by them
`compiled`         loops over elements, compiled
`constriction`     the narrowest place of the widest way
`aggregates`       aggregates of elements that follow the conductances, and their joints
`multigrid`        a cycle over the grid, its aggregates, and theirs
`network`          pressures and flows of elements joined by conductances, to an accuracy
`transport`        flow through the gap
`gas`              flow of a gas, from viscous to free molecular
`fluid_pressure`   pressure of a fluid in the gap
`sheet`            patches side by side and in a row: what they conduct together, and the load that closes them
`quick_estimates`  flow by effective medium and by a single junction
=================  ===================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
