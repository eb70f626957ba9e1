"""Who computes, and when: the cases of a study in many processes, resumable.

Room of the campaign.

================  ============================================================================
`python`          `run` and `press`, as called from Python
`execution`       run a study: all its missing cases; collect the finished ones
`inventory`       stored cases of a folder sorted out before a run, and cases of other runs
`batch`           cases handed to workers and stored as they end, with progress and time left
`rounds`          rounds of an ensemble in its folder
`collection`      finished cases as one dataset
`checks`          height files, units and regions of a study checked before a run
`interpretation`  a study in words, and numbers that may be meant in another way
`validity`        limits of the model that a study exceeds, rows of validity.toml
`cost`            memory, disk and time of a study, estimated
`one_case`        one case: surface, sweep, reduction
`case_surface`    surface of a case, generated or read, and its kernel
`path`            indentations of the legs of a sweep
`workers`         tasks handed to processes of this machine or to a cluster
`cluster`         workers of a Dask cluster
`signals`         signals that end a run
`machine`         cores, memory and disk of this machine
`notebook`        progress of a run in a notebook
`card`            runs behind a leak card
`tradeoff`        speed against accuracy, measured
================  ============================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
