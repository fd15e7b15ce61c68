r"""Roughness of a single map from its contour loops, without finite-size bias.

The slope of $\ln \langle s \rangle$ against $\ln R$ tends to $D_f = (3 - \alpha)/2$ only on maps
far larger than any: inverting it on a real map is off by up to 0.2. But any statistic of the loops
on maps of a given size has an expectation that can be simulated once. Indirect inference finds the
alpha whose simulated maps have the loops of this one,

$$\min_\alpha\ [m - \mu(\alpha)]^T\, \Sigma(\alpha)^{-1}\, [m - \mu(\alpha)],$$

so lattice, size and discarded loops enter both sides alike; the scatter $\Sigma$ of the simulated
maps is the error, and the minimum says whether they are loops of a self-affine map at all.

The statistics m, all free of the heights' unit, are taken over 64 equally spaced levels: the slope
of $\langle s\rangle(R)$ over 3 <= R <= L/5 sites, each bin weighted by its contour length, and
$\ln[1 - P_>(s)]$ at two lengths, the share of all contour length, winding and open loops included,
in closed loops of up to 32 and up to 128 steps. That share is sharp: it settles alpha to 0.01,
where the slope alone gives 0.03. What is simulated are Gaussian maps with S(q) ~ q^(-2-2 alpha) up
to the zone's edge: a map that is smooth at a few sites is not one of them, and its chi2 says so.

Source: C. Gourieroux, A. Monfort & E. Renault, J. Appl. Econometrics 8, S85 (1993); the loops, the
paper's Sec. III.
"""

import csv
import os
from dataclasses import replace
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
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.statistics import mean_length
from jaxsurf.surfaces.gaussian import sample

BOUNDARIES = ("periodic", "open")
LEVELS = 64
SMALLEST_RADIUS, LARGEST_RADIUS = 3.0, 0.2  # in sites, and in sides of the map
SHORT = (32, 128)
STATISTICS = ("slope", *(f"short{length}" for length in SHORT))
ALPHAS = tuple(round(0.1 * k, 1) for k in range(-1, 15))
SURFACES = 64
AT_ONCE = 8
SURROUND = 2  # an open map is cut from a periodic one so many times as wide
DEGREE, SCATTER_DEGREE = 5, 3  # of the polynomials in alpha
ROUNDS = 6  # of taking the scatter at the last alpha; it varies slowly
#: Loops as odd as this among self-affine maps are taken for those of another kind of map.
LEAST_CHANCE = 1e-4
SHIPPED = "loop_statistics.csv"
PAIRS = tuple((i, j) for i in range(len(STATISTICS)) for j in range(i + 1))
COLUMNS = (
    *("boundary", "side", "alpha", "surfaces"),
    *STATISTICS,
    *(f"{STATISTICS[i]}*{STATISTICS[j]}" for i, j in PAIRS),
)


class Expected(NamedTuple):
    """What maps of one size and boundary are expected to show, as polynomials in alpha.

    Attributes:
        mean: coefficients of the mean of each statistic, highest power first.
        factor: coefficients of the Cholesky factor of their covariance between maps: logarithms on
            the diagonal, shares of the row's diagonal below it.
        surfaces: simulated maps at each alpha.
    """

    mean: Float[np.ndarray, "power statistic"]
    factor: Float[np.ndarray, "power pair"]
    surfaces: int

    def whitening(self, alpha: float) -> Float[np.ndarray, "statistic statistic"]:
        """The matrix that makes statistics of one map independent, with errors of one."""
        lower = np.zeros((len(STATISTICS),) * 2)
        for place, (i, j) in enumerate(PAIRS):
            lower[i, j] = np.polyval(self.factor[:, place], alpha)
        scale = np.exp(np.diag(lower))
        np.fill_diagonal(lower, 1.0)
        return np.linalg.inv(lower * scale[:, None])


