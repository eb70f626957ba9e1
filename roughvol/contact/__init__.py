"""Contact of a rigid rough surface with an elastic half space, at imposed indentation.

The room of the solver. It knows surfaces and arrays, no study and no results.

====================  ==============================================================
`loading`             one state, or a sweep over many
`options`             accuracy, method and hardness of a solve; all constants
`bracket`             target of a search, and the solved states around it
`search`              state at which a quantity reaches a value
`response`            linear response of a solved state
`active_set`          loop: free elements, residual, direction, exact step
`law`                 pressures allowed: rigid wall, wall with a hardness
`problem`             scaled problem: convolution, verification, record
`state`               solved state
`preconditioner`      approximate inverse on the candidates
`near_field`          sparse part of the inverse
`far_field`           correction of the inverse by blocks of elements
`halfspace`           displacement under pressure, on a free patch or a period
`convolution`         one convolution, by FFTW or as a sum over few loaded elements
`cosines`             convolution of a mirrored patch, by cosine transforms
`fftw`                the library pyfftw, imported without dask
`kernels`             influence coefficients, and displacement of waves
`paper_algorithm`     the paper's Algorithm 1, as a reference
====================  ==============================================================
"""

from roughvol.spellings import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
