"""Readers of height maps: one for each kind of content. Heights are float64, positive up.

A reader is a function ``opened`` of a `Request` that returns a `HeightMap` (`description`). `reading` chooses it.
"""
