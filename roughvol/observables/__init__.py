"""Observables of a contact: its numbers, its fields, the flow through its gap, and the texture under load.

Room of the observables: pure functions of arrays, and the reduction of a sweep to what a study asks for.

To add an observable, write its function here, with a row in `recorded.AT_STATES`, `void.QUANTITIES` or
`regions.QUANTITIES`. Give each stored name a row in `observables.variables`. If it has its own key, add the field in
`study.record`. docs/observables.md has the details.

=================  ===================================================================
`variables`        the table of stored variables, from `variables.toml`
`reduction`        each state of a sweep reduced to stored values
`recorded`         the list of observables: states, functions, labels, costs
`levels`           the states at which an observable is taken
`along_steps`      observables stored along the steps
`deformed`         texture before load and under load
`waves`            power spectral density of the undeformed surface
`plastic`          hardness in the unit of p*, the residual surface and its texture
`pressures`        shares above the hardness, the pressure in the middle
`coupling`         contact and flow together: fluid pressure that lifts a seal
`stiffness`        pressure per separation along a loading
`conductance`      contact conductance from the stiffness
`void`             the transport that a study asks for, state by state
`regions`          a part of the surface, and central squares
`at_state`         quantities of a sweep at a given state, between its steps
`multilevel`       multilevel estimators of the mean over an ensemble
`best_linear`      the best linear estimator for a given covariance
`allocation`       the optimal number of samples on each level
`refinement`       the bias of a mean by the resolution
=================  ===================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
