"""What a case costs on disk in other layouts (store-decision.md): `python -m tests.bench.store`.

One case of m = 3 with 4 steps is computed. The others are copies of it with their own D, seed and stamp. Times are
medians over the cases. They depend on the disk.
"""

import argparse
import hashlib
import json
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import netCDF4
import numpy as np
from xarray import Dataset
from xarray.backends import NetCDF4DataStore

from roughvol.campaign import one_case
from roughvol.store import dataset, stamped_file
from roughvol.study import Study, loads

STUDY = "name: scale\nsurface: {{D: [2.2, 2.4, 2.6, 2.8], m: 3, seeds: {seeds}}}\nsweep: {{steps: 4}}\n"
Row = dict[str, float]


def parts(study: Study) -> Iterator[Dataset]:
    """Yield the datasets of all cases of a study: the first one under their names."""
    cases = study.cases()
    one = one_case.run_case(cases[0])
    for case in cases:
        part = one.assign_coords(D=[case.D], seed=[case.seed])
        part.attrs = one.attrs | {"case_id": case.id, "case": json.dumps(case.key, sort_keys=True)}
        yield part


def milliseconds(action: Callable[[int], object], count: int) -> float:
    """Return the median time of an action by the clock [ms]: other work on the machine lengthens a few."""
    times = []
    for k in range(count):
        began = time.perf_counter()
        action(k)
        times.append(time.perf_counter() - began)
    return 1e3 * float(np.median(times))


def as_netcdf4(part: Dataset) -> bytes:
    """Return a case as stamped netCDF-4."""
    store = netCDF4.Dataset("memory.nc", "w", format="NETCDF4", memory=4096)
    part.dump_to_store(NetCDF4DataStore(store), encoding=dataset._encoding(part))
    return stamped_file.stamped(bytes(store.close()), stamped_file.labels_of(part.attrs))


def files(folder: Path, cases: Sequence[Dataset], make: Callable[[Dataset], bytes]) -> Row:
    """Return bytes and times of a file for each case."""
    folder.mkdir()
    paths = [folder / f"{part.attrs['case_id']}.nc" for part in cases]
    contents: dict[int, bytes] = {}
    return {
        "make": milliseconds(lambda k: contents.update({k: make(cases[k])}), len(cases)),
        "write, sync": milliseconds(lambda k: stamped_file.store(paths[k], contents[k]), len(cases)),
        "read, verify": milliseconds(lambda k: dataset.read_arrays(paths[k]), len(cases)),
        "stamp": milliseconds(lambda k: stamped_file.labels(paths[k]), len(cases)),
        "bytes": len(contents[0]),
    }


def database(path: Path, cases: Sequence[Dataset], journal: str) -> Row:
    """Return bytes and times of a row for each case in SQLite: labels, checksum, arrays as one blob."""
    store = sqlite3.connect(path)
    store.execute(f"pragma journal_mode={journal}")
    store.execute("pragma synchronous=full")
    store.execute("create table cases(id text primary key, labels text, digest text, head text, body blob)")
    ids = [part.attrs["case_id"] for part in cases]

    def write(k: int) -> None:
        labels = json.dumps(stamped_file.labels_of(cases[k].attrs))
        head, body = packed(cases[k])
        with store:
            digest = hashlib.sha256(body).hexdigest()
            store.execute("insert into cases values(?,?,?,?,?)", (ids[k], labels, digest, head, body))

    def read(k: int) -> list[np.ndarray]:
        digest, head, body = store.execute("select digest, head, body from cases where id=?", (ids[k],)).fetchone()
        assert hashlib.sha256(body).hexdigest() == digest
        return unpacked(head, body)

    def stamp(k: int) -> dict[str, str]:
        return json.loads(store.execute("select labels from cases where id=?", (ids[k],)).fetchone()[0])

    row = {
        "make": np.nan,
        "write, sync": milliseconds(write, len(cases)),
        "read, verify": milliseconds(read, len(cases)),
        "stamp": milliseconds(stamp, len(cases)),
    }
    store.close()
    return row | {"bytes": path.stat().st_size / len(cases)}


def packed(part: Dataset) -> tuple[str, bytes]:
    """Return the variables of a case as a description and bytes."""
    arrays = {name: np.ascontiguousarray(values) for name, (_, values) in dataset.arrays_of(part).items()}
    arrays = {name: values.astype("S") if values.dtype.kind in "OU" else values for name, values in arrays.items()}
    head = json.dumps([(name, values.dtype.str, values.shape) for name, values in arrays.items()])
    return head, b"".join(values.tobytes() for values in arrays.values())


def unpacked(head: str, body: bytes) -> list[np.ndarray]:
    """Return the arrays of `packed`."""
    arrays, start = [], 0
    for _, dtype, shape in json.loads(head):
        count = int(np.prod(shape))
        arrays.append(np.frombuffer(body, dtype, count, start).reshape(shape))
        start += arrays[-1].nbytes
    return arrays


def layouts(count: int) -> None:
    """Print the table of layouts."""
    cases = list(parts(loads(STUDY.format(seeds=count // 4))))
    with tempfile.TemporaryDirectory(dir=".") as name:
        folder = Path(name)
        rows = {
            "netCDF-4": files(folder / "netcdf4", cases, as_netcdf4),
            "now: netCDF-3 (64-bit offset), read by scipy": files(folder / "netcdf3", cases, dataset.to_bytes),
            "SQLite, rollback journal": database(folder / "delete.db", cases, "delete"),
            "SQLite, WAL": database(folder / "wal.db", cases, "wal"),
        }
    print("| layout | bytes | make | write, sync | read, verify | read the stamp |")
    print("|---" * 6 + "|")
    for layout, row in rows.items():
        made = "-" if np.isnan(row["make"]) else f"{row['make']:.2g} ms"
        times = " | ".join(f"{row[step]:.2g} ms" for step in ("write, sync", "read, verify", "stamp"))
        print(f"| {layout} | {round(row['bytes'], -2):.0f} | {made} | {times} |")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500, help="a multiple of 4")
    layouts(parser.parse_args().cases)


if __name__ == "__main__":
    main()
