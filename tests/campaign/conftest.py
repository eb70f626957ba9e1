"""A Dask cluster in this process for one file of tests.

The heartbeat of the cluster draws from the module `random`, and hypothesis refuses draws from elsewhere.
"""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Return the address of a scheduler with two workers, threads of this process."""
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "protocol": "tcp"}
    with distributed.LocalCluster(processes=False, **options) as local:
        yield local.scheduler_address
