"""The variables of the dataset that a trade-off study stores."""

from __future__ import annotations

from roughvol.observables.variables import Variable

QUANTITIES = {"contact_area_fraction": "A*", "mean_pressure": "p*", "free_volume": "V*"}


RUNG = "rung"


RUNG_VARIABLES: dict[str, Variable] = {
    "ladder": Variable(RUNG, "1", "what is varied", "ladder", "text"),
    "rtol": Variable(RUNG, "1", "bound asked for on the residual", "η/σ"),
    "precision": Variable(RUNG, "1", "of the convolutions inside the iteration", "precision", "text"),
    "kernel": Variable(RUNG, "1", "influence coefficients", "kernel", "text"),
    "method": Variable(RUNG, "1", "solver", "method", "text"),
    "steps": Variable(RUNG, "1", "steps of the sweep", "K", "index"),
    "m": Variable(RUNG, "1", "levels of midpoint displacement, -1 for a height file", "m", "index"),
}


EACH = f"{RUNG} surface"


TABLE: dict[str, Variable] = RUNG_VARIABLES | {
    "surface": Variable("surface", "1", "surface of the study", "surface", "text"),
    "contact_area_fraction_error": Variable(EACH, "1", "largest error of A*", "|δA*|"),
    "mean_pressure_error": Variable(EACH, "1", "largest relative error of p*", "|δp*|/p*"),
    "free_volume_error": Variable(EACH, "1", "largest error of V*", "|δV*|"),
    "volume_density_error": Variable(EACH, "1", "∫ |δf| dv at the last state", "∫|δf|dv"),
    "box_dimension_error": Variable(EACH, "1", "largest error of the local box dimension, last state", "|δD_box|"),
    "contact_area_fraction": Variable(EACH, "1", "A* of the last state", "A*"),
    "mean_pressure": Variable(EACH, "1", "p* of the last state", "p*"),
    "free_volume": Variable(EACH, "1", "V* of the last state", "V*"),
    "residual": Variable(EACH, "1", "largest residual: the certified bound of the error of V*", "η/σ"),
    "mean_pressure_bound": Variable(EACH, "1", "largest certified bound of the relative error of p*", "|δp*|/p*"),
    "convolutions_per_step": Variable(EACH, "1", "convolutions a step in double precision", "n64/K"),
    "convolutions_fp32_per_step": Variable(EACH, "1", "convolutions a step in single precision", "n32/K"),
    "units": Variable(EACH, "1", "work a step in convolutions in double precision", "u/K"),
    "seconds": Variable(EACH, "s", "processor time of the sweep, one thread", "t"),
    "memory": Variable(EACH, "B", "peak memory of half space and sweep (first surface only)", "M"),
}
