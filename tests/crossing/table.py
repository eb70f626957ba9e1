"""The crossing table: every question on every kind of run is right, or refused with a sentence.

`CELLS` has one entry for each question. ``right`` lists the kinds whose numbers are compared with the oracle.
``refused`` has the words that the message must contain. A kind in neither is an empty cell, which fails the tests.
"""

from dataclasses import dataclass, field
from pathlib import Path

from tests.crossing.kinds import KINDS
from tests.crossing.questions import QUESTIONS

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "crossing.md"
UNITS = (
    "one seeds sealed m files bodies spectrum grids period-grids materials part layers regions legs one-way coupled "
    "gas gas-alone lifted-gas region mirrored periodic closed some-closed percolation solved to-pressure to-area "
    "force nominal gap records"
)
PRESSED = f"{UNITS} D ensemble own mean-plane"
UNPRESSED = {"unpressed": "nothing was pressed"}
OTHER_RUN = dict.fromkeys(("study-changed", "file-changed"), "holds the results of another study")
OTHER_RESULTS = dict.fromkeys(("study-changed", "file-changed"), "does not hold the results of")
SHOWN = UNPRESSED | OTHER_RESULTS


@dataclass(frozen=True)
class Cells:
    """The cells of a question."""

    right: str
    refused: dict[str, str] = field(default_factory=dict)


NO_LEAK = dict.fromkeys(("D", "ensemble", "own", "mean-plane", "unpressed"), "which the run does not have")
PRESSED_AGAIN = (
    "one sealed bodies spectrum grids period-grids materials part layers regions legs one-way coupled gas gas-alone "
    "lifted-gas region mirrored periodic closed some-closed percolation mean-plane to-pressure to-area force "
    "nominal gap records unpressed study-changed file-changed"
)
ONE_MAP = {
    **dict.fromkeys(("seeds", "solved"), "heights have shape (3, 17, 17); allowed: two dimensions of at least 3 nodes"),
    "D": "heights have shape (4, 17, 17); allowed: two dimensions of at least 3 nodes each",
    "m": "allowed: rows of one length",
    "files": "allowed: real numbers",
    **dict.fromkeys(("ensemble", "own"), "unexpected keyword argument 'ensemble'"),
}
ONE_KIND = (
    "one seeds sealed files bodies spectrum grids period-grids part gas gas-alone region mirrored periodic closed "
    "some-closed percolation solved to-pressure to-area force nominal gap records"
)
SEVERAL = {
    "m": "the run has several m",
    "materials": "the run has several E",
    "layers": "the run has several thickness",
    "regions": "the run has several region",
    **dict.fromkeys(("one-way", "coupled", "lifted-gas"), "record.fluid_pressure lifts the gap"),
}
READ_OFF = SEVERAL | OTHER_RESULTS | UNPRESSED
NO_LEAK_RATE = dict.fromkeys(("D", "ensemble", "own", "mean-plane"), "the run has no leak rates")
CELLS = {
    "run": Cells(f"{PRESSED} unpressed", OTHER_RUN),
    "show": Cells(PRESSED, SHOWN),
    "show --at": Cells(PRESSED, SHOWN),
    "show --json": Cells(PRESSED, SHOWN),
    "show --csv": Cells(PRESSED, SHOWN),
    "compare": Cells(PRESSED, SHOWN),
    "plot v_of_p": Cells(PRESSED, OTHER_RESULTS | {"unpressed": "which the run does not have"}),
    "plot leak_of_p": Cells(UNITS, OTHER_RESULTS | NO_LEAK),
    "report": Cells(f"{PRESSED} unpressed", OTHER_RESULTS),
    "roughvol.plot": Cells(PRESSED, OTHER_RESULTS | {"unpressed": "which the run does not have"}),
    "roughvol.open": Cells(f"{PRESSED} unpressed", OTHER_RESULTS),
    "ds.roughvol.at": Cells(PRESSED, SHOWN),
    "roughvol.run": Cells(f"{PRESSED} unpressed", OTHER_RUN),
    "roughvol.press": Cells(PRESSED_AGAIN, ONE_MAP),
    "card": Cells(
        f"{UNITS.replace(' m ', ' ')} mean-plane study-changed file-changed",
        {
            **dict.fromkeys(("m", "D"), "a leak card is of one kind of surface; allowed: one D and one m"),
            **dict.fromkeys(("ensemble", "own"), "a leak card takes seeds, and no ensemble"),
            "unpressed": "a leak card needs a load",
        },
    ),
    "ask": Cells(f"{ONE_KIND} legs", READ_OFF | NO_LEAK_RATE),
    "ask --closed": Cells(
        f"{ONE_KIND} legs mean-plane",
        READ_OFF | {"D": "the run has several D"} | dict.fromkeys(("ensemble", "own"), "the run has several m"),
    ),
    "creep": Cells(ONE_KIND, READ_OFF | NO_LEAK_RATE | {"legs": "the surface yields"}),
    "check": Cells(f"{PRESSED} unpressed study-changed file-changed"),
    "status": Cells(f"{PRESSED} unpressed", OTHER_RUN),
}
TOGETHER = {
    "roughvol.show": "show --json",
    "roughvol.compare": "compare",
    "roughvol.report_on": "report",
    "roughvol.card": "card",
    "roughvol.ask": "ask",
    "roughvol.creep": "creep",
    "roughvol.check": "check",
    "roughvol.status": "status",
}
"""Python functions by the column of their command, where both answers are compared."""
NOT_ASKED = {
    "ds.roughvol.derived": "numbers that `ds.roughvol.at` and the tables have at loads",
    "ds.roughvol.in_units": "the same numbers in other units",
    "ds.roughvol.mean": "the means that the tables have",
    "ds.roughvol.quantity": "one variable of the same numbers, with its unit",
    "explain": "describes keys and variables; it prints no number of a surface",
    "init": "writes an example study; it reads no run",
    "licences": "lists the licences of the installed packages; it reads no run",
    "ls": "lists the runs of a folder; it prints no number of a surface",
    "schema": "prints the schema of study files; it reads no run",
    "tradeoff": "measures error and time of the solver on surfaces of its own; it reads no run",
    "roughvol.licences": "lists the licences of the installed packages, as licences",
    "roughvol.runs": "lists the runs of a folder, as ls",
    "roughvol.explain": "describes keys and variables, as explain",
    "roughvol.tradeoff": "measures error and time of the solver, as tradeoff",
    "roughvol.load": "reads a study file; it reads no run",
    "roughvol.RoughvolWarning": "the class of warnings",
}
"""Commands and Python functions without a column, each with the reason."""