def fit_loops(
    heights: Any,
    *,
    boundary: str = "periodic",
    rng: np.random.Generator | int = 0,
    cache: str | Path | None = None,
) -> Fit:
    r"""Roughness exponent of a map from the statistics of its contour loops, by simulation.

    Arguments:
        heights: a square map `[x, y]`, or maps `[surface, x, y]` whose statistics are averaged.
        boundary: "periodic" or "open".
        rng: seed or generator of the levels' phase.
        cache: folder for simulated sizes that are not shipped; `~/.cache/jaxsurf` if None. A new
            size takes the tracing of 1024 maps, once.

    Returns:
        A `Fit` of "alpha". `stderr` is the scatter of simulated maps of that alpha, over the root
        of the number of maps; `systematic` what the finite simulation leaves open. `chi2`, with two
        degrees of freedom, compares the slope and the two shares of short loops with one another.

    Raises:
        ValueError: a map that is not square or smaller than 32 x 32, or without closed loops; an
            unknown boundary.

    Source: the paper's Sec. III, Eqs. (Ds-R) and (PS).
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
    measured = loop_statistics(maps, boundary=boundary, rng=rng)
    if bad := np.flatnonzero(np.isnan(measured).any(1)).tolist():
        raise ValueError(
            f"fit_loops needs closed loops of at most {SHORT[0]} steps and of two radii between "
            f"{SMALLEST_RADIUS:g} and {LARGEST_RADIUS * side:g} sites on each map; surfaces "
            f"{bad[:5]} have none. Leave them out, or use fit_likelihood."
        )
    statistics = measured.mean(0)
    expected = expected_statistics(side, boundary, cache=cache)
    alpha, chi2 = _nearest(statistics, expected, len(maps))
    whitening = expected.whitening(float(np.clip(alpha, ALPHAS[0], ALPHAS[-1])))
    steepness = whitening @ _polynomials(_derivatives(expected.mean), alpha)
    scatter = float(1 / np.linalg.norm(steepness))
    error = scatter / np.sqrt(len(maps))
    # polynomials of DEGREE + 1 coefficients through len(ALPHAS) means of `surfaces` maps each
    share = np.sqrt((DEGREE + 1) / len(ALPHAS) / expected.surfaces)
    fit = Fit(
        model="loops against simulated loops",
        values={"alpha": float(np.clip(alpha, ALPHAS[0], ALPHAS[-1]))},
        stderr={"alpha": error},
        systematic={"alpha": scatter * float(share)},
        covariance=np.array([[error**2]]),
        chi2=chi2,
        dof=len(STATISTICS) - 1,
        details={
            **dict(zip(STATISTICS, statistics.tolist(), strict=True)),
            "side": side,
            "boundary": boundary,
            "maps": len(maps),
        },
    )
    return _judged(fit, alpha)


def loop_statistics(
    maps: Float[np.ndarray, "surface x y"],
    *,
    boundary: str = "periodic",
    rng: np.random.Generator | int = 0,
) -> Float[np.ndarray, "surface statistic"]:
    """The slope of ln<s> against ln R and the logarithms of the shares of short loops, by map.

    A statistic for which a map has too few closed loops is NaN.
    """
    loops = level_loops(maps, LEVELS, rng=rng, boundary=boundary)
    length = loops.weight * loops.length
    total = np.bincount(loops.surface, length, len(maps))
    columns = [_slopes(loops, maps.shape[-1])]
    for longest in SHORT:
        kept = loops.closed & (loops.length <= longest)
        short = np.bincount(loops.surface[kept], length[kept], len(maps))
        share = short / np.where(total > 0, total, 1.0)
        columns.append(np.where(share > 0, np.log(np.where(share > 0, share, 1.0)), np.nan))
    return np.stack(columns, 1)


def _slopes(loops: Loops, side: int) -> Float[np.ndarray, " surface"]:
    part = mean_length(loops, per="length").window(SMALLEST_RADIUS, LARGEST_RADIUS * side)
    x, samples, weights = (np.asarray(a, float) for a in (part.scale, part.samples, part.weights))
    y = np.log(np.where(weights > 0, samples, 1.0))
    total = weights.sum(1, keepdims=True)
    log_x = np.log(x)[None, :]
    arm = log_x - (weights * log_x).sum(1, keepdims=True) / np.maximum(total, 1e-300)
    spread = (weights * arm**2).sum(1)
    enough = (weights > 0).sum(1) >= 2
    return np.where(enough, (weights * arm * y).sum(1) / np.where(enough, spread, 1.0), np.nan)


def simulate_statistics(
    side: int, boundary: str, *, surfaces: int = SURFACES, seed: int = 0
) -> list[dict[str, Any]]:
    """Rows of the table for one size: mean and covariance of the statistics at each of `ALPHAS`."""
    rows = []
    wide = side * (SURROUND if boundary == "open" else 1)
    for k, alpha in enumerate(ALPHAS):
        found = []
        for i in range(0, surfaces, AT_ONCE):
            key = jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), k), i)
            maps = sample(SelfAffine(alpha), (wide, wide), key=key, batch=AT_ONCE, dtype="float32")
            cut = np.asarray(maps)[:, :side, :side]
            found.append(loop_statistics(cut, boundary=boundary, rng=seed + i))
        values = np.concatenate(found)
        values = values[~np.isnan(values).any(1)]  # all loops may wind at alpha > 1
        covariance = np.cov(values.T)
        numbers = [*values.mean(0), *(covariance[i, j] for i, j in PAIRS)]
        rows.append(dict(zip(COLUMNS, (boundary, side, alpha, len(values), *numbers), strict=True)))
    return rows


def expected_statistics(side: int, boundary: str, *, cache: str | Path | None = None) -> Expected:
    """The expectation for maps of one size: shipped, cached, or simulated now and cached."""
    shipped = resources.files("jaxsurf.analysis").joinpath("tables", SHIPPED)
    rows = _of(csv.DictReader(shipped.read_text().splitlines()), side, boundary)
    if not rows:
        base = os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")
        folder = Path(base, "jaxsurf") if cache is None else Path(cache)
        file = folder / f"loop_statistics_{boundary}_{side}.csv"
        if not file.exists():
            folder.mkdir(parents=True, exist_ok=True)
            unfinished = file.with_suffix(f".{os.getpid()}.part")
            write_table(unfinished, simulate_statistics(side, boundary))
            unfinished.replace(file)
        rows = _of(csv.DictReader(file.read_text().splitlines()), side, boundary)
    return _smooth(tuple(tuple(float(row[c]) for c in COLUMNS[2:]) for row in rows))


def write_table(file: Path, rows: list[dict[str, Any]]) -> None:
    """Write simulated statistics as CSV."""
    with file.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(
                [row[c] for c in COLUMNS[:4]] + [f"{float(row[c]):.7g}" for c in COLUMNS[4:]]
            )


def _of(rows: Any, side: int, boundary: str) -> list[dict[str, str]]:
    return [row for row in rows if row["boundary"] == boundary and int(row["side"]) == side]


@lru_cache(maxsize=32)
def _smooth(rows: tuple[tuple[float, ...], ...]) -> Expected:
    """Polynomials through the simulated means and through the factors of their covariances."""
    table = np.array(rows)
    alpha, surfaces = table[:, 0], table[:, 1]
    means = table[:, 2 : 2 + len(STATISTICS)]
    covariance = np.zeros((len(table), len(STATISTICS), len(STATISTICS)))
    for place, (i, j) in enumerate(PAIRS):
        covariance[:, i, j] = covariance[:, j, i] = table[:, 2 + len(STATISTICS) + place]
    error = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2) / surfaces[:, None])
    lower = np.linalg.cholesky(covariance)
    parts = [
        np.log(lower[:, i, i]) if i == j else lower[:, i, j] / lower[:, i, i] for i, j in PAIRS
    ]
    return Expected(
        np.stack(
            [
                np.polyfit(alpha, means[:, k], DEGREE, w=1 / error[:, k])
                for k in range(means.shape[1])
            ],
            1,
        ),
        np.stack([np.polyfit(alpha, part, SCATTER_DEGREE) for part in parts], 1),
        int(surfaces.min()),
    )


def _nearest(
    statistics: Float[np.ndarray, " statistic"], expected: Expected, maps: int
) -> tuple[float, float]:
    """The alpha whose simulated maps are nearest, and the chi2 of the distance."""
    grid = np.linspace(ALPHAS[0], ALPHAS[-1], 151)
    away = [
        np.linalg.norm(
            expected.whitening(alpha) @ (statistics - _polynomials(expected.mean, alpha))
        )
        for alpha in grid
    ]
    alpha = float(grid[np.argmin(away)])
    chi2 = 0.0
    for _ in range(ROUNDS):
        whitening = expected.whitening(float(np.clip(alpha, ALPHAS[0], ALPHAS[-1])))
        found = solve(_mismatch, np.array(alpha), (statistics, expected.mean, whitening))
        alpha, chi2 = float(found.values), float(found.chi2) * maps
    return alpha, chi2


def _judged(fit: Fit, alpha: float) -> Fit:
    """The fit with the status it deserves."""
    if not ALPHAS[0] <= alpha <= ALPHAS[-1]:
        status = (
            f"at its bound: alpha = {fit.values['alpha']:g}; the loops lie beyond the simulated "
            "range. The map is not self-affine at the scale of its loops: look at fit_crossover."
        )
    elif fit.p_value < LEAST_CHANCE:
        status = (
            f"not loops of a self-affine Gaussian map: chi2 = {fit.chi2:.1f} / {fit.dof} at alpha "
            f"= {fit.values['alpha']:.2f}. A map smooth or noisy at a few sites does this: coarsen "
            "it, or use fit_likelihood with a noise floor or fit_crossover."
        )
    else:
        return fit
    return replace(fit, status=status)


def _polynomials(
    coefficients: Float[np.ndarray, "power statistic"], alpha: float
) -> Float[np.ndarray, " statistic"]:
    return np.array([np.polyval(column, alpha) for column in coefficients.T])


def _derivatives(
    coefficients: Float[np.ndarray, "power statistic"],
) -> Float[np.ndarray, "lower statistic"]:
    return np.stack([np.polyder(column) for column in coefficients.T], 1)


def _mismatch(alpha: Array, data: tuple[Array, Array, Array]) -> Array:
    statistics, mean, whitening = data
    return whitening @ (statistics - jax.vmap(jnp.polyval, (1, None))(mean, alpha))
