r"""Roughness of a single map from its contour loops, without finite-size bias.

The slope of $\ln \langle s \rangle$ against $\ln R$ tends to $D_f = (3 - \alpha)/2$ only on maps
far larger than any: inverting it on a real map is off by up to 0.2. But the slope of a given recipe
on maps of a given size has an expectation that can be simulated once, and it falls steadily with
alpha. Indirect inference matches the measured slope to that expectation, so lattice, size and
discarded loops enter both sides alike; the scatter of the simulated maps is the error.

The recipe: all loops of 16 equally spaced levels, slope over 3 <= R <= L/5 sites with each bin
weighted by its loops. What is simulated are Gaussian maps with S(q) ~ q^(-2-2 alpha) up to the
zone's edge: a map that is smooth at a few sites is not one of them, and its alpha by this route
should be set beside that by `fit_likelihood`.

Source: C. Gourieroux, A. Monfort & E. Renault, J. Appl. Econometrics 8, S85 (1993); the loops, the
paper's Sec. III.
"""

import csv
import os
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsurf._checks import check_choice, check_heights, check_integer
from jaxsurf.fitting._least_squares import solve
from jaxsurf.fitting.fit import Fit
from jaxsurf.laws import SelfAffine
from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.statistics import mean_length
from jaxsurf.surfaces.gaussian import sample