HEAD = """# What may be combined

Each row is a kind of run, each column a question about the run. "right" means: the tests put the question through the
command line or Python, and compare every number of the answer with the number taken from `study.nc` by plain numpy. A
letter means: the question is refused with exit code 2, and the message has the words beside the letter below the table.
`make crossing` writes this page. `tests/crossing/` checks every cell.

"""


def cell(question: str, kind: str) -> list[str]:
    """Return the entries of a cell, of which a complete table has one: ``right``, or the words of a refusal."""
    cells = CELLS[question]
    right = ["right"] if kind in cells.right.split() else []
    return right + [words for name, words in cells.refused.items() if name == kind]


def page() -> str:
    """Return the page of the table in Markdown."""
    sentences: dict[str, str] = {}
    lines = [f"| kind of run | {' | '.join(f'`{name}`' for name in QUESTIONS)} |", "|---" * (len(QUESTIONS) + 1) + "|"]
    for kind in KINDS:
        row = [kind.title]
        for name in QUESTIONS:
            (words,) = cell(name, kind.name)
            letter = words if words == "right" else f"*{sentences.setdefault(words, _letter(len(sentences)))}*"
            row.append(letter)
        lines.append(f"| {' | '.join(row)} |")
    lines += ["", "Words of the refusals:", ""]
    lines += [f"- *{letter}*: “… {words} …”" for words, letter in sentences.items()]
    lines += ["", "The questions:", ""]
    lines += [f"- `{name}`: {(function.__doc__ or '').splitlines()[0]}" for name, function in QUESTIONS.items()]
    lines += ["", "Python functions whose answers are compared with those of a command, in its column:", ""]
    lines += [f"- `{name}`: `{question}`." for name, question in TOGETHER.items()]
    lines += ["", "Commands and functions without a column:", ""]
    lines += [f"- `{name}` {words}." for name, words in NOT_ASKED.items()]
    return HEAD + "\n".join(lines) + "\n"


def _letter(number: int) -> str:
    return "abcdefghijklmnopqrstuvwxyz"[number % 26] * (1 + number // 26)
