"""How a state of contact is solved: a rigid rough surface on an elastic half space, at imposed indentation.

Room of the solver. It knows surfaces and arrays, no study and no results.

====================  ==============================================================
`loading`             solve one state, or sweep over many
`search`              the indentation at which a quantity reaches a value
`active_set`          the loop: free elements, residual, direction, exact step
`problem`             the scaled problem: convolution, verification, record
`state`               a solved state
`preconditioner`      an approximate inverse on the candidates
`near_field`          its sparse part
`far_field`           its correction by blocks of elements
`halfspace`           displacement under pressure, by FFT
`convolution`         one circulant convolution by FFTW
`kernels`             influence coefficients
`few_loads`           displacement by few loaded elements, as a sum
`tuning`              the constants of the solver
`paper_algorithm`     the paper's Algorithm 1, as a reference
`closed_forms`        indenters and loaded rectangles, as references
====================  ==============================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
