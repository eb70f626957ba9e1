"""Rules across sections beside faults of single keys."""

from __future__ import annotations

import pytest

from roughvol.study.rules import RULES
from tests.study.kit import problems_of


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("surface: {D: 2.3, m: 4}\nsweep: {steps: []}\nrecord: {fields_at: last}", "sweep.steps"),
        ("surface: {D: 2.3, m: 4, periodic: 1}\nsolver: {kernel: fourier}", "surface.periodic"),
        ("surface: {D: [2.3, 9, 2.3], m: 4}\nsolver: {kernel: fourier}", "solver.kernel surface.D[1] surface.D[2]"),
        ("surface: {D: 2.3}\nmaterial: {E_star: 1, hardness: 1 GPa}", "material.hardness surface.m"),
        ("surface: {file: no.npy, variable: z}", "surface.L surface.file surface.variable"),
        ("surface: {D: 2.3, m: 4}\nsweep: [{to: {pressure: 1}, steps: x}, {to: {pressure: 1}}]", "sweep[0].steps"),
    ],
)
def test_a_faulty_key_hides_the_rules_that_need_it_and_no_others(text: str, keys: str) -> None:
    assert sorted(problem.key for problem in problems_of(text)) == keys.split()


def test_a_rule_needs_keys_of_a_study() -> None:
    sections = {"surface", "material", "sweep", "solver", "record", "ensemble", "fluid"}
    assert {key[0] for rule in RULES for key in rule.reads} <= sections
