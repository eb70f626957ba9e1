"""Loads and lengths with units as starred numbers of one surface.

Conventions: σ = Sq. A pressure p is p* = p L/(E* σ), a length h is h/σ. A load F acts on all elements: its mean
pressure is F/A with A the area of the elements, nodes times spacing squared. A leak rate Q under ΔP of a fluid of
viscosity μ is Q 12 μ/(ΔP σ³): T* V*³ times width over length of the region.
"""

from __future__ import annotations

from dataclasses import dataclass

from roughvol.study.values.state_kinds import STATE_KINDS, Level
from roughvol.study.values.units import convert, unit_of

OF_ALL = "a load is the nominal pressure times N^2 δ^2, on a free patch of N = 33 nodes a side 6 % more than L^2"
"""The area that a load acts on, in words."""


@dataclass(frozen=True)
class Scale:
    """What turns numbers with units into starred ones.

    Attributes
    ----------
    E_star : float
        Contact modulus in ``modulus_unit``.
    L, Sq : float
        Length and root mean square height of the surface, in ``length_unit``.
    area : float
        Area of all elements, in the square of ``length_unit``.
    modulus_unit, length_unit : str or None
        Units of the study; None for arbitrary ones.
    drive : float or None
        ΔP/μ of the fluid [1/s], None without one.
    """

    E_star: float
    L: float
    Sq: float
    area: float
    modulus_unit: str | None = None
    length_unit: str | None = None
    drive: float | None = None

    def starred(self, kind: str, value: float) -> tuple[str, float]:
        """Return the starred quantity that a value fixes, and its starred value.

        Parameters
        ----------
        kind : str
            Of `STATE_KINDS`.
        value : float
            A `Quantity`, or a starred number.

        Returns
        -------
        (str, float)
            pressure, separation, indentation, free_volume or contact_area; its value [1].

        Raises
        ------
        ValueError
            If the unit of the modulus or of length is needed and unknown, or the surface is flat.
        """
        quantity = STATE_KINDS[kind].fixes
        if (unit := unit_of(value)) is None:
            return quantity, float(value)
        if not self.Sq > 0.0:
            raise ValueError(f"{kind} {value}: the surface is flat, Sq is 0, and has no starred numbers")
        if message := Level(kind, value).lacking(self.modulus_unit, self.length_unit):
            raise ValueError(message)
        if quantity == "pressure":
            assert self.modulus_unit is not None
            modulus = convert(self.E_star, self.modulus_unit, "Pa")
            pressure = convert(float(value), unit, "Pa") if kind == "pressure" else self._pressure(float(value), unit)
            return quantity, pressure * self.L / (modulus * self.Sq)
        assert self.length_unit is not None
        if kind.startswith("leak_rate"):
            if self.drive is None:
                raise ValueError(f"{kind} {value}: needs the fluid, record.dimensional.leak_rate")
            return quantity, convert(float(value), unit, "m^3/s") * 12.0 / (self.drive * self._sigma_in_metres**3)
        return quantity, convert(float(value), unit, self.length_unit) / self.Sq

    @property
    def _sigma_in_metres(self) -> float:
        assert self.length_unit is not None
        return self.Sq * convert(1.0, self.length_unit, "m")

    def _pressure(self, load: float, unit: str) -> float:
        """Return the mean pressure of a load in Pa."""
        assert self.length_unit is not None
        metre = convert(1.0, self.length_unit, "m")
        return convert(load, unit, "N") / (self.area * metre**2)
