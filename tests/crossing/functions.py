"""A quantity of a user, as ``record.own`` of a kind of run names it."""

import numpy as np


def rms_gap(state):
    """Root mean square gap over Sq"""
    return np.sqrt(np.mean(state.gap**2))
