"""What is pressed: a field of heights, made or measured.

Room of the surfaces. It knows no study, no solver and no results.

=================  =================================================================
`surface`          the record of a surface: heights, spacing, Sq
`midpoint`         fractal surfaces by random midpoint displacement
`spectrum`         the power-law spectrum of a surface as a record: roll-off, cut-off, moments
`waves`            random surfaces of this spectrum, drawn wave by wave
`measured`         surfaces from files: read, treated, two bodies added
`body`             one measured body and its treatment, as records
`files`            readers of height maps, one for each kind of content
`treatment`        outliers, block means, square pixels, planes taken off, holes filled, short waves filtered
`texture`          ISO 25178-2 numbers, summits, Hurst exponents
`psd`              power spectral density, Nayak's parameter
`length_units`     units of length and their factors
=================  =================================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
