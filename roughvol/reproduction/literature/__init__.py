"""Numbers of the literature as rows of a table, judged as the claims of the paper are.

=================  ===================================================================
`random_surfaces`  area, closing, stiffness and mean gap of surfaces with a spectrum
`given_surfaces`   Westergaard's wave, two other codes, MIRCO, the Contact Challenge
`published`        the table `published.toml` of rows and criteria
=================  ===================================================================
"""

from roughvol.reproduction.literature import given_surfaces, random_surfaces
from roughvol.reproduction.literature.published import LITERATURE

__all__ = ["LITERATURE"]

MODULES = (random_surfaces, given_surfaces)  # their import registers the rows
