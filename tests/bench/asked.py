"""What each thing asked for costs, and the work-precision table of runs/tradeoff, as notes/tradeoff.md.

`python -m tests.bench.asked` after `roughvol tradeoff configs/tradeoff.yaml` (`make tradeoff` does both). Convolutions
are counted on the half space itself, so those of a search for the end of a sweep are in.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from roughvol import __version__
from roughvol.campaign import tradeoff
from roughvol.campaign.one_case import Context, run_case
from roughvol.plotting import needed
from roughvol.report import convergence
from roughvol.report.figures.registry import TRADEOFF
from roughvol.store import dataset, tradeoff_variables
from roughvol.study import ACCURACY, loads

ROOT = Path(__file__).parents[2]
ONE = "surface: {D: 2.3, m: 7, seeds: 1}\n"
MANY = "surface: {D: [2.1, 2.3, 2.5, 2.7, 2.9], m: [5, 6, 7], seeds: 2}\nsweep: {steps: 20}\n"
TABLE_AFTER = """## Cost by request

One surface of D = 2.3, m = 7, unless stated; one thread. The states that a search ends at are solved once more by the
sweep to them, which does not depend on how the end was found: their cost is in these numbers.

"""
EVERY = ", ".join(map(str, range(1, 61)))
ASKED = {
    "a gallery: heights, no contact": (ONE + "sweep: {steps: 0}\nrecord: {heights: true}", ()),
    "60 states, numbers only": (ONE, ()),
    "… and f(v) at the last": (ONE + "record: {volume_density: {}}", ()),
    "… and box counting at the last": (ONE + "record: {box_counting: {}}", ()),
    "… and fields at the last": (ONE + "record: {fields_at: last}", ()),
    "… and fields at all 60": (ONE + f"record: {{fields_at: {{step: [{EVERY}]}}}}", ()),
    "the state at A* = 0.1, by search": (ONE + "sweep: {steps: 1, to: {contact_area: 0.1}}", ()),
    "the same by a sweep of 1000 steps": (ONE + "sweep: {steps: 1000}", ()),
    "the state at p* = 1, by search": (ONE + "sweep: {steps: 1, to: {pressure: 1}}", ()),
    "the state where the void closes, by search": (ONE + "sweep: {steps: 1, to: percolation}", ()),
    "60 states to A* = 0.1, search included": (ONE + "sweep: {to: {contact_area: 0.1}}", ()),
    "60 states, draft": (ONE + "solver: {accuracy: draft}", ()),
    "60 states, V* to 1e-4": (ONE + "solver: {max_error: {free_volume: 1.0e-4}}", ()),
    "60 states, p* to 1e-3": (ONE + "solver: {max_error: {mean_pressure: 1.0e-3}}", ()),
    "60 states, reference": (ONE + "solver: {accuracy: reference}", ()),
    "5 D × 3 m × 2 seeds": (MANY, ()),
    "… of these what fig05 needs": (MANY, ("fig05",)),
    "… of these what fig04b needs": (MANY, ("fig04b",)),
}


def cost(text: str, names: tuple[str, ...]) -> tuple[float, int, float]:
    """Return convolutions, bytes written and processor seconds of a study, or of what figures need of it."""
    study = loads(text)
    cases = study.cases()
    wanted = needed(names, cases) if names else [case.id for case in cases]
    convolutions, written, started = 0.0, 0, time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for case in (case for case in cases if case.id in wanted):
            held: dict = {}
            path = Path(folder) / f"{case.id}.nc"
            dataset.write(run_case(case, Context(held, study=study.to_yaml())), path)
            convolutions += sum(space.convolutions + space.convolutions_fp32 for space in held.values())
            written += path.stat().st_size
    return convolutions, written, time.process_time() - started


def asked() -> str:
    """Return the table of costs."""
    lines = ["| asked for | convolutions | bytes written | seconds |", "|---|---|---|---|"]
    cost(ONE, ())  # imports and plans
    for name, (text, names) in ASKED.items():
        convolutions, written, seconds = cost(text, names)
        lines.append(f"| {name} | {convolutions:.0f} | {written:,} | {seconds:.2f} |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def precision(ds: dataset.Dataset) -> str:
    """Return the ladder of tolerances, worst of all surfaces and states, time in both precisions."""
    head = "asked η/σ | error of A* | of p* | of V* | of f(v) | of box dimension | bound of V* | of p* | units a step"
    lines = [f"| {head} | seconds | all in double |", "|---" * 11 + "|"]
    ladder = ds["ladder"].values == "tolerance"
    names = {rtol: f" ({name})" for name, rtol in ACCURACY.items()}
    for rtol in tradeoff.RTOLS:
        here = ladder & np.isclose(ds["rtol"].values, rtol, rtol=1e-9, atol=0.0)
        mixed, double = (
            ds.isel(rung=int(np.flatnonzero(here & (ds["precision"].values == how))[0])) for how in ("mixed", "double")
        )
        worst = [
            float(mixed[name].max())
            for name in (
                *(
                    f"{quantity}_error"
                    for quantity in (*tradeoff_variables.QUANTITIES, "volume_density", "box_dimension")
                ),
                "residual",
                "mean_pressure_bound",
            )
        ]
        errors = " | ".join("0" if error == 0.0 else f"{error:.0e}" for error in worst)
        name = next((text for value, text in names.items() if abs(value / rtol - 1) < 1e-9), "")
        lines.append(
            f"| {rtol:.0e}{name} | {errors} | {float(mixed.units.mean()):.1f} | {float(mixed.seconds.mean()):.2f} | "
            f"{float(double.seconds.mean()):.2f} |"
        )
    return "\n".join(lines)


def settings(ds: dataset.Dataset) -> str:
    """Return the other ladders."""
    lines = ["| varied | setting | error of A* | of p* | of V* | units a step | seconds | peak memory |"]
    lines.append("|---" * 8 + "|")
    for k in np.flatnonzero(ds["ladder"].values != "tolerance"):
        row = ds.isel(rung=int(k))
        ladder = row.ladder.item()
        value = row[{"resolution": "m"}.get(ladder, ladder)].item()
        extra = f" (m = {row.m.item()}, {row.steps.item()} steps)" if ladder == "method" else ""
        errors = " | ".join(f"{float(row[f'{name}_error'].max()):.0e}" for name in tradeoff_variables.QUANTITIES)
        lines.append(
            f"| {ladder} | {value}{extra} | {errors} | {float(row.units.mean()):.1f} | "
            f"{float(row.seconds.mean()):.3f} | {float(row.memory.max()) / 1e6:.1f} MB |"
        )
    return "\n".join(lines)


def main() -> None:
    """Write docs/explanation/notes/tradeoff.md and its diagram; with --asked, only the table of costs."""
    if sys.argv[1:] == ["--asked"]:
        page = (ROOT / "docs" / "explanation" / "notes" / "tradeoff.md").read_text(encoding="utf-8")
        head, _ = page.split(TABLE_AFTER.partition("\n")[0])
        (ROOT / "docs" / "explanation" / "notes" / "tradeoff.md").write_text(
            f"{head}{TABLE_AFTER}{asked()}\n", encoding="utf-8"
        )
        return
    ds = dataset.read(ROOT / "runs" / "tradeoff" / "tradeoff.nc")
    TRADEOFF["tradeoff_precision"](ds).savefig(ROOT / "docs" / "pictures" / "tradeoff.png")
    saved = 100 * convergence.time_saved(ds)
    verdicts = "\n".join(f"- {line}" for line in convergence.summary(ds).splitlines() if line.startswith("D = "))
    page = f"""# Speed against accuracy

<!-- made by: make tradeoff, roughvol {__version__} -->

## The solver

Written by `make tradeoff`. Measured on {ds.sizes["surface"]} surfaces of configs/tradeoff.yaml (D = 2.1, 2.5, 2.9,
m = 8, 60 steps to the mean plane), one thread; seconds are processor time of a sweep, means over the surfaces. Errors
are the largest of any state of any surface, against η/σ ≤ 1e-12 in double precision; p* is relative. A unit is one
convolution in double precision.

**Ten times less accuracy costs {saved:.0f} per cent less time.**

{precision(ds)}

The bounds are certified: η/σ bounds the error of V*, η/σ times a bound of the stiffness of the contact that of p*
(docs/explanation/solver.md). A residual looser than 1e-2 saves nothing.

## The other choices

Steps and kernel at η/σ ≤ 1e-9; the resolution against its finest level at equal separations d/σ; the method at 1e-6.

{settings(ds)}

## Converged in m?

At the last state, from the last two refinements (Richardson); converged: less than
{100 * convergence.CONVERGED:.0f} % still to come.

{verdicts}

{TABLE_AFTER}{asked()}
"""
    (ROOT / "docs" / "explanation" / "notes" / "tradeoff.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
