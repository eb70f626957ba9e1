"""The command `tradeoff`: speed against accuracy."""

from __future__ import annotations

from pathlib import Path

import roughvol
from roughvol.cli.options import JSON, SET, STUDY, command, given, out
from roughvol.cli.output import is_seen, say, say_json


@command
@STUDY
@out("runs/NAME")
@JSON
@SET
def tradeoff(study: Path, out: Path | None, as_json: bool, changes: tuple[str, ...]) -> None:
    """Measure speed against accuracy on the surfaces of STUDY, with work-precision diagrams; numbers in tradeoff.nc.

    Shows also the convergence of A*, p* and V* in the resolution m of the study.
    """
    from roughvol.questions import study_of
    from roughvol.report import convergence
    from roughvol.report.figures import registry
    from roughvol.store import dataset, stamped_file

    loaded, folder = study_of(given(study, changes), changes, of_run=True)
    folder, show = out or folder, is_seen()
    measured = roughvol.tradeoff(
        loaded, on_sweep=lambda k, n: say(f"\r{k} of {n} sweeps", nl=k == n, err=True) if show else None
    )
    dataset.write(measured, folder / "tradeoff.nc")
    lines = []
    for name, figure in registry.TRADEOFF.items():
        if figure.missing(measured) is None:
            stamped_file.make_folder(folder / "figures")
            figure(measured).savefig(folder / "figures" / f"{name}.png")
            lines.append(str(folder / "figures" / f"{name}.png"))
    if as_json:
        say_json({"study": loaded.name, "file": str(folder / "tradeoff.nc"), **measured.to_dict()})
        return
    say("\n".join([*lines, convergence.summary(measured), str(folder / "tradeoff.nc")]))
