"""The curves of a figure as text, for a script that draws them again to zoom into."""

import json

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

MOST_POINTS = 6_000  # of a curve; a screen has fewer


def figure_curves(drawn):
    """Return the curves of a figure of lines as text for the script of the page.

    Parameters
    ----------
    drawn : matplotlib.figure.Figure
        Figure whose axes hold lines, points, bands and histograms against one
        abscissa. A histogram behind an axes, on one of its own, is scaled into it.

    Returns
    -------
    text : str
        JSON without any character that HTML would take for its own. A long curve
        keeps the extremes of short stretches, which look the same.
    """
    behind = [
        axes for axes in drawn.axes if not axes.get_lines() and len(_at_place(axes)) > 1
    ]
    panels = [_panel(axes, behind) for axes in drawn.axes if axes not in behind]
    text = json.dumps(panels, allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _at_place(axes):
    """Return the axes that lie where one lies, itself among them."""
    spec = axes.get_subplotspec()
    return [z for z in axes.figure.axes if z.get_subplotspec() == spec]


def _panel(axes, behind):
    """Return what the script draws of one axes, and of those behind it."""
    logs = [axis.get_scale() == "log" for axis in (axes.xaxis, axes.yaxis)]
    lines = [line for line in axes.get_lines() if len(line.get_xdata()) > 1]
    ends = [z for line in lines if _is_data(axes, line) for z in line.get_xdata()]
    series = [
        {
            "kind": "band",
            "name": _name(band),
            "color": to_hex(tuple(np.ravel(band.get_facecolor())[:3])),
            **_band(*map(_scaled, np.transpose(path.vertices), logs)),
        }
        for band in axes.collections
        if isinstance(band, PolyCollection)
        for path in band.get_paths()
    ]
    series += [_histogram(bars, _name(bars[0])) for bars in axes.containers]
    series += [_level_band(patch, ends, logs) for patch in _spans(axes) if ends]
    low, high = axes.get_ylim()
    for other in _at_place(axes):
        if other in behind:
            share = (high - low) / max(other.get_ylim()[1], 1e-300)
            series += [_histogram(z, "density", low, share) for z in other.containers]
    for line in lines:
        x, y = map(_scaled, line.get_data(), logs)
        if not _is_data(axes, line):  # a level, from edge to edge
            x = _scaled([min(ends), max(ends)], logs[0])
        style = line.get_linestyle()
        is_points = style == "None"
        series.append(
            {
                "kind": "stem" if is_points else "line",
                "name": _name(line),
                "color": to_hex(line.get_color()),
                "width": round(float(line.get_linewidth()), 2),
                "dashed": not is_points and style != "-",
                "step": line.get_drawstyle() == "steps-post",
                **_points(x, y),
            }
        )
    spec = axes.get_subplotspec()
    return {
        "column": 0 if spec is None else spec.colspan.start,
        "xlabel": _abscissa(axes),
        "ylabel": _plain(axes.get_ylabel()),
        "title": _plain(axes.get_title(loc="left") or axes.get_title()),
        "xlog": logs[0],
        "ylog": logs[1],
        # a curve that leaves limits that were set is out of view here, too
        "limits": None
        if axes.get_autoscaley_on()
        else _rounded(_scaled([low, high], logs[1]), 5),
        "series": series,
    }


def _spans(axes):
    """Return the areas that lie between two levels from edge to edge."""
    level = False, True  # which of both coordinates are data
    return [
        patch
        for patch in axes.patches
        if patch.get_transform().contains_branch_seperately(axes.transData) == level
    ]


def _level_band(patch, ends, logs):
    """Return an area between two levels, as long as the curves."""
    corners = patch.get_patch_transform().transform(patch.get_path().vertices)
    levels = _scaled([corners[:, 1].min(), corners[:, 1].max()], logs[1])
    return {
        "kind": "band",
        "name": _name(patch),
        "color": to_hex(tuple(patch.get_facecolor()[:3])),
        **_band(np.repeat(_scaled([min(ends), max(ends)], logs[0]), 2), [*levels] * 2),
    }


def _histogram(bars, name, low=0.0, scale=1.0):
    """Return bars as a band with steps, from `low` upwards."""
    x = [z for bar in bars for z in (bar.get_x(), bar.get_x() + bar.get_width())]
    top = np.repeat([low + scale * bar.get_height() for bar in bars], 2)
    return {
        "kind": "band",
        "name": name,
        "color": to_hex(bars[0].get_facecolor()[:3]),
        "x": _rounded(x, 7),
        "y": _rounded(np.full(len(x), low), 5),
        "high": _rounded(top, 5),
    }


def _scaled(z, log):
    """Return coordinates as they stand on an axis; not finite where they do not."""
    z = np.asarray(z, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log10(z) if log else z


def _is_data(axes, line):
    """Return whether both coordinates are data; the abscissa of a level is not."""
    return line.get_transform() == axes.transData


def _abscissa(axes):
    """Return the label of the abscissa with the unit that its ticks carry."""
    label = _plain(axes.get_xlabel())
    unit = getattr(axes.xaxis.get_major_formatter(), "unit", "")
    return f"{label}, {unit}" if label and unit else label


def _plain(label):
    return " ".join(label.split())


def _name(artist):
    """Return the name in the legend; empty if it has none."""
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _band(places, edges):
    """Return the lower and the upper edge of a band."""
    x = np.unique(places)
    at = [np.asarray(edges)[places == value] for value in x]
    low, high = ([f(z) for z in at] for f in (np.min, np.max))
    return {"x": _rounded(x, 7), "y": _rounded(low, 5), "high": _rounded(high, 5)}


def _points(x, y):
    """Return a curve, of a long one the extremes of every stretch."""
    if len(x) > MOST_POINTS:
        parts = np.array_split(np.arange(len(x)), MOST_POINTS // 2)
        filled = np.where(np.isfinite(y), y, np.nan_to_num(np.nanmean(y)))
        ends = [
            sorted({int(part[f(filled[part])]) for f in (np.argmin, np.argmax)})
            for part in parts
        ]
        kept = np.concatenate(ends)
        x, y = x[kept], y[kept]
    return {"x": _rounded(x, 7), "y": _rounded(y, 5)}


def _rounded(values, digits):
    """Return numbers with few digits; None where there is none."""
    return [
        float(f"{value:.{digits}g}") if np.isfinite(value) else None
        for value in np.asarray(values, dtype=float)
    ]
