"""What is kept of a state: its numbers, its fields, and the flow through its gap.

Room of the observables: pure functions of arrays, and the reduction of a sweep to what a study asks for.

===============  ===================================================================
`reduction`      each state of a sweep reduced to stored values
`free_volume`    element volumes, their total, density and domains
`box_counting`   boxes of side r, and the local dimension
`transport`      connectivity, constriction, conduction, quick estimates
`void`           the transport that a study asks for, state by state
`regions`        a part of the surface, and central squares
`at_state`       quantities of a sweep at a given state, between its steps
`multilevel`     means over an ensemble, from samples on several levels
`allocation`     the samples that each level needs, at the least cost
`refinement`     whether a mean converges with m, and what is left
===============  ===================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
