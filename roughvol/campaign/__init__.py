"""Who computes, and when: the cases of a study in many processes, resumable.

Room of the campaign.

==============  ====================================================================
`python`        `run` and `press`, as called from Python
`running`       run a study: all its missing cases
`collected`     finished cases as one dataset
`rounds`        rounds of an ensemble in its folder
`trials`        surfaces of an ensemble that are not stored
`sorting`       stored cases sorted out before a run
`shared_cases`  cases that other runs under one root have finished
`checks`        a study checked before anything is computed
`one_case`      one case: surface, sweep, reduction
`path`          indentations of the legs of a sweep
`batch`         cases handed to workers and stored as they end
`workers`       tasks handed to processes of this machine or to a cluster
`cluster`       workers of a Dask cluster
`signals`       signals that end a run
`task`          a task inside its worker: messages, and the request to end
`resources`     cores, memory and disk
`limits`        the limit of a process on its own memory
`cost`          cases, memory, disk and time of a study, estimated
`forecast`      time left of a run
`notebook`      progress of a run in a notebook
`understood`    how a study was understood, in words
`doubts`        numbers of a study that may be meant in another way
`validity`      where a study leaves the model
`card`          runs behind a leak card
`tradeoff`      speed against accuracy, measured
==============  ====================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