BOUNDARIES = ("periodic", "open")
LEVELS = 16
SMALLEST_RADIUS, LARGEST_RADIUS = 3.0, 0.2  # in sites, and in sides of the map
ALPHAS = (-0.2, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
SURFACES = 64
SURROUND = 2  # an open map is cut from a periodic one so many times as wide
DEGREE = 3
SHIPPED = "loop_slopes.csv"
COLUMNS = ("boundary", "side", "alpha", "slope", "scatter", "surfaces")


class Slopes(NamedTuple):
    """What maps of one size and boundary are expected to show, as functions of alpha.

    Attributes:
        mean: coefficients of the mean slope, highest power first.
        log_scatter: coefficients of the logarithm of its scatter between maps.
        surfaces: simulated maps at each alpha.
    """

    mean: Float[np.ndarray, " power"]
    log_scatter: Float[np.ndarray, " power"]
    surfaces: int


def fit_loops(
    heights: Any,
    *,
    boundary: str = "periodic",
    rng: np.random.Generator | int = 0,
    cache: str | Path | None = None,
) -> Fit:
    r"""Roughness exponent of a map from the mean length of its contour loops, by simulation.

    Arguments:
        heights: a square map `[x, y]`, or maps `[surface, x, y]` whose slopes are averaged.
        boundary: "periodic" or "open".
        rng: seed or generator of the levels' phase.
        cache: folder for simulated sizes that are not shipped; `~/.cache/jaxsurf` if None. A new
            size takes the tracing of 512 maps, once.

    Returns:
        A `Fit` of "alpha". `stderr` is the scatter of simulated maps of that alpha, over the root
        of the number of maps; `systematic` what the finite simulation leaves open. It has no
        degrees of freedom: one slope gives one alpha.

    Raises:
        ValueError: a map that is not square or smaller than 32 x 32, an unknown boundary.
    """
    check_choice("boundary", boundary, BOUNDARIES)
    check_heights(heights)
    maps = np.asarray(heights)
    side = check_integer(
        "the side of the map", maps.shape[-1], low=32, remedy="Smaller maps hold too few loops."
    )
    if maps.shape[-2] != side:
        raise ValueError(
            f"fit_loops needs square maps, as simulated; got {maps.shape[-2:]}. Cut a square out."
        )
    maps = maps.reshape(-1, side, side)
    slopes = loop_slopes(maps, boundary=boundary, rng=rng)
    if bad := np.flatnonzero(np.isnan(slopes)).tolist():
        raise ValueError(
            f"fit_loops needs closed loops of two radii between {SMALLEST_RADIUS:g} and "
            f"{LARGEST_RADIUS * side:g} sites on each map; surfaces {bad[:5]} have none. Leave "
            "them out, or use fit_likelihood."
        )
    slope = float(np.mean(slopes))
    expected = expected_slopes(side, boundary, cache=cache)
    found = solve(_mismatch, np.array(0.5), (slope, expected.mean))
    alpha = float(np.clip(found.values, ALPHAS[0], ALPHAS[-1]))
    steepness = abs(np.polyval(np.polyder(expected.mean), alpha))
    scatter = float(np.exp(np.polyval(expected.log_scatter, alpha)) / steepness)
    error = scatter / np.sqrt(len(maps))
    status = found.status
    if not ALPHAS[0] <= float(found.values) <= ALPHAS[-1]:
        status = (
            f"at its bound: alpha = {alpha:g}; the slope {slope:.3f} lies beyond the simulated "
            "range. The map is not self-affine at the scale of its loops: look at fit_crossover."
        )
    # a polynomial of DEGREE + 1 coefficients through len(ALPHAS) means of SURFACES maps each
    share = np.sqrt((DEGREE + 1) / len(ALPHAS) / expected.surfaces)
    return Fit(
        model="loops against simulated loops",
        values={"alpha": alpha},
        stderr={"alpha": error},
        systematic={"alpha": scatter * float(share)},
        covariance=np.array([[error**2]]),
        chi2=0.0,
        dof=0,
        status=status,
        details={"slope": slope, "side": side, "boundary": boundary, "maps": len(maps)},
    )


def loop_slopes(
    maps: Float[np.ndarray, "surface x y"],
    *,
    boundary: str = "periodic",
    rng: np.random.Generator | int = 0,
) -> Float[np.ndarray, " surface"]:
    """The slope of ln<s> against ln R of each map by the recipe above; NaN without two radii."""
    side = maps.shape[-1]
    curve = mean_length(level_loops(maps, LEVELS, rng=rng, boundary=boundary), per="length")
    part = curve.window(SMALLEST_RADIUS, LARGEST_RADIUS * side)
    x, samples, weights = (np.asarray(a, float) for a in (part.scale, part.samples, part.weights))
    y = np.log(np.where(weights > 0, samples, 1.0))
    total = weights.sum(1, keepdims=True)
    arm = np.log(x) - (weights * np.log(x)).sum(1, keepdims=True) / np.maximum(total, 1e-300)
    spread = (weights * arm**2).sum(1)
    enough = (weights > 0).sum(1) >= 2
    return np.where(enough, (weights * arm * y).sum(1) / np.where(enough, spread, 1.0), np.nan)


def simulate_slopes(
    side: int, boundary: str, *, surfaces: int = SURFACES, seed: int = 0
) -> list[dict[str, Any]]:
    """Rows of the table for one size: the mean slope and its scatter at each of `ALPHAS`."""
    rows = []
    wide = side * (SURROUND if boundary == "open" else 1)
    for k, alpha in enumerate(ALPHAS):
        slopes = []
        for i in range(0, surfaces, 8):
            key = jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), k), i)
            maps = sample(SelfAffine(alpha), (wide, wide), key=key, batch=8, dtype="float32")
            cut = np.asarray(maps)[:, :side, :side]
            slopes.extend(loop_slopes(cut, boundary=boundary, rng=seed + i))
        slopes = [
            slope for slope in slopes if not np.isnan(slope)
        ]  # all loops may wind at alpha > 1
        values = (boundary, side, alpha, np.mean(slopes), np.std(slopes, ddof=1), len(slopes))
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def expected_slopes(side: int, boundary: str, *, cache: str | Path | None = None) -> Slopes:
    """The expectation for maps of one size: shipped, cached, or simulated now and cached."""
    shipped = resources.files("jaxsurf.analysis").joinpath("tables", SHIPPED)
    rows = _of(csv.DictReader(shipped.read_text().splitlines()), side, boundary)
    if not rows:
        base = os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")
        folder = Path(base, "jaxsurf") if cache is None else Path(cache)
        file = folder / f"loop_slopes_{boundary}_{side}.csv"
        if not file.exists():
            folder.mkdir(parents=True, exist_ok=True)
            unfinished = file.with_suffix(f".{os.getpid()}.part")
            write_table(unfinished, simulate_slopes(side, boundary))
            unfinished.replace(file)
        rows = _of(csv.DictReader(file.read_text().splitlines()), side, boundary)
    return _smooth(tuple(tuple(float(row[c]) for c in COLUMNS[2:]) for row in rows))


def write_table(file: Path, rows: list[dict[str, Any]]) -> None:
    """Write simulated slopes as CSV."""
    with file.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(COLUMNS)
        for row in rows:
            shown = row | {k: f"{row[k]:.6f}" for k in ("slope", "scatter")}
            writer.writerow([shown[column] for column in COLUMNS])


def _of(rows: Any, side: int, boundary: str) -> list[dict[str, str]]:
    return [row for row in rows if row["boundary"] == boundary and int(row["side"]) == side]


@lru_cache(maxsize=32)
def _smooth(rows: tuple[tuple[float, ...], ...]) -> Slopes:
    alpha, slope, scatter, surfaces = np.array(rows).T
    mean = np.polyfit(alpha, slope, DEGREE, w=1 / scatter)
    return Slopes(mean, np.polyfit(alpha, np.log(scatter), 2), int(surfaces[0]))


def _mismatch(alpha: Array, data: tuple[Array, Array]) -> Array:
    slope, mean = data
    return jnp.polyval(mean, alpha) - slope
