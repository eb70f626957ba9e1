"""The constants of the solver."""

import dataclasses
import inspect
import re

import pytest

from roughvol.contact.options import Options, SearchTuning, Tuning
from roughvol.errors import ContactError


@pytest.mark.parametrize(("record", "most"), [(Tuning, 25), (SearchTuning, 12)])
def test_no_more_constants_than_a_reader_can_hold(record, most):
    names = [field.name for field in dataclasses.fields(record)]
    explained = re.findall(r"^(?:    #.*\n    (\w+): .*|    (\w+): .*# \w.*)$", inspect.getsource(record), re.MULTILINE)
    assert len(names) <= most
    assert [above or beside for above, beside in explained] == names
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(record(), names[0], 1)


def test_constants_of_searches_are_no_constants_of_the_solver():
    """Of searches up to 0.13 they were the argument tuning."""
    with pytest.raises(ContactError, match="tuning is a SearchTuning; allowed: Tuning; a SearchTuning is search=…"):
        Options(tuning=SearchTuning())
    with pytest.raises(ContactError, match="search is a Tuning; allowed: SearchTuning; a Tuning is tuning=…"):
        Options(search=Tuning())
