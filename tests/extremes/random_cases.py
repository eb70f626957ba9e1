"""Random cases: sides, surface, kernel, layer, hardness, tolerance, and ends of a path, all drawn from one number.

`random_case` draws a study and its heights, `run` computes them as `roughvol run` does. A case fails by any error, a
residual above its tolerance, or a leg that ends elsewhere than the study says.
"""

import json
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.campaign.one_case import run_case
from roughvol.study import loads
from roughvol.study.values.state_kinds import stored_name

SMALLEST, LARGEST = 9, 330  # elements a side


@dataclass(frozen=True)
class RandomCase:
    """A study and the heights that it names."""

    number: int
    heights: np.ndarray
    study: dict[str, Any]

    def __str__(self) -> str:
        """Return the case in one line."""
        return f"case {self.number}, {self.heights.shape[0]} × {self.heights.shape[1]}: {json.dumps(self.study)}"


def random_case(number: int) -> RandomCase:
    """Return the case of a number."""
    generator = np.random.Generator(np.random.PCG64([29, number]))
    share = generator.random(2)
    # most grids are small, for time; nearly a third are not
    sides = SMALLEST + (LARGEST - SMALLEST) * share
    if generator.random() < 0.7:
        sides = SMALLEST * (LARGEST / SMALLEST) ** share
    rows, columns = (round(side) for side in sides)
    heights = random_heights((rows, rows if generator.random() < 0.5 else columns), generator)
    end = str(generator.choice(["free", "mirrored", "periodic"]))
    kernel = str(generator.choice(["love", "love", "punch"] if end == "free" else ["love", "love", "punch", "fourier"]))
    limit = float(10.0 ** generator.uniform(-0.5, 2.0)) if generator.random() < 0.35 else math.inf
    layered = end != "free" and kernel != "punch" and generator.random() < 0.4
    body = _layer(generator, rows) if layered else {"E_star": 1.0}
    study = {
        "surface": {"file": "heights.npy", "L": 1.0, "sides": end},
        "material": body | ({"hardness": limit * float(heights.std())} if limit < math.inf else {}),
        "sweep": _path(generator, float(heights.max()), limit),
        "solver": {"rtol": float(10.0 ** generator.uniform(-8.0, -3.0)), "kernel": kernel},
    }
    return RandomCase(number, heights, study)


def random_heights(shape: tuple[int, int], generator: np.random.Generator) -> np.ndarray:
    """Return self-affine heights, a crop of some (which do not join at the sides), white noise, or terraces."""
    kind = generator.choice(["self-affine", "self-affine", "cropped", "noise", "terraces"])
    grid = tuple(2 * nodes for nodes in shape) if kind == "cropped" else shape
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(nodes) for nodes in grid), indexing="ij"))
    frequency[0, 0] = np.inf
    power = 0.0 if kind == "noise" else 1.0 + generator.uniform(0.1, 0.95)
    amplitude = np.maximum(frequency, generator.choice([1.0, 2.0, 4.0, 8.0]) / max(grid)) ** -power
    amplitude[frequency > max(generator.choice([0.1, 0.25, 1.0, 1.0]), 1.5 / min(grid))] = 0.0
    heights = np.fft.ifft2(np.fft.fft2(generator.standard_normal(grid)) * amplitude).real[: shape[0], : shape[1]]
    heights = (heights - heights.mean()) / heights.std()
    return np.round(heights, 1) if kind == "terraces" else heights


def _layer(generator: np.random.Generator, rows: int) -> dict[str, float]:
    """Return the material of a layer with E* = 1, one element to twice the period thick."""
    nu = float(generator.choice([0.0, 0.3, 0.49, 0.5]))
    return {"E": 1.0 - nu**2, "nu": nu, "thickness": float(rows ** -generator.uniform(-0.3, 1.0))}


def _path(generator: np.random.Generator, highest: float, limit: float) -> list[dict[str, Any]]:
    """Return the section `sweep`: up, or where the surface yields also up, down and up again."""
    kind = str(generator.choice(["contact_area", "pressure", "pressure", "free_volume", "separation"]))
    again = limit < math.inf and generator.random() < 0.5
    pressure = min(10.0 ** generator.uniform(-2.0, 0.7), 0.5 * limit)
    value = {
        "contact_area": generator.uniform(0.02, 0.9),
        "pressure": pressure,
        "free_volume": generator.uniform(0.1, 0.8) * highest,
        "separation": generator.uniform(0.1, 0.8) * highest,
    }[kind]
    up = {"steps": int(generator.integers(1, 4)), "to": {kind: value}}
    if not again:
        return [up]
    to, back = {"pressure": pressure}, {"pressure": float(generator.choice([0.0, 0.5])) * pressure}
    return [up | {"to": to}, {"steps": 2, "to": back}, {"steps": 2, "to": to}]


def run(case: RandomCase) -> tuple[int, float]:
    """Return the number of states and the largest residual η/σ, after checking every leg."""
    rtol, legs = case.study["solver"]["rtol"], case.study["sweep"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "heights.npy"
        np.save(file, case.heights)
        surface = case.study["surface"] | {"file": str(file)}
        states = run_case(loads(json.dumps(case.study | {"surface": surface})).cases()[0])
    assert states["converged"].values.all(), "a state has not converged"
    residual = float(states["residual"].max())
    assert residual <= rtol * len(legs), f"the residual is {residual:g}"  # a leg carries those of the legs before
    step = -1
    for leg in legs:
        step += leg["steps"]
        ((kind, value),) = leg["to"].items()
        found = float(states[stored_name(kind)].values.ravel()[step])
        # Δ is right to 1e-6 and to the residuals of two states; nothing but an area changes faster than Δ
        slack = 1e-5 * float(np.abs(case.heights).max() + value) + 8.0 * len(legs) * rtol
        short = value - found if kind == "contact_area" else abs(value - found)
        assert short <= slack, f"leg ends at {kind} {found:.9g}, not {value:.9g}"
    return int(states.sizes["step"]), residual
