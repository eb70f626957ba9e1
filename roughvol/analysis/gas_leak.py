"""The leak of a gas in the place of that of a liquid, for read-offs."""

from __future__ import annotations

from xarray import Dataset

from roughvol.analysis import read_off
from roughvol.study import read
from roughvol.study.values.units import unit_of


def is_throughput(text: str) -> bool:
    """Return whether a leak on a command line has a unit of throughput, as 1e-4 mbar*l/s or 2 sccm.

    Parameters
    ----------
    text : str
        Number and unit.

    Returns
    -------
    bool
        False also for text that is no quantity.
    """
    try:
        return unit_of(read(text, "throughput")) is not None
    except ValueError:
        return False


def in_place(run: Dataset, unknown: str) -> tuple[Dataset, float]:
    """Return a run whose leak rates and transmissivities are those of its gas, and the temperature of the gas [K].

    The leak of a gas depends on p* alone where Sq stays: its mean free path over Sq is then the same.

    Parameters
    ----------
    run : Dataset
        A study with ``gas_leak_rate``.
    unknown : str
        Quantity to find: pressure or modulus.

    Returns
    -------
    (Dataset, float)
        The same run with other ``leak_rate`` and ``transmissivity``; kelvins.

    Raises
    ------
    StudyError
        If the run has no leak of a gas, a fluid pressure lifts the gap, or Sq is asked for.
    """
    read_off.check(run, leaks=False)
    if "gas_leak_rate" not in run:
        read_off.refuse("the run has no leak of a gas: record transport.gas_flow and dimensional.gas_leak_rate")
    if unknown == "Sq":
        read_off.refuse("the leak of a gas depends on its mean free path over Sq; allowed: for pressure, modulus")
    of_gas = {name: run[f"gas_{name}"] for name in ("leak_rate", "transmissivity")}
    return run.assign(of_gas), float(run["gas_leak_rate"].attrs["temperature_K"])
