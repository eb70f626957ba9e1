"""What is asked: one YAML file in, a frozen `Study` and its `Case` list out.

Room of the study. It loads without numpy. One `StudyError` has all problems of a file in its order, each with line,
key, given value and allowed values.

=============  =====================================================================
`reading`      from a file to a `Study`, or to all its problems
`yaml_text`    YAML to plain data, and the place of every key
`plain_data`   objects of Python as plain data
`sections`     the sections of a study as strict, frozen records
`height_file`  the section ``surface`` of measured heights
`spectral`     the section ``surface`` of surfaces with a spectrum
`sweep`        the section ``sweep``
`targets`      lists of states of a sweep
`treatment`    the treatment of measured heights
`material`     the section ``material``
`fluid`        the section ``fluid``: a gas and its pressures
`creep`        a creep law, and times of a command line
`selected`     states that a study selects
`record`       the section ``record``
`dimensional`  what ``record`` has with units
`ensemble`     the section ``ensemble``
`agreement`    sizes and units of a study compared with its files
`conflicts`    rules across the sections
`one_case`     one case: all that determines its stored answer
`cases`        the study as a whole, and its cases
`axes`         lists in keys that take one value
`reference`    the keys in words
`units`        numbers with a unit
`scale`        loads and lengths with units as starred numbers
=============  =====================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
