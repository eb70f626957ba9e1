"""The variables of the dataset that a trade-off study stores: `tradeoff_variables.toml`, read once."""

from __future__ import annotations

from roughvol.observables.variables import Variable, variables
from roughvol.tables import table

QUANTITIES = {"contact_area_fraction": "A*", "mean_pressure": "p*", "free_volume": "V*"}
RUNG, EACH = "rung", "rung surface"
_GROUPS = table(__file__)["group"]
TABLE: dict[str, Variable] = variables(_GROUPS)
RUNG_VARIABLES = {name: row for name, row in TABLE.items() if row.dims == RUNG}
