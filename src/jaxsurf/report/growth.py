"""Pictures of growth in time: how a surface roughens, and its loops across the length xi(t)."""

from collections.abc import Callable, Mapping
from math import hypot
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from jaxsurf import theory
from jaxsurf.analysis.growth_in_time import LARGEST_RADIUS, PERCOLATION, Growth
from jaxsurf.curve import Curve
from jaxsurf.report.pictures import (
    COLORS,
    MARKERS,
    STYLE,
    describe_axes,
    guide,
    new_figure,
)

LARGEST_ERROR = 0.3  # points known worse than that are not drawn
SMALLEST = 3.0  # loops of a few steps do not scale
NOISE = {"color": "0.6", "linewidth": 0, "marker": "x", "markersize": 3}


def growth_figures(growth: Growth) -> dict[str, Figure]:
    """File name -> figure: width, spectra and xi(t); the contour loops at all times."""
    return {"growth": _roughening(growth), "growth_loops": _loops(growth)}


def _roughening(growth: Growth) -> Figure:
    figure = new_figure(8.6, 7.0)
    scaling = growth.scaling
    exponents = scaling.exponents
    _width(figure.add_subplot(2, 2, 1), growth)

    raw, collapsed = figure.add_subplot(2, 2, 2), figure.add_subplot(2, 2, 3)
    shades = _shades(growth)
    for i, (time, curve) in enumerate(scaling.spectra.items()):
        _points(raw, curve, lambda x, y: (x, y), _look(i, shades[time]), f"t = {time:g}")
    describe_axes(raw, next(iter(scaling.spectra.values())))
    raw.set_title("(b) spectra", fontsize=9)
    raw.legend(fontsize=6.5, frameon=False, ncols=2)
    details = scaling.collapse.details
    for i, time in enumerate(scaling.spectra):
        if time in details["collapsed"][0]:
            found = details["collapsed"][0][time]
            X, Y = np.asarray(found["X"]), np.asarray(found["Y"])
            collapsed.plot(X, Y, **_look(i, shades[time]))
    master = details["master"][0]
    collapsed.plot(master["X"], master["Y"], "-", color="0.3", linewidth=0.8)
    collapsed.set_xlabel(r"$q\, t^{1/z}$")
    collapsed.set_ylabel(r"$q^{2 + 2\alpha}\, S(q, t)$")
    collapsed.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
    (alpha, *of_alpha), (z, *of_z) = exponents["alpha"], exponents["z"]
    collapsed.set_title(
        f"(c) collapse: α = {alpha:.3f} ± {hypot(*of_alpha):.3f}, z = {z:.2f} ± {hypot(*of_z):.2f}",
        fontsize=9,
    )
    _length(figure.add_subplot(2, 2, 4), growth)
    _logarithmic(figure)
    figure.suptitle(_title(growth), fontsize=10)
    return figure


def _width(axes: Axes, growth: Growth) -> None:
    """w^2 and its increments with the fitted power."""
    scaling = growth.scaling
    for curve, marker, color, name in (
        (scaling.width, "o", "0.5", r"$w^2(t)$"),
        (scaling.increments, "s", COLORS[0], r"$w^2(2t) - w^2(t)$"),
    ):
        mean, error = np.asarray(curve.mean), np.asarray(curve.stderr)
        shown = mean > 0
        bars = np.stack([np.minimum(error, 0.99 * mean), error])[:, shown]
        axes.errorbar(
            curve.scale[shown],
            mean[shown],
            bars,
            fmt=marker,
            color=color,
            elinewidth=0.7,
            label=name,
            **STYLE,
        )
    fit = scaling.beta
    low, high = fit.details["window"]
    x = np.geomspace(low, high, 30)
    axes.plot(x, fit.values["amplitude"] * x ** fit.values["exponent"], "-", color=COLORS[1])
    value, *errors = scaling.exponents["beta of the width"]
    axes.set_title(f"(a) width: β = {value:.3f} ± {hypot(*errors):.3f}", fontsize=9)
    axes.set_xlabel("$t$ [sweeps]" if growth.settings.model == "single-step" else "$t$")
    axes.set_ylabel("squared width")
    axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
    axes.legend(fontsize=7, frameon=False)


def _length(axes: Axes, growth: Growth) -> None:
    """xi(t) of the knees beside t^(1/z) of the collapse."""
    known = growth.scaling.correlation_length
    found = {t: (xi, error) for t, (xi, error) in known.items() if error < LARGEST_ERROR * xi}
    z = growth.scaling.exponents["z"][0]
    times = np.array(list(found))
    values, errors = np.array(list(found.values())).reshape(-1, 2).T
    bars = np.stack([np.minimum(errors, 0.9 * values), errors])
    axes.errorbar(times, values, bars, fmt="o", color=COLORS[0], elinewidth=0.7, **STYLE)
    if len(times):
        factor = np.exp(np.mean(np.log(values) - np.log(times) / z))
        line = factor * times ** (1 / z)
        axes.plot(times, line, "-", color=COLORS[1], label=f"$t^{{1/z}}$, z = {z:.2f} from (c)")
        axes.legend(fontsize=7, frameon=False)
    axes.set_xlabel("$t$ [sweeps]" if growth.settings.model == "single-step" else "$t$")
    axes.set_ylabel(r"$\xi(t)$ [sites]")
    axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
    axes.set_title("(d) correlation length from the knee of each spectrum", fontsize=9)


