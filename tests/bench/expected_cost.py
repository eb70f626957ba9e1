"""What `roughvol check` expects of an ensemble, beside its run: `python -m tests.bench.expected_cost`."""

import sys
import tempfile
import time

from roughvol.campaign import execution, rounds
from roughvol.study import loads

STUDIES = {
    "V*": "surface: {D: [2.2, 2.5], m: 8}\nensemble: {accuracy: {free_volume: 1 %}, at: {pressure: 0.3}}",
    "A*": "surface: {D: [2.2, 2.5], m: 8}\nensemble: {accuracy: {contact_area: 3 %}, at: {pressure: 0.3}}",
    "leak": "surface: {D: [2.2, 2.5], m: 6}\nensemble: {accuracy: {log_leak_rate: 0.05}, at: {pressure: 0.5}}\n"
    "record: {transport: {transmissivity: every-step}}",
    "closing": "surface: {D: [2.2, 2.5], m: 6}\nsweep: {to: percolation}\n"
    "ensemble: {accuracy: {percolation_pressure: 4 %}}",
}


def main() -> None:
    """Print the expected and the computed samples and costs of each study, or of those named."""
    for name in sys.argv[1:] or STUDIES:
        study, started = loads(STUDIES[name]), time.process_time()
        rows = rounds.expected(study)
        print(f"{name}: expected in {time.process_time() - started:.1f} s", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            results = execution.run(study, out=folder, jobs=1)
        for row in rows:
            one = results.sel(D=row.D)
            print(f"  D = {row.D}: {row.seconds:.2f} s {row.samples}, plain {row.plain:.1f} s")
            print(
                f"  run:     {float(one.ensemble_cost):.2f} s, plain {float(one.ensemble_plain_cost):.1f} s", flush=True
            )


if __name__ == "__main__":
    main()
