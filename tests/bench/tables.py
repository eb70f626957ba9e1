"""Run the commands of the tables that docs/ has measured, and put what they print in place: `make pages`.

    make pages                          # all commands whose tables are of another minor version than the package
    make pages COMMANDS='"make bench"'  # one command, whatever its version

A mark `<!-- made by: COMMAND, roughvol VERSION -->` stands above each table. Of a command with several marks on the
pages, the n-th mark takes the n-th table that the command prints; further tables are not shown. The commands of `WHOLE`
write a page with its mark.
Nothing else raises the version of a mark.
"""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from roughvol import __version__

ROOT = Path(__file__).parents[2]
MARK = re.compile(r"<!-- made by: (.+), roughvol (\d+\.\d+\.\d+) -->\n\n?")
WHOLE = ("make extremes", "make publish-check", "make tradeoff")
TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


def minor(version: str) -> str:
    """Return major and minor number of a version."""
    return version.rpartition(".")[0]


def marks() -> Iterator[tuple[Path, re.Match[str]]]:
    """Yield all marks with their page, page by page."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for mark in MARK.finditer(page.read_text(encoding="utf-8")):
            yield page, mark


def old() -> list[str]:
    """Return the commands of marks of another minor version, each once."""
    stale = (mark[1] for _, mark in marks() if minor(mark[2]) != minor(__version__))
    return list(dict.fromkeys(stale))


def put(command: str, printed: str) -> None:
    """Put the tables that a command printed below its marks, with the version of the package."""
    tables = TABLE.findall(printed)
    own = [(page, mark) for page, mark in marks() if mark[1] == command]
    if len(own) > len(tables):
        raise SystemExit(f"{command} prints {len(tables)} tables for {len(own)} marks")
    for (page, mark), table in reversed(list(zip(own, tables, strict=False))):  # the last one first: places stay
        text = page.read_text(encoding="utf-8")
        before = TABLE.match(text, mark.end())
        if before is None:
            raise SystemExit(f"{page}: no table below {mark[0].strip()}")
        new = f"<!-- made by: {command}, roughvol {__version__} -->\n\n{table}"
        page.write_text(text[: mark.start()] + new + text[before.end() :], encoding="utf-8")


def main() -> None:
    """Run the commands named, or all old ones."""
    for command in sys.argv[1:] or old():
        print(command, flush=True)
        words = shlex.split(command)
        call = [sys.executable, *words[1:]] if words[0] == "python" else words
        done = subprocess.run(call, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            raise SystemExit(f"{command} failed:\n{done.stdout}")
        if command not in WHOLE:
            put(command, done.stdout)


if __name__ == "__main__":
    main()