def _loops(growth: Growth) -> Figure:
    """<s>(R) at all times, and the three loop measures across xi(t)."""
    figure = new_figure(8.6, 7.0)
    shades = _shades(growth)
    alpha, z = (growth.scaling.exponents[name][0] for name in ("alpha", "z"))
    exponents = {
        "mean_length": float(theory.fractal_dimension(alpha)),
        "length_tail": -float(theory.length_tail_exponent(alpha)),
        "loop_correlation": -1.0,
    }
    raw = figure.add_subplot(2, 2, 1)
    for i, (time, curves) in enumerate(growth.loops.items()):
        look = _look(i, shades[time])
        _points(raw, curves["mean_length"], lambda x, y: (x, y), look, f"t = {time:g}")
    _points(raw, growth.white_noise["mean_length"], lambda x, y: (x, y), NOISE, "white noise")
    describe_axes(raw, growth.white_noise["mean_length"])
    raw.set_title(r"(a) $\langle s \rangle(R)$", fontsize=9)
    raw.legend(fontsize=6.5, frameon=False, ncols=2)

    # beyond a quarter of the map its edges, and the loops that wind, are seen
    radius = LARGEST_RADIUS * growth.settings.side
    largest = dict.fromkeys(exponents, radius)
    largest["length_tail"] = radius ** PERCOLATION["mean_length"]
    power = exponents["mean_length"]
    panels = {
        "mean_length": (r"$R/t^{1/z}$", rf"$R^{{-{power:.2f}}} \langle s \rangle$"),
        "length_tail": (
            rf"$s/t^{{{power:.2f}/z}}$",
            rf"$s^{{{-exponents['length_tail']:.2f}}} P_>(s)$",
        ),
        "loop_correlation": (r"$r/t^{1/z}$", r"$r\, G(r)$"),
    }
    for place, (kind, (across, up)) in enumerate(panels.items()):
        axes = figure.add_subplot(2, 2, 2 + place)
        slope = exponents[kind]
        for i, (time, curves) in enumerate(growth.loops.items()):
            size = time ** (power / z if kind == "length_tail" else 1 / z)
            part = curves[kind].window(SMALLEST, largest[kind])
            _points(axes, part, _scaled(size, slope), _look(i, shades[time]))
        axes.set_xlabel(across)
        axes.set_ylabel(up)
        axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
        beyond = PERCOLATION[kind] - slope
        axes.set_title(f"({'bcd'[place]}) dashed: percolation, slope {beyond:+.2f}", fontsize=9)
    _logarithmic(figure)
    for axes, kind in zip(figure.axes[1:], panels, strict=True):
        _percolation(axes, PERCOLATION[kind] - exponents[kind])
    figure.suptitle(f"{_title(growth)}: loops", fontsize=10)
    return figure


def _logarithmic(figure: Figure) -> None:
    """All axes on logarithmic paper, with more numbers where they span less than a decade."""
    for axes in figure.axes:
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            if high > 10 * low:
                axis.set_minor_formatter(NullFormatter())
            else:
                axis.set_minor_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
                for place in (axis.set_major_formatter, axis.set_minor_formatter):
                    place(StrMethodFormatter("{x:g}"))


def _percolation(axes: Axes, slope: float) -> None:
    """A dashed line over the last decade of the drawn points: below if they rise, else above."""
    points = np.concatenate([line.get_xydata() for line in axes.lines])
    x, y = points[np.argsort(points[:, 0])].T
    end = float(np.quantile(x, 0.99))
    start = max(end / 12, float(x[0]))
    if slope > 0:
        height = 0.85 * float(np.min(y[x > 0.6 * end])) * (start / end) ** slope
    else:
        height = 1.25 * float(np.max(y[np.abs(np.log(x / start)) < 0.2]))
    guide(axes, slope, start=(start, height), end=end, name="")


def _scaled(size: float, slope: float) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    return lambda x, y: (x / size, y * x**-slope)


def _points(
    axes: Axes,
    curve: Curve,
    scaled: Callable[..., tuple[np.ndarray, np.ndarray]],
    look: Mapping[str, Any],
    name: str | None = None,
) -> None:
    """The well-known points of a curve, scaled, without error bars."""
    present = curve.present()
    x, y = np.asarray(present.scale, float), np.asarray(present.mean, float)
    shown = (y > 0) & (np.asarray(present.stderr) < LARGEST_ERROR * y)
    axes.plot(*scaled(x[shown], y[shown]), **look, label=name)


def _look(number: int, color: tuple[float, ...]) -> dict[str, Any]:
    return {
        "color": color,
        "linewidth": 0,
        "marker": MARKERS[number % len(MARKERS)],
        "markersize": 3,
        "markerfacecolor": "none",
        "markeredgewidth": 0.8,
    }


def _shades(growth: Growth) -> dict[float, tuple[float, ...]]:
    """Time -> colour, dark for early times."""
    times = list(growth.scaling.times)
    places = np.linspace(0.0, 0.85, len(times))
    return {time: colormaps["viridis"](place) for time, place in zip(times, places, strict=True)}


def _title(growth: Growth) -> str:
    settings = growth.settings
    model = settings.model.replace("edwards-wilkinson", "Edwards-Wilkinson growth")
    model = model.replace("mullins-herring", "Mullins-Herring growth")
    if settings.model == "single-step":
        model = f"single-step model, $p_+$ = {settings.p_plus:g}"
    return f"{model}, L = {settings.side}, {settings.replicas} surfaces"
