"""Notes under tables: the names of rows with equal words."""

from roughvol.report.states import States, shortest_names


def test_a_run_is_named_without_its_parts_where_all_of_them_have_the_same_words() -> None:
    rows = ["water, E = 4 MPa, a.txt", "water, E = 8 MPa, a.txt", "oil, E = 4 MPa, a.txt"]
    assert shortest_names({"thin": rows[:2], "thick": rows[2:]}) == {"thin": "water", "thick": "oil"}
    low_and_high = {"low": "water, E = 4 MPa and oil", "high": "water, E = 8 MPa"}
    assert shortest_names({"low": rows[::2], "high": rows[1:2]}) == low_and_high
    assert shortest_names({"thin": ["water"], "thick": ["water"]}) == {"thin": "water", "thick": "water"}


def test_a_table_without_flows_has_no_words_on_ways() -> None:
    bare, leaking = (States(("state",), (), columns).rule for columns in (("free_volume",), ("free_volume", "open_x")))
    assert bare == "Between steps: monotone cubics over the quantity asked for."
    assert "A way that closes between two steps" in leaking
