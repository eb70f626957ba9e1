"""Readers of height maps: one for each kind of content. Heights are float64, positive up.

`reading` chooses the reader, and `description` is the common result. `instrument` reads through SurfaceTopography.
`netcdf`, `surfer` and `tiff` read these formats. `text_map` and its helpers (`plain_text`, `text_header`, `points`)
read text. `memory` writes heights in memory to a file.
"""
