"""The line below a drawing: its run, surfaces, version and date; and which variables a dataset lacks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from xarray import Dataset

from roughvol.analysis.leak import fluid_of, is_lifted
from roughvol.analysis.legs import first_leg
from roughvol.analysis.tables import range_text
from roughvol.observables.variables import STATES
from roughvol.report.figures.families import file_text, held
from roughvol.report.figures.style import unit_of, unit_text
from roughvol.store.dimensional import LEAKS
from roughvol.store.record_key import record_key
from roughvol.store.variants import study_in
from roughvol.study import Region

SHOWN = 3  # files that are named
WHOLE = Region().label


def run_name(ds: Dataset) -> str:
    """Return the name of the study of a dataset, empty if it has none."""
    match = re.search(r"^name: *(.+?) *$", str(ds.attrs.get("study", "")), re.MULTILINE)
    return match.group(1).strip("'\"") if match else ""


def region_of(ds: Dataset) -> str:
    """Return the region that a run observes, in words; empty where it is the whole surface."""
    region = str(ds.attrs.get("region", WHOLE))
    return "" if region == WHOLE else region


def surfaces(ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
    """Return in words which surfaces are drawn: files, or D, m, L, a region that is a part, and how many of each."""
    unit = unit_of(ds, "L")
    side = f"L = {float(ds['L']):g}" + (f" {unit}" if unit != "length" else "")
    side += f", region {region}" if (region := region_of(ds)) else ""
    if "case" in ds.dims:
        names = [file_text(str(name)) for name in ds["case"].values.tolist()]
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        return f"height {'file' if len(names) == 1 else 'files'} {', '.join(names[:SHOWN])}{more}, {side}"
    values = {dim: drawn.get(dim) or ds[dim].values.tolist() for dim in ("D", "m") if dim in ds.dims}
    parts = [f"{dim} = {numbers_text(numbers)}" for dim, numbers in values.items()]
    if "samples" in drawn:
        return ", ".join([*parts, side, _samples(values["D"], drawn["samples"])])
    counts = sorted({int(count) for count in drawn.get("surfaces", (1,))})
    number = "one surface" if counts == [1] else f"{range_text(counts)} surfaces"
    several = " of each" if max(map(len, values.values()), default=1) > 1 else ""
    return ", ".join([*parts, side, number + several])


def origin(ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
    """Return the run of a figure and the surfaces that it shows, in words.

    ``drawn`` has the values of ``D``, ``m``, ``surfaces`` (how many of each) and ``samples`` (of an ensemble, by D and
    m) that the figure shows, as far as they apply.
    """
    run = run_name(ds)
    return f"Run {run}: {surfaces(ds, drawn)}" if run else surfaces(ds, drawn)


def _samples(D: Sequence[float], counts: Sequence[float]) -> str:
    """Return in words the samples of an ensemble on each level, by D; ``counts`` runs over D, then m."""
    levels = len(counts) // len(D)
    rows = [numbers_text(counts[k * levels : (k + 1) * levels]) for k in range(len(D))]
    if len(D) > 1:
        rows = [f"{row} (D = {value:g})" for row, value in zip(rows, D, strict=True)]
    return f"samples by m: {'; '.join(rows)}"


def numbers_text(values: Sequence[float]) -> str:
    """Return numbers with commas between them."""
    return ", ".join(f"{value:g}" for value in values)


def written(ds: Dataset) -> list[str]:
    """Return the version and the date of a dataset in words; empty without them."""
    version, date = (str(ds.attrs.get(key, "")) for key in ("roughvol_version", "date"))
    return [f"roughvol {version}, {date[:10]}."] if version and date else []


def fluid_text(ds: Dataset) -> str:
    """Return pressure drop and viscosity of the leak rates of a dataset as they are printed; empty without them."""
    return unit_text(fluid_of(ds))


def fluid_note(ds: Dataset) -> list[str]:
    """Return `fluid_text` as a sentence; empty without leak rates."""
    words = fluid_text(ds)
    return [f"{words[:1].upper()}{words[1:]}."] if words else []


def leg_note(ds: Dataset, names: Sequence[str]) -> list[str]:
    """Return that a figure shows leg 1, where numbers that it needs are those of steps or states of a path."""
    along = {dim for name in names if name in ds for dim in ds[name].dims}
    return ["Leg 1 of a path; path_loops draws every leg."] if "leg" in ds and along & {"step", *STATES} else []


def patch_note(datasets: Sequence[Dataset], names: Sequence[str]) -> list[str]:
    """Return that leaks are those of a patch, where a figure shows leaks and any of the studies has a seal."""
    seals = [study.seal for ds in datasets if (study := study_in(ds))] if set(LEAKS) & set(names) else []
    return ["The leak of a patch, not of the seal."] if any(seals) else []


def dry_note(datasets: Sequence[Dataset]) -> list[str]:
    """Return that a figure shows the gap without fluid pressure, where fluid pressure lifts the gap of any dataset."""
    return ["The gap without fluid pressure."] if any(map(is_lifted, datasets)) else []


def lacking(name: str, ds: Dataset, variables: Sequence[str], *, joint: str = ", ") -> str | None:
    """Return which variables of a figure a dataset does not have in any case, in words, or None.

    ``joint`` is between the names of absent variables and between their keys.
    """
    absent = [variable for variable in variables if variable not in ds]
    if absent:
        keys = dict.fromkeys(filter(None, map(record_key, absent)))
        hint = f" ({joint.join(keys)})" if keys else ""
        return f"{name} needs {joint.join(absent)}, which the run does not have{hint}"
    if not bool(held(first_leg(ds), *variables).any()):
        where = " on the first leg" if "leg" in ds else ""
        return f"{name} needs {', '.join(variables)}, and no case of the dataset has a value of each{where}"
    return None
