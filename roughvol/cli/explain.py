"""The command `explain`: keys of a study, stored variables and gases in words."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

import roughvol
from roughvol.cli.options import command
from roughvol.cli.output import say
from roughvol.report import terminal

if TYPE_CHECKING:
    from roughvol.observables.variables import Variable
    from roughvol.study import Fluid

WIDTH = 100


def _names_with(context: click.Context, option: click.Parameter, start: str) -> list[str]:
    """Return the keys, variables and gases with this start."""
    from roughvol.questions import explained_names

    return [name for name in explained_names() if name.startswith(start)]


@command
@click.argument("name", required=False, shell_complete=_names_with)
def explain(name: str | None) -> None:
    """Describe NAME: a key of a study, a section, a variable or its symbol, a gas, or a quantity of your own."""
    found = roughvol.explain(name)
    if found.gas is not None:
        _say_gas(found.name, found.gas)
        return
    if found.variable is not None and not found.keys:
        _say_variable(found.name, found.variable, found.stored_by)
    for key in found.keys:
        default = "must be given" if key.default is None else key.default
        facts = (("meaning", key.description), ("values", key.values), ("default", default))
        _say_facts(key.path + (f"   ({key.form})" if key.form else ""), facts)
    if not found.name:
        say("more: roughvol explain KEY, as surface.file; roughvol explain VARIABLE, as free_volume")
    listed: dict[str, str] = {}
    for key in found.others:
        listed.setdefault(key.path, textwrap.shorten(key.description, WIDTH - 20, placeholder=" …"))
    if listed:
        say(textwrap.indent(terminal.aligned(("key", "meaning"), list(listed.items())), "  "))
    if found.variable is not None and found.keys:  # a section whose name is that of a variable too
        _say_variable(found.name, found.variable, found.stored_by)


def _say_facts(head: str, facts: Iterable[tuple[str, str]]) -> None:
    """Print a head, and facts below it with hanging lines."""
    say(head)
    for title, text in facts:
        say(textwrap.fill(text, WIDTH, initial_indent=f"  {title:10s} ", subsequent_indent=" " * 13))


def _say_variable(name: str, row: Variable, stored_by: str) -> None:
    from roughvol.observables.variables import LISTED

    others = "where its key has a list" if name in LISTED else "every study that it applies to" if row.stored else ""
    facts = (
        ("meaning", row.long_name),
        ("units", row.units),
        ("along", row.dims.replace("...", "D m seed (or case)") or "none, one number"),
        ("stored" if row.stored else "needs", stored_by or others),
        ("from", row.source),
    )
    kept = [fact for fact in facts if fact[1]]
    _say_facts(f"{name}   {row.symbol}   {'variable of study.nc' if row.stored else 'derived from study.nc'}", kept)


def _say_gas(name: str, gas: Fluid) -> None:
    from roughvol.study.sections.fluid import SUBSTANCES

    row = SUBSTANCES[name]
    sutherland = f"at {row.reference:g} K, Sutherland's constant {row.sutherland:g} K"
    facts = (
        ("gas", f"fluid: {{gas: {name}, inlet: 2 bar, outlet: 1 bar}}"),
        ("viscosity", f"{1e6 * gas.viscosity:.4g} uPa*s at {gas.temperature}"),
        ("stored", f"{1e6 * row.viscosity:.4g} uPa*s {sutherland}"),
        ("molar mass", f"{1e3 * row.molar_mass:.5g} g/mol"),
        ("free path", f"{1e9 * gas.mean_free_path(1e5):.3g} nm at 1 bar and {gas.temperature}"),
        ("from", "White, Viscous Fluid Flow (2006); docs/how-to/gas-leak.md"),
    )
    _say_facts(name, facts)
