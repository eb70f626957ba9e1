"""Readers of height maps: one for each kind of content, all giving heights as float64, positive up.

`reading` chooses the reader. SurfaceTopography is asked first wherever it has one (`instrument`).
`description` is the common result, `text_map` and its helpers (`plain_text`, `text_header`, `points`) read text.
"""
