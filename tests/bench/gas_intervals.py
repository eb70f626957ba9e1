"""How often the interval of a gas on a leak card, by the factors of a liquid, holds the leak of a finer surface.

    python -m tests.bench.gas_intervals --surfaces 5

Mirrored midpoint surfaces of 65 × 65 nodes have a card each, and the same seeds at m = 8 are the truth. Both are the
same window, so the part of the window is left out. Of helium, one pair of pressures leads into vacuum, so that mean
free paths are long, and one is close to viscous flow.
"""

import argparse
import math
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import roughvol
from roughvol.analysis.parts import together
from roughvol.errors import RoughvolWarning

AREAS = (0.08, 0.2)  # A* of the truth at the loads of the cards
DIMENSIONS, CARD, TRUTH = (2.1, 2.3, 2.5, 2.7), 6, 8
GASES = {  # Sq, and pressures on both sides
    "rarefied": ("0.1 um", {"gas": "helium", "inlet": "2 bar", "outlet": "0 bar"}),
    "nearly viscous": ("2 um", {"gas": "helium", "inlet": "2 bar", "outlet": "1 bar"}),
}


def study(D: float, m: int, seed: int, gas: str, sweep: dict[str, Any]) -> dict[str, Any]:
    """Return the study of one surface."""
    Sq, fluid = GASES[gas]
    return {
        "name": "gas",
        "surface": {"D": D, "m": m, "L": "100 um", "Sq": Sq, "seeds": [seed], "sides": "mirrored"},
        "material": {"E": "10 MPa", "nu": 0.5},
        "sweep": sweep,
        "fluid": fluid,
        "record": {
            "transport": {"transmissivity": "every-step", "gas_flow": "every-step"},
            "dimensional": {"pressure": "MPa", "gas_leak_rate": "mbar*l/s"},
        },
    }


def errors(gas: str, surfaces: int, folder: Path) -> list[tuple[float, float, float, float]]:
    """Return log(truth/card) of liquid and gas on every open way, and the ends of the card without the window."""
    found = []
    for D in DIMENSIONS:
        for seed in range(surfaces):
            fine = study(D, TRUTH, seed, gas, {"contact_areas": list(AREAS)})
            truth = roughvol.run(fine, out=folder / "truth", jobs=1, fresh=True).squeeze()
            for k in range(len(AREAS)):
                at = truth.isel(step=k)
                of_card = study(D, CARD, seed, gas, {"steps": 10, "to": "percolation"})
                load = f"pressure={float(at['nominal_pressure'])!r} MPa"
                card = roughvol.card(of_card, load, out=folder / "card", jobs=1, fresh=True).cards[""]
                (beside,) = card.beside
                for way, leak in zip(card.ways, beside.leaks, strict=True):
                    here = at.sel(axis=way.axis)
                    liquid = float(here["transmissivity"] * here["free_volume"] ** 3)
                    smaller, larger = together([part for part in way.parts if part.name != "window"])
                    if liquid > 0.0 and way.leak.value > 0.0 and math.isfinite(larger):
                        logs = math.log(liquid / way.leak.value), math.log(float(here["gas_leak_rate"]) / leak.value)
                        found.append((*logs, -math.log(smaller), math.log(larger)))
    return found


def main() -> None:
    """Print the share of ways whose interval holds, and how far the finer surface is from the card."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--surfaces", type=int, default=5)
    surfaces = parser.parse_args().surfaces
    for gas in GASES:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", RoughvolWarning)
            liquid, of_gas, low, high = np.transpose(errors(gas, surfaces, Path(folder)))
        held = [np.mean((low <= log) & (log <= high)) for log in (liquid, of_gas)]
        ratio = np.median(abs(of_gas)) / np.median(abs(liquid))
        print(
            f"{gas}: {len(liquid)} ways, the interval holds the liquid in {held[0]:.0%} and the gas in {held[1]:.0%}; "
            f"the logarithm of the gas differs {ratio:.2f} times as much in the median"
        )


if __name__ == "__main__":
    main()
