"""Readers of height maps: one for each kind of content. Heights are float64, positive up.

A reader is a function ``opened`` of a `Request` that returns a `HeightMap` (`description`). `reading` chooses it.
`instrument` reads through SurfaceTopography. `netcdf`, `surfer` and `tiff` read these formats. `text_map` reads text,
from the lines and cells of `plain_text`. `memory` writes heights in memory to a file.
"""
