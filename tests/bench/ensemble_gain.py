"""What an ensemble costs beside plain Monte Carlo at the same interval: processor time, in one run.

    python -m tests.bench.ensemble_gain --m 9 --D 2.2 --quantity free_volume --accuracy "1 %" --pressure 0.3

Every sample counts with its file, which is stored and read as by a campaign. Plain Monte Carlo takes n = s² (1.96/h)²
sweeps of the finest level. The time of one is measured here, h is the half-width that the ensemble has reached, and s²
the variance of the finest level as the samples of all levels give it.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from roughvol.campaign.one_case import Context, HalfSpaces, file_of_case
from roughvol.ensemble.allocation import plain_cost
from roughvol.store import dataset, stamped_file
from roughvol.store.dataset import Arrays
from roughvol.study import Case, loads
from tests.ensemble.kit import driven

STUDY = """
surface: {{D: {D}, m: {m}}}
sweep: {{steps: 30}}
ensemble: {{accuracy: {{{quantity}: {accuracy}}}, at: {{pressure: [{pressure}]}}}}
"""


def measure(folder: Path, m: int, D: float, quantity: str, accuracy: str, pressure: str) -> dict[str, object]:
    """Return the processor time of an ensemble, and that of plain Monte Carlo for its interval."""
    study = loads(STUDY.format(m=m, D=D, quantity=quantity, accuracy=accuracy, pressure=pressure))
    text, held = study.stored(), {}
    seconds: Counter[int] = Counter()
    samples: Counter[int] = Counter()

    def compute(cases: Sequence[Case]) -> Mapping[str, Arrays]:
        found = {}
        for case in sorted(cases, key=lambda case: case.m or 0):
            assert case.m is not None
            own: HalfSpaces = held.setdefault(case.m, {})
            path = folder / f"{case.id}.nc"
            began = time.process_time()
            stamped_file.store(path, file_of_case(case, Context(own, study=text)))
            found[case.id], *_ = dataset.read_arrays(path)
            seconds[case.m] += time.process_time() - began
            samples[case.m] += 1
            path.unlink()
        return found

    began = time.process_time()
    answer = driven(study, compute)
    spent = time.process_time() - began
    targets = []
    for one in answer.estimates[D]:
        plain = plain_cost(one.level_variances[-1], seconds[m] / samples[m], one.mean.half_width)
        targets.append(
            {
                "at": one.target.state.label,
                "mean": one.mean.value,
                "half-width in %": 100.0 * one.mean.half_width / one.mean.value,
                "plain sweeps": round(plain / seconds[m] * samples[m]),
                "plain seconds": round(plain, 1),
                "gain": round(plain / spent, 1),
            }
        )
    return {
        "m": m,
        "D": D,
        "quantity": quantity,
        "samples": dict(sorted(samples.items())),
        "ms a sample": {level: round(1e3 * seconds[level] / samples[level], 1) for level in sorted(samples)},
        "modelled ms": [round(1e3 * cost, 1) for cost in answer.estimates[D][0].costs],
        "surfaces alone": len(answer.table.surfaces[D]),
        "rounds": len(answer.rounds[D]),
        "seconds": round(spent, 1),
        "targets": targets,
    }


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--m", type=int, default=9)
    parser.add_argument("--D", type=float, default=2.2)
    parser.add_argument("--quantity", default="free_volume")
    parser.add_argument("--accuracy", default="1 %")
    parser.add_argument("--pressure", default="0.3")
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(Path(folder), **vars(parser.parse_args()))))


if __name__ == "__main__":
    main()
