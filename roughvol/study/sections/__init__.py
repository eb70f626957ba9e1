"""The sections of a study file, one module each: strict, frozen records.

The description of a key has its allowed values. The JSON schema, `roughvol explain` and messages show it.
"""
