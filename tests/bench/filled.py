"""The leak of maps with filled heights over that of the whole maps: `python -m tests.bench.filled`."""

import numpy as np
import scipy.ndimage

import roughvol
from roughvol.campaign.case_surface import surface_of
from roughvol.study import loads

STUDY = "surface: {H: 0.8, n: 128, rolloff: 4, cut: 32, L: 128 um, Sq: 1 um, seeds: 6, sides: periodic}"
SHARES, WIDTH = (0.02, 0.05, 0.1, 0.2, 0.4), 4  # nodes: of a patch of missing heights
PRESSED = {
    "L": "127 um",
    "E": "10 MPa",
    "nu": 0.5,
    "steps": 12,
    "to": {"pressure": "0.2 MPa"},
    "record": {
        "transport": {"transmissivity": "every-step"},
        "dimensional": {"leak_rate": {"pressure_drop": "1 mbar", "viscosity": "1 mPa*s"}},
    },
}


def leak(heights: np.ndarray) -> np.ndarray:
    """Return the leak along x and y at 0.1 MPa; missing heights are interpolated."""
    run = roughvol.press(heights, surface={"missing": "interpolate"}, **PRESSED)
    return run.roughvol.at(pressure="0.1 MPa").leak_rate.values.ravel()


def main() -> None:
    """Print the median and the 90 % quantile of the factor between leaks, for nodes and patches that are missing."""
    maps = [surface_of(case).heights for case in loads(STUDY).cases()]
    whole, random = [leak(heights) for heights in maps], np.random.default_rng(1)
    for width, place in ((0, "single nodes"), (WIDTH, "patches")):
        for share in SHARES:
            factors = []
            for heights, all_known in zip(maps, whole, strict=True):
                noise = scipy.ndimage.gaussian_filter(random.normal(size=heights.shape), width)
                missing = noise < np.quantile(noise, share)
                factors += [*np.abs(np.log(leak(np.where(missing, np.nan, heights)) / all_known))]
            median, most = np.exp(np.quantile(factors, [0.5, 0.9]))
            print(f"{share:.0%} missing, {place}: factor {median:.3f} in the median, 90 % up to {most:.3f}", flush=True)


if __name__ == "__main__":
    main()
