"""What is asked: one YAML file in, a frozen `Study` and its `Case` list out.

Room of the study. It loads without numpy. One `StudyError` has all problems of a file in its order, each with line,
key, given value and allowed values.

=============  ================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
