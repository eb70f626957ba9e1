"""The command line: the only place that prints, draws progress and exits.

Options choose how a study is run. The physics is in the study alone.

============  =============================================================
`group`       the group of all commands: help page, errors, exit codes
`options`     arguments and options that commands share
`output`      what is printed
`studies`     commands that take a study: check, run, status, tradeoff
`results`     commands that read results: plot, report
`numbers`     numbers on the screen: show, ls, compare
`leak`        answers for a design review: card, ask, creep
`beginning`   the first hour: init, explain
============  =============================================================
"""

from roughvol.cli.beginning import explain, init
from roughvol.cli.group import main
from roughvol.cli.leak import ask, card, creep
from roughvol.cli.numbers import compare, ls, show
from roughvol.cli.results import plot, report
from roughvol.cli.studies import check, run, schema, status, tradeoff

__all__ = [
    "ask",
    "card",
    "check",
    "compare",
    "creep",
    "explain",
    "init",
    "ls",
    "main",
    "plot",
    "report",
    "run",
    "schema",
    "show",
    "status",
    "tradeoff",
]
