"""What is asked: one YAML file in, a frozen `Study` and its `Case` list out.

Room of the study. Its import alone loads no numpy. One `StudyError` has all problems of a file in its order, each with
line, key, given value and allowed values.

=============  =======================================================================
`reading`      from a file to a `Study`, or to all its problems
`plain_data`   YAML as plain data, and the place of every key
`python_data`  objects of Python as plain data
`file`         the keys of a study file
`study`        the study as a whole, and its cases
`case`         one case: all that determines its stored answer
`former`       former keys, taken with a warning or refused with the new key
`sections`     the sections of a study file, one module each
`values`       numbers with units, states of a sweep, words in place of values
`rules`        rules across the sections
`validation`   faults of sections and broken rules, all together, in plain words
`axes`         lists in keys that take one value
`reference`    the keys in words
=============  =======================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
