"""The command `explain`: keys of a study, stored variables and gases in words."""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from roughvol.cli.options import examples
from roughvol.cli.output import say
from roughvol.report import terminal

if TYPE_CHECKING:
    from roughvol.study.reference import Key

WIDTH = 100


def _names_with(context: click.Context, option: click.Parameter, start: str) -> list[str]:
    """Return the keys, variables and gases with this start."""
    return [name for name in _names() if name.startswith(start)]


def _names() -> list[str]:
    """Return all names that `explain` describes."""
    from roughvol.observables.variables import VARIABLES
    from roughvol.study.reference import keys
    from roughvol.study.sections.fluid import SUBSTANCES

    return list(dict.fromkeys([*(key.path for key in keys()), *VARIABLES, *SUBSTANCES]))


@click.command(
    epilog=examples(
        "roughvol explain                      the sections of a study",
        "roughvol explain surface.file         a key: values, default, meaning",
        "roughvol explain free_volume          a variable of study.nc",
        "roughvol explain helium               a gas: viscosity, molar mass, mean free path",
    )
)
@click.argument("name", required=False, shell_complete=_names_with)
def explain(name: str | None) -> None:
    """Describe NAME: a key of a study, a section, a stored variable, or a gas."""
    from roughvol.observables.variables import VARIABLES, columns_of
    from roughvol.study.reference import keys
    from roughvol.study.sections.fluid import SUBSTANCES

    if name is None:
        for key in keys():
            if "." not in key.path:
                _say_key(key)
        say("more: roughvol explain KEY, as surface.file; roughvol explain VARIABLE, as free_volume")
        return
    name = name.strip().strip(".")
    exact = [key for key in keys() if key.path == name]
    inside = [key for key in keys() if key.path.rpartition(".")[0] == name]
    other = [key for key in keys() if not exact and key.path.rpartition(".")[2] == name]
    if name in SUBSTANCES:
        _say_gas(name)
        return
    variable = next((stored for stored in VARIABLES if name in (stored, *columns_of(stored))), "")
    if not exact and not other and not variable:
        near = difflib.get_close_matches(name, _names(), n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise click.UsageError(f"no key and no variable {name!r}; {hint}roughvol explain lists the sections")
    if variable:
        _say_variable(variable)
    for key in exact:
        _say_key(key)
    listed: dict[str, str] = {}
    for key in inside or other:
        listed.setdefault(key.path, textwrap.shorten(key.description, WIDTH - 20, placeholder=" …"))
    if listed:
        say(textwrap.indent(terminal.aligned(("key", "meaning"), list(listed.items())), "  "))


def _say_facts(head: str, facts: Iterable[tuple[str, str]]) -> None:
    """Print a head, and facts below it with hanging lines."""
    say(head)
    for title, text in facts:
        say(textwrap.fill(text, WIDTH, initial_indent=f"  {title:10s} ", subsequent_indent=" " * 13))


def _say_key(key: Key) -> None:
    default = "must be given" if key.default is None else key.default
    facts = (("meaning", key.description), ("values", key.values), ("default", default))
    _say_facts(key.path + (f"   ({key.form})" if key.form else ""), facts)


def _say_variable(name: str) -> None:
    from roughvol.observables.variables import VARIABLES
    from roughvol.store.record_key import record_key

    row = VARIABLES[name]
    facts = (
        ("meaning", row.long_name),
        ("units", row.units),
        ("along", row.dims.replace("...", "D m seed (or case)") or "none, one number"),
        ("stored", record_key(name) or "every study, or as docs/reference/observables.md describes"),
        ("from", row.source),
    )
    _say_facts(f"{name}   {row.symbol}   variable of study.nc", facts)


def _say_gas(name: str) -> None:
    from roughvol.study.sections.fluid import SUBSTANCES, Fluid

    row, gas = SUBSTANCES[name], Fluid(gas=name, inlet="1 bar", outlet="0 bar")  # type: ignore[arg-type]
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
