"""The error of a mean between few steps, on two levels: `python -m tests.bench.step_errors`."""

import numpy as np

from roughvol.campaign.one_case import Context, arrays_of_case
from roughvol.ensemble import targets
from roughvol.study import loads

STUDY = """
surface: {{D: {D}, m: {m}}}
sweep: {{steps: 60}}
ensemble: {{accuracy: {{free_volume: 1 %}}, at: {{pressure: [0.1, 0.3, 0.6]}}}}
"""
SEEDS, EVERY = 32, (12, 6, 4, 3, 2)


def main() -> None:
    """Print the mean error and its standard error, in per cent of V*, by the number of steps."""
    context = Context()
    for D in (2.2, 2.8):
        for m in (5, 6):
            study = loads(STUDY.format(D=D, m=m))
            cases = [study.sample(D, m, seed) for seed in range(SEEDS)]
            series = [targets.series_of(arrays_of_case(case, context)) for case in cases]
            for target in targets.targets_of(study.ensemble):
                of = [(one, target.stored, target.state, case) for one, case in zip(series, cases, strict=True)]
                mean = np.mean([targets.value_at(*each) for each in of]) / 100.0
                texts = []
                for every in EVERY:
                    errors = np.array([targets.error_at(*each, every) for each in of]) / mean
                    texts.append(f"{60 // every}: {errors.mean():+.3f} ± {errors.std(ddof=1) / SEEDS**0.5:.3f} %")
                print(f"D = {D}, m = {m}, {target.state.label}: {', '.join(texts)}", flush=True)


if __name__ == "__main__":
    main()
