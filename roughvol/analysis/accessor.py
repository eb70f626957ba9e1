"""The accessor ``ds.roughvol`` of the datasets of this package: states at a load, derived numbers, means, units.

``roughvol.open``, ``roughvol.run`` and ``roughvol.press`` register the accessor; ``import roughvol.analysis.accessor``
does so for a dataset from elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
import xarray as xr
from xarray import Dataset

from roughvol.analysis import at as states
from roughvol.analysis import average, units
from roughvol.analysis.derived import check_pressed, derived, groups
from roughvol.analysis.stored_run import Run, answers
from roughvol.errors import DatasetError
from roughvol.store.variants import SURFACES, chosen, coordinates_of_user, parts_of, recorded, whole, widened
from roughvol.study import Level, check_type, level, quantity, text_of_value
from roughvol.typing import Load, Number

NAME = "dataset"  # in messages: a dataset has no name of its own
ABSENT = "no variable {!r}; ds.roughvol.derived() adds nominal pressure and mean gap"


@xr.register_dataset_accessor("roughvol")
class Accessor:
    """What `roughvol show` prints, as datasets.

    Parameters
    ----------
    ds : Dataset
        A study with states, as `roughvol.open` returns it.

    See Also
    --------
    roughvol.open, roughvol.run, roughvol.press : Return datasets with the accessor.

    Examples
    --------
    >>> import roughvol
    >>> ds = roughvol.run({"name": "two", "surface": {"D": 2.3, "m": 3, "seeds": 2}, "sweep": {"steps": 3}}, jobs=1)
    >>> ds.roughvol.at("last").roughvol.mean()["free_volume"].dims
    ('D', 'm')
    """

    def __init__(self, ds: Dataset) -> None:
        self._ds = ds

    def at(self, state: Load = "", *, leg: int | None = None, **kind: Number) -> Dataset:
        """Return the numbers of every surface at a level.

        Parameters
        ----------
        state : str or mapping, optional
            The level as on the command line: ``"last"`` or ``"pressure=0.5 MPa, leg 2"``.
        leg : int, optional
            Leg of a path. Default: the first leg on which a surface reaches the level. A level before the first step of
            leg 1 needs its leg.
        **kind : float, str or Quantity
            The level by its kind, as ``contact_area=0.1`` or ``pressure="0.5 MPa"``.

        Returns
        -------
        Dataset
            The numbers along ``step``, and those along ``step`` and ``axis``, without ``step``, in 64 bits. Numbers
            along further dimensions are left out. A surface that does not reach the level has NaN; a surface that
            closed before has flows of 0. ``reached`` marks the surfaces that reach the level.

        Raises
        ------
        DatasetError
            If nothing was pressed, no surface reaches the level, or the arguments name no level or several.

        See Also
        --------
        roughvol.show : Returns the numbers at loads as rows, for pandas.

        Examples
        --------
        >>> import numpy as np
        >>> import roughvol
        >>> heights = np.random.default_rng(0).normal(size=(8, 10))
        >>> ds = roughvol.press(heights, L=1.0, E_star=1.0, to={"contact_area": 0.3}, steps=4)
        >>> bool(ds.roughvol.at(contact_area=0.2)["free_volume"] > ds["free_volume"].isel(step=-1))
        True
        """
        wanted = _level(state, kind, leg)
        check_pressed(whole(self._ds), f"the {NAME}")

        def of_part(part: Dataset) -> Dataset:
            run = Run.of(NAME, part)
            every, _ = answers(groups(derived(part, run.study)), lambda group: states.at(run, group[1], wanted))
            return _together([_labelled(state) for _, state in every])

        result = self._by_part(of_part)
        result["reached"] = (result["reached"] == 1.0).assign_attrs(
            units="1", long_name="the surface reaches the level"
        )
        return result

    def derived(self) -> Dataset:
        """Return the dataset with mean gap, nominal pressure, open ways, stiffness, and the leak that counts.

        Returns
        -------
        Dataset
            The same with further variables.

        See Also
        --------
        roughvol.analysis.accessor.Accessor.at : Returns them at a load.

        Examples
        --------
        >>> import numpy as np
        >>> import roughvol
        >>> ds = roughvol.press(np.eye(5), L="1 mm", E_star="1 MPa", steps=2)
        >>> ds.roughvol.derived()["mean_gap"].attrs["units"]
        'mm'
        """
        return self._by_part(lambda part: derived(part, Run.of(NAME, part).study))

    def in_units(self, **wanted: Any) -> Dataset:
        """Return the dataset with variables in other units.

        Parameters
        ----------
        **wanted : str or Unit
            Unit by the name of a variable, as ``nominal_pressure="kPa"``. Leaks at recorded states have the unit of
            ``leak_rate``, and ranges over surfaces that of their number. Coordinates, as ``L``, keep theirs.

        Returns
        -------
        Dataset
            The same, converted.

        Raises
        ------
        DatasetError
            If there is no such variable, or its unit cannot be converted.

        See Also
        --------
        roughvol.analysis.accessor.Accessor.quantity : Returns a variable as a quantity of pint.

        Examples
        --------
        >>> import numpy as np
        >>> import roughvol
        >>> ds = roughvol.press(np.eye(5), L="1 mm", E_star="1 MPa", steps=2).roughvol.derived()
        >>> in_kPa = ds.roughvol.in_units(nominal_pressure="kPa")
        >>> (in_kPa["nominal_pressure"] / ds["nominal_pressure"]).values.round(6).tolist()
        [1000.0, 1000.0]
        """
        if absent := [name for name in wanted if name not in self._ds]:
            raise DatasetError(ABSENT.format(absent[0]))
        if kept := [name for name in wanted if name in self._ds.coords]:
            raise DatasetError(f"{kept[0]} is a coordinate and keeps its unit; ds.roughvol.quantity converts it")
        texts = {name: str(text_of_value(unit, name)).removeprefix("1 ") for name, unit in wanted.items()}
        found = units.in_units(self._ds, dict(texts))
        for name, unit in texts.items():
            if (own := found[name].attrs.get("units")) != unit:
                raise DatasetError(f"{name} has the unit {own!r}, which is not converted to {unit!r}")
        return found

    def quantity(self, name: str, unit: Any = None, registry: Any = None) -> Any:
        """Return a variable as a quantity of pint.

        Parameters
        ----------
        name : str
            Name of a variable of the dataset, as ``"leak_rate"``.
        unit : str or Unit, optional
            Unit, as ``"ml/min"``. Default: the attribute ``units`` of the variable, but Pa*m^3/s for standard volumes
            of a gas, as sccm.
        registry : pint.UnitRegistry, optional
            Registry of the quantity. Default: ``pint.get_application_registry()``.

        Returns
        -------
        Quantity
            The values of the variable, an array in the order of its dimensions.

        Raises
        ------
        DatasetError
            If there is no such variable, or its unit is not known or cannot be converted.

        See Also
        --------
        roughvol.analysis.accessor.Accessor.in_units : Returns the dataset in other units.

        Examples
        --------
        >>> import numpy as np
        >>> import roughvol
        >>> ds = roughvol.press(np.eye(5), L="1 mm", E_star="1 MPa", steps=2)
        >>> print(ds.roughvol.quantity("Sq", "um").round(1))
        400.0 micrometer
        """
        check_type(name, str, "the name of a variable is text")
        if name not in self._ds.variables:
            raise DatasetError(ABSENT.format(name))
        try:
            values, own = units.for_pint(self._ds, name, None if unit is None else str(text_of_value(unit, name)))
            return quantity(values, own, unit, registry)
        except ValueError as error:
            raise DatasetError(f"{name}: {error}") from error

    def mean(self, over: str = "seed") -> Dataset:
        """Return the number of several surfaces: the median of a flow, closed surfaces as 0, else the mean.

        Parameters
        ----------
        over : str
            Dimension of the surfaces.

        Returns
        -------
        Dataset
            Each variable without ``over``, beside ``<name>_range`` (16 and 84 %) and ``<name>_count``.

        Raises
        ------
        DatasetError
            If the dataset has no such dimension, or it is that of the ends of an interval.

        See Also
        --------
        roughvol.compare : Returns the numbers of several runs at equal loads.

        Examples
        --------
        >>> import roughvol
        >>> study = {"name": "three", "surface": {"D": 2.3, "m": 3, "seeds": 3}, "sweep": {"steps": 2}}
        >>> ds = roughvol.run(study, jobs=1).roughvol.mean()
        >>> ds["free_volume"].dims, ds["free_volume_count"].values.ravel().tolist()
        (('D', 'm', 'step'), [3, 3])
        """
        check_type(over, str, "a dimension is text")
        allowed = [str(dim) for dim in self._ds.dims if dim != average.END]
        if over not in allowed:
            raise DatasetError(f"no dimension {over!r}; allowed: {', '.join(allowed)}")
        return average.averages(self._ds, over)

    def _by_part(self, function: Callable[[Dataset], Dataset]) -> Dataset:
        """Return the answers of a function for the combinations of the lists, in the order of the labels; else NaN."""
        found = []
        for part, result in answers(parts_of(widened(self._ds)), lambda part: function(part.dataset))[0]:
            for name, label in part.labels.items():
                result = result.expand_dims({name: [label]})
            found.append(result)
        joined = _together(found).assign_attrs(self._ds.attrs)
        joined = joined.set_coords([name for name in coordinates_of_user(self._ds) if name in joined])
        for key in joined.coords.keys() & self._ds.coords.keys():
            joined.variables[key].attrs |= self._ds.variables[key].attrs
        single = (*chosen(self._ds), *recorded(self._ds))
        result = joined.isel({name: 0 for name in single if name in joined.dims})
        return result.reindex({name: self._ds[name] for name in SURFACES if name in result.dims})


def _level(state: Load, kind: dict[str, Number], leg: int | None) -> Level:
    """Return the level that the arguments of `Accessor.at` name."""
    named = not isinstance(state, str | Mapping | Sequence | None) or bool(state)  # an array has no truth value
    if named + len(kind) != 1:
        raise DatasetError('at takes one level; as at("last"), at(contact_area=0.1) or at(pressure="0.5 MPa")')
    if leg is not None and not (isinstance(leg, Integral) and leg >= 1):
        raise DatasetError(f"leg is {leg!r}; allowed: a whole number from 1")
    found = level(state if named else kind)
    return found if leg is None else replace(found, leg=int(leg))


def _labelled(state: states.State) -> Dataset:
    """Return the numbers of a state in 64 bits, along the dimensions of the surfaces."""
    data = state.data
    data["reached"] = ("seed", np.arange(data.sizes["seed"]) < state.reached)
    numbers = data[[name for name in data.data_vars if data[name].dtype.kind in "fib"]].astype(float)
    if "case" in numbers.coords:
        return numbers.isel(seed=0, drop=True).expand_dims("case")
    return numbers.expand_dims(("D", "m"))


def _together(parts: list[Dataset]) -> Dataset:
    """Return one dataset; a number that a part lacks is NaN."""
    return (
        parts[0] if len(parts) == 1 else xr.merge(parts, join="outer", compat="no_conflicts", combine_attrs="override")
    )
