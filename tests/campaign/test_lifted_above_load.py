"""A coupled study whose inlet is above the load: the first order has no state, the coupled problem has one."""

from __future__ import annotations

import numpy as np
import pytest

from roughvol.campaign.one_case import run_case
from roughvol.errors import ContactError
from roughvol.study import loads

TEXT = """
surface: {{D: 2.2, m: 4, seeds: [{seed}]}}
sweep: {{steps: 2, to: {{pressure: 4}}}}
record: {{transport: {{transmissivity: last}}, fluid_pressure: {{inlet: {inlet}, outlet: 0, at: last{coupling}}}}}
"""


def test_one_way_numbers_are_missing_where_the_first_order_opens_the_joint() -> None:
    case = loads(TEXT.format(seed=1, inlet=4.8, coupling=""), "x.yaml").cases()[0]
    found = run_case(case)
    one_way = [float(found["fluid_leak_one_way"].sel(axis=axis).values.ravel()[0]) for axis in "xy"]
    coupled = [float(found["fluid_leak"].sel(axis=axis).values.ravel()[0]) for axis in "xy"]
    assert np.isfinite(coupled).all()
    assert np.isnan(one_way).any()
    alone = loads(TEXT.format(seed=1, inlet=4.8, coupling=", coupling: one-way"), "x.yaml").cases()[0]
    with pytest.raises(ContactError, match="mean fluid pressure"):
        run_case(alone)
