"""Files on disk: labelled datasets, the files of cases, and the folder of a run.

Room of the store. It computes nothing.

=====================  =============================================================
`variants`             combinations of lists joined, and taken apart
`tradeoff_variables`   the table of a stored trade-off
`record_key`           the key of a study file that stores a variable
`provenance`           attributes of stored files
`dataset`              build, write, read and combine datasets
`small_file`           the file of a small case, written quickly
`card_runs`            the runs behind a leak card
`dimensional`          starred numbers in the units of the study
`run`                  the run of a name, path or study file, checked to be of its study
`run_folder`           the files of a run: names, labels, failures
`lock`                 one process at a time in a folder
`same_study`           whether a folder holds the results of a study
`run_status`           finished, missing, failed and damaged cases; all runs of a folder: size, state, age
`licences`             licences of the installed packages, and of libraries that their wheels bundle
`sample_plan`          planned samples of an ensemble
`checkpoint`           the finished steps of a long sweep
`stamped_file`         files that are whole or absent, with a checksum
=====================  =============================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
