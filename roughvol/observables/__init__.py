"""Observables of a contact: its numbers, its fields, the flow through its gap, and the texture under load.

Room of the observables: pure functions of arrays, and the reduction of a sweep to what a study asks for.

To add an observable, write its function here, with a row in `recorded.AT_STATES`, `void.QUANTITIES` or
`regions.QUANTITIES`. Give each stored name a row in `store.variables`. If it has its own key, add the field in
`study.record`. docs/observables.md has the details.

=================  ============================================================"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
