"""What is asked: one YAML file in, a frozen `Study` and its `Case` list out.

Room of the study. It loads without numpy. Whatever is wrong with a file is reported together, in the order of the file,
as a `StudyError` whose problems carry the line, the key, the value given and what is allowed.

=============  =====================================================================
`reading`      from a file to a `Study`, or to everything wrong with it
`yaml_text`    YAML to plain data and the place of every key
`sections`     the sections of a study as strict, frozen records
`height_file`  the section ``surface`` of measured heights
`treatment`    the treatment of measured heights
`material`     the section ``material``
`record`       the section ``record``
`ensemble`     the section ``ensemble``
`agreement`    sizes and units of the study and of its files, compared
`cases`        the study as a whole, and its cases
`units`        numbers with a unit
=============  =====================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
