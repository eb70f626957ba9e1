"""What commands take on a run of many small cases: processor time, time by the clock, and memory (store-decision.md).

    python -m tests.bench.scale                 # 10⁴ cases of m = 3 with 4 steps
    python -m tests.bench.scale --transport     # the same with a flow along both axes of every state
    python -m tests.bench.scale --cluster       # on four workers of Dask, one is killed, and here: the same bits?

All cases are computed. Every command is a process of its own, with its start.
"""

import argparse
import contextlib
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

STUDY = "name: scale\nsurface: {{D: [2.2, 2.4, 2.6, 2.8], m: 3, seeds: {seeds}}}\nsweep: {{steps: 4}}\n"
TRANSPORT = "record: {transport: {transmissivity: every-step}}\n"
RUN = ("-m", "roughvol", "run", "scale.yaml", "--jobs", "1")
STATUS = ("-m", "roughvol", "status", "scale")
LS = ("-m", "roughvol", "ls")
COLLECT = ("-c", "from roughvol.campaign import collect; collect('scale.yaml')")
COMMANDS = {
    "`roughvol run`, all computed": RUN,
    "`roughvol status scale`": STATUS,
    "`roughvol ls`": LS,
    "`campaign.collect`": COLLECT,
    "`roughvol run`, all finished": RUN,
    "`roughvol show scale`": ("-m", "roughvol", "show", "scale"),
    "`roughvol report scale`": ("-m", "roughvol", "report", "scale"),
}


def bits_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Return dimensions, type and bytes of all numbers of the finished cases by file, without times."""
    from roughvol.store import dataset
    from tests.campaign.kit import TIMES

    return {
        path.name: {
            name: (
                dims,
                values.dtype.str,
                values.shape,
                values.tobytes() if values.dtype != object else values.tolist(),
            )
            for name, (dims, values) in dataset.read_arrays(path)[0].items()
            if name not in TIMES
        }
        for path in (folder / "cases").glob("*.nc")
    }


def measured(command: tuple[str, ...], folder: Path) -> tuple[float, float, float]:
    """Return processor time [s], time by the clock [s] and the largest memory [bytes] of a command."""
    began = time.perf_counter()
    place = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(Path.cwd())}
    with (folder.parent / "output.txt").open("wb") as output:
        to = [(os.POSIX_SPAWN_DUP2, output.fileno(), 1), (os.POSIX_SPAWN_DUP2, output.fileno(), 2)]
        call = ["/bin/sh", "-c", 'cd "$0" && exec "$@"', str(folder), sys.executable, *command]
        _, state, used = os.wait4(os.posix_spawn(call[0], call, place, file_actions=to), 0)
    if state:
        raise SystemExit(f"{command} failed: {(folder.parent / 'output.txt').read_text()[-2000:]}")
    return used.ru_utime + used.ru_stime, time.perf_counter() - began, 1024.0 * used.ru_maxrss


def killed_worker(text: str, folder: Path) -> str:
    """Return what a run on four workers has stored, one of which is killed after a quarter of the cases."""
    # Not above: the memory of a child counts that of the process that starts it.
    from roughvol.campaign import execution
    from roughvol.study import loads
    from tests.campaign.kit import Dask

    study = loads(text)
    (folder / "dask").mkdir()
    dask = Dask(folder / "dask")
    four = [dask.worker("--no-nanny") for _ in range(4)]

    def kill(now: Any) -> None:
        if 4 * now.done >= now.cases and four[0].poll() is None and len(dask.names()) == 4:
            four[0].kill()
            four[0].wait()

    with contextlib.closing(dask):
        execution.run(study, out=folder / "there", scheduler=dask.address, on_event=kill)
        ends = [worker.poll() for worker in four]
    execution.run(study, out=folder / "here", jobs=1)
    there, here = bits_of(folder / "there"), bits_of(folder / "here")
    return (
        f"workers ended by {ends}; {sum(there[file] == here[file] for file in here)} of {len(here)} cases of equal bits"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000, help="a multiple of 4")
    parser.add_argument("--transport", action="store_true", help="with the flow through every state")
    parser.add_argument("--cluster", action="store_true", help="on a cluster with a killed worker, and here")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=".") as name:
        folder = Path(name) / "work"
        folder.mkdir()
        text = STUDY.format(seeds=given.cases // 4) + TRANSPORT * given.transport
        (folder / "scale.yaml").write_text(text, encoding="utf-8")
        if given.cluster:
            print(killed_worker(text, folder))
            return
        print(f"| {given.cases} cases | processor | by the clock | memory |\n|---|---|---|---|")
        for words, command in COMMANDS.items():
            processor, clock, memory = measured(command, folder)
            print(f"| {words} | {processor:.1f} s | {clock:.1f} s | {memory / 1e6:.0f} MB |", flush=True)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        print(f"| files | {size / 1e9:.3f} GB | | |")


if __name__ == "__main__":
    main()
