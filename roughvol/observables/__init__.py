"""Observables of a contact: its numbers, its fields, the flow through its gap, and the texture under load.

Room of the observables: pure functions of arrays, and the reduction of a sweep to what a study asks for.

An observable is a row of `variables.toml` and a function of a `View`. CONTRIBUTING.md shows how to add
an observable.

=================  ===================================================================
`variables`        the table of observables and stored variables, `variables.toml`
`reduction`        each state of a sweep reduced to stored values
`requests`         what a study asks for: states, costs
`levels`           the states at which an observable is taken
`deformed`         texture and spectrum before load, under load, and of the surface left by yield
`pressures`        hardness in the unit of p*, shares above it, yield, the pressure in the middle
`coupling`         contact and flow together: fluid pressure that lifts a seal
`stiffness`        pressure per separation along a loading, and the contact conductance
`void`             percolation, constriction, and flow through the void
`own`              functions of a user, what they get and the rows of what they return
`fields`           gap and pressure; density and box counting of element volumes; numbers of central squares
`regions`          a part of the surface, and a state as an observable sees it
`at_state`         quantities of a sweep at a given state, between its steps
=================  ===================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
