"""What a figure shows, counted after it was drawn."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure


def shown(fig: Figure, *, layout: bool = True) -> int:
    """Draw a figure; return how many points of its curves, markers and pictures lie inside their axes.

    The layout takes most of the time, and is tested once for a figure.
    """
    if not layout:
        fig.set_layout_engine(None)
    fig.draw_without_rendering()
    return sum(_points(axes) for axes in fig.axes)


def labels_are_apart(fig: Figure, axis: Axis | None = None) -> bool:
    """Draw a figure; return whether an axis, x if none is given, has several numbers and none overlaps the next."""
    fig.draw_without_rendering()
    axis = axis or fig.axes[0].xaxis
    shown = [text for text in axis.get_ticklabels(which="both") if text.get_text() and text.get_visible()]
    low, high = axis.get_view_interval()
    boxes = sorted((t.get_window_extent() for t in shown if low <= t.get_position()[0] <= high), key=lambda box: box.x0)
    return len(boxes) > 1 and all(box.x1 < after.x0 for box, after in itertools.pairwise(boxes))


def _points(axes: Axes) -> int:
    count = 0
    for line in axes.lines:
        if line.get_transform() == axes.transData:
            count += _inside(axes, np.column_stack([np.asarray(data, dtype=float) for data in line.get_data()]))
    for collection in axes.collections:
        mesh = collection.get_array()
        if mesh is not None and np.size(mesh):
            count += np.ma.count(np.ma.masked_invalid(mesh))
        elif isinstance(collection, PathCollection):  # its paths are the shapes of the markers
            count += _inside(axes, np.ma.filled(collection.get_offsets(), np.nan))
        else:
            count += sum(_inside(axes, path.vertices) for path in collection.get_paths())
    count += sum(_inside(axes, patch.get_path().vertices) for patch in axes.patches)
    return count + sum(np.ma.count(np.ma.masked_invalid(image.get_array())) for image in axes.images)


def _inside(axes: Axes, points: np.ndarray) -> int:
    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    x, y = points[:, 0], points[:, 1]
    return int(np.count_nonzero((left <= x) & (x <= right) & (low <= y) & (y <= high)))
