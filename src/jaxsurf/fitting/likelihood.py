r"""Maximum likelihood: the most that the heights of a map can tell about its law.

A straight line through a binned spectrum throws away how well each mode is known. The likelihood
does not: on a periodic map the error of alpha is as small as any estimate can have, the
Cramer-Rao bound, 1.383/L on an L x L map, and the error it quotes is the one it makes. An open map,
or one with missing sites, is seen through its steps from site to site, and their power is compared
with what its own edges, holes and levelling make of the law (`_debiased`): leakage biases nothing.

Source: P. Whittle, J. R. Stat. Soc. B 15, 125 (1953); A. P. Guillaumin, A. M. Sykulski,
S. C. Olhede & F. J. Simons, J. R. Stat. Soc. B 84, 1526 (2022).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxsurf import _grid
from jaxsurf._checks import check_choice, check_heights, check_in_range, check_spacing
from jaxsurf.fitting import _debiased
from jaxsurf.fitting._least_squares import CONVERGED
from jaxsurf.fitting._whittle import NOISE, AllModes, Minimum, Model, Periodogram, minimise
from jaxsurf.fitting._whittle_start import bins_of, start
from jaxsurf.fitting.fit import Fit
from jaxsurf.laws import Law

BOUNDARIES = ("periodic", "open")
CLOSE_ENOUGH = 0.05  # standard errors from the maximum at which a fit counts as converged
MODES_PER_BIN = 60.0  # of the residual spectrum: enough for its ratio to be nearly Gaussian


def fit_likelihood(
    heights: Any,
    law: Law,
    *,
    boundary: str = "periodic",
    mask: Any = None,
    noise: bool = False,
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float | int, float | int]] | None = None,
    spacing: float | int = 1.0,
    each: bool = False,
    surround: int = 2,
) -> Fit | list[Fit]:
    r"""Fit a spectral law to heights by maximum likelihood.

    $$-\ln p = \frac12 \sum_{q \ne 0} \left[\ln f(q) + \frac{I(q)}{f(q)}\right]$$

    with I the periodogram and f its expectation: S(q), plus the noise floor, on a periodic map.

    Arguments:
        heights: maps `[x, y]` or `[surface, x, y]`, in the law's unit of height.
        law: its class says which law, its fields which parameters; they also help to start.
        boundary: "periodic", or "open" for a map with edges, whose plane does not matter.
        mask: true on valid sites, `[x, y]`, or one for each map, `[surface, x, y]`, with each=True.
        noise: whether white noise is added to the law; its "noise_floor" is a spectral density, the
            variance of the noise times the area of a site.
        fixed: fields of the law that keep their given value.
        bounds: name -> (low, high). Unless given: alpha in (-1, 2), cutoff from 2 sites to half the
            side, amplitude above 0, noise_floor from 0.
        spacing: lattice constant, in the law's unit of length.
        each: one `Fit` a surface, instead of one for all surfaces together.
        surround: an open map is taken as cut from a periodic surface so many times as wide, 2 or
            more; it matters only where the law has power at wavelengths beyond the map.

    Returns:
        A `Fit` with the law's free parameters and "noise_floor", or a list of them. `stderr` is
        from the Fisher information, and on a periodic map with a free cutoff the width of the
        whole likelihood, which has many maxima; of open and masked maps the sandwich. `chi2` judges
        the model: the residual spectrum I/f in bins of |q| against 1, in
        `details["residual_spectrum"]` as (q, ratio, error); of masked maps it is at most its dof.

    Raises:
        TypeError: a law that is none, heights that are not real numbers.
        ValueError: names that the law does not have, starting values outside the bounds, heights
            that are not finite or do not vary, a law that noise cannot be told from, masks that
            differ without each=True, a map with fewer than 64 steps along an axis.

    >>> import jax
    >>> from jaxsurf import SelfAffine, sample
    >>> heights = sample(SelfAffine(alpha=0.4), (64, 64), key=jax.random.key(0))
    >>> fit = fit_likelihood(heights, SelfAffine(alpha=0.5))
    >>> abs(fit.values["alpha"] - 0.4) < 3 * fit.stderr["alpha"]
    True
    """
    check_choice("boundary", boundary, BOUNDARIES)
    check_spacing(spacing)
    check_heights(heights, mask=mask)
    maps = np.asarray(heights, np.float64)
    maps = maps.reshape(-1, *maps.shape[-2:])
    masks = _common_mask(mask)
    if masks is not None and masks.ndim == 3 and not each:
        raise ValueError(
            "maps with masks of their own are fitted one by one; got masks of shape "
            f"{np.shape(mask)} that differ. Pass each=True, or one mask for all maps."
        )
    free = _free_names(law, noise, fixed)
    limits = _limits(law, free, bounds or {}, min(maps.shape[-2:]) * float(spacing), float(spacing))
    if boundary == "periodic" and masks is None:
        seen = [_periodic(maps, float(spacing))]
    elif masks is None or masks.ndim == 2:
        seen = [_debiased.observe(maps, masks, boundary, float(spacing), surround)]
    else:
        seen = [
            _debiased.observe(one[None], own, boundary, float(spacing), surround)
            for one, own in zip(maps, masks, strict=True)
        ]
    fits = [fit for data in seen for fit in _fits(law, free, limits, data if each else data.pooled)]
    return fits if each else fits[0]


def _fits(
    law: Law, free: tuple[str, ...], limits: dict[str, tuple[float, float]], data: Periodogram
) -> list[Fit]:
    """One fit for each row of the periodogram."""
    rough = data.observer.rough_spectrum(data.periodogram)
    at = start(law, free, limits, data.q, rough, data.multiplicity, NOISE)
    logarithmic = tuple(limits[name][0] >= 0 and name not in (NOISE, "alpha") for name in free)
    scale = float(np.median(rough[:, data.q > 0.8 * data.q.max()].mean(1)))
    model = Model(jax.tree.map(np.float64, law), np.float64(scale), free, logarithmic)
    with (
        jax.enable_x64(True),
        jax.numpy_rank_promotion("allow"),
        jax.numpy_dtype_promotion("standard"),
    ):
        begin = np.stack([_to_line(model, values) for values in at])
        low, high = (_to_line(model, {n: limits[n][end] for n in free}) for end in (0, 1))
        found = jax.tree.map(np.asarray, minimise(model, data, begin, low, high))
    return [_fit(model, data, found, k, low, high) for k in range(len(begin))]


def _common_mask(mask: Any) -> Bool[np.ndarray, "*map x y"] | None:
    """The mask as `[x, y]` if all maps share it, else `[map, x, y]`."""
    if mask is None:
        return None
    each = np.asarray(mask)
    each = each.reshape(-1, *each.shape[-2:])
    return each[0] if np.all(each == each[0]) else each


@lru_cache(maxsize=16)
def _shells(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Which shell of equal |q| each mode of `rfft2` belongs to, and the modes behind each shell."""
    n_x = np.rint(np.fft.fftfreq(shape[0]) * shape[0]).astype(np.int64)[:, None]
    n_y = np.arange(shape[1] // 2 + 1, dtype=np.int64)[None, :]
    square = (n_x * shape[1]) ** 2 + (n_y * shape[0]) ** 2  # |q|^2 up to a factor, exactly
    _, shell = np.unique(square.ravel(), return_inverse=True)
    multiplicity = np.broadcast_to(_grid.mode_multiplicity(shape), square.shape).ravel()
    return shell, np.bincount(shell, multiplicity)


def _periodic(maps: Float[np.ndarray, "map x y"], spacing: float) -> Periodogram:
    """The mean of |h(q)|^2/A over each shell of equal |q|: all that a law of |q| can see."""
    shape = (maps.shape[1], maps.shape[2])
    shell, count = _shells(shape)
    weight = np.broadcast_to(_grid.mode_multiplicity(shape), (shape[0], shape[1] // 2 + 1)).ravel()
    q = np.bincount(shell, weight * _grid.wave_number(shape, spacing).ravel()) / count
    rows = []
    for heights in maps:
        modes = np.abs(np.fft.rfft2(heights)).ravel() ** 2 * (spacing**2 / heights.size)
        rows.append(np.bincount(shell, weight * modes) / count)
    return Periodogram(q[1:], np.stack(rows)[:, 1:], count[1:], AllModes(q[1:]))


def _free_names(law: Any, noise: bool, fixed: Sequence[str]) -> tuple[str, ...]:
    if not isinstance(law, Law):
        raise TypeError(
            f"law must be a spectral law; got {law!r}. Pass e.g. SelfAffine(alpha=0.5)."
        )
    names = [f.name for f in dataclasses.fields(law) if getattr(law, f.name) is not None]
    if unknown := sorted(set(fixed) - set(names)):
        raise ValueError(
            f"fixed must name fields of the law, {names}; got {unknown}. Drop these names."
        )
    free = tuple(name for name in names if name not in fixed)
    if noise and not hasattr(law, "alpha"):
        raise ValueError(
            f"a noise floor cannot be told from {type(law).__name__}, which is white itself; got "
            "noise=True. Pass noise=False."
        )
    if not free:
        raise ValueError(f"something must be left to fit; got fixed={list(fixed)}. Free a field.")
    return (*free, NOISE) if noise else free


def _limits(
    law: Law,
    free: tuple[str, ...],
    given: Mapping[str, tuple[float | int, float | int]],
    side: float,
    spacing: float,
) -> dict[str, tuple[float, float]]:
    defaults = {
        "alpha": (-1.0, 2.0 - 1e-6),
        "amplitude": (0.0, np.inf),
        "cutoff": (2 * spacing, side / 2 * (1 - 1e-6)),
        NOISE: (0.0, np.inf),
    }
    if unknown := sorted(set(given) - set(free)):
        raise ValueError(
            f"bounds must name free parameters, {list(free)}; got {unknown}. Drop these names."
        )
    limits = {}
    for name in free:
        low, high = given.get(name, defaults.get(name, (-np.inf, np.inf)))
        if not low < high:
            raise ValueError(
                f"bounds of {name} must be (low, high) with low < high; got {(low, high)}. "
                "Swap them, or pass the name in fixed=."
            )
        limits[name] = (float(low), float(high))
        if name != NOISE:
            check_in_range(
                f"the starting value of {name}",
                getattr(law, name),
                low,
                high,
                remedy="Start inside the bounds, or widen them by bounds=.",
            )
    return limits


def _to_line(model: Model, values: Mapping[str, float]) -> Float[np.ndarray, " parameter"]:
    """Parameters on the line that the minimiser walks; see `Model`."""
    line = []
    for name, is_log in zip(model.free, model.logarithmic, strict=True):
        value = values[name] / (float(model.noise_scale) if name == NOISE else 1.0)
        line.append(np.log(np.clip(value, 1e-300, 1e300)) if is_log else value)
    return np.clip(np.array(line, np.float64), -1e6, 1e6)


def _fit(
    model: Model,
    data: Periodogram,
    found: Minimum,
    k: int,
    low: np.ndarray,
    high: np.ndarray,
) -> Fit:
    """The k-th map's minimum as a `Fit`, in the parameters' own units."""
    point, names = np.asarray(found.parameters[k]), model.free
    values = {name: float(v) for name, v in model.values(point).items()}
    units = {NOISE: float(model.noise_scale)}
    slopes = np.array(
        [
            values[name] if is_log else units.get(name, 1.0)
            for name, is_log in zip(names, model.logarithmic, strict=True)
        ]
    )
    fisher = np.asarray(found.fisher[k])
    covariance = np.asarray(found.covariance[k]) * np.outer(slopes, slopes)
    status, known = CONVERGED, np.all(np.isfinite(fisher)) and np.all(np.isfinite(covariance))
    if not known or np.linalg.matrix_rank(fisher, hermitian=True) < len(names):
        covariance = np.full((len(names), len(names)), np.inf)
        status = (
            "failed: the map does not determine all parameters. Keep some by fixed=, or pass a law "
            "nearer to the data."
        )
    elif not found.distance[k] < CLOSE_ENOUGH:
        status = (
            f"not converged: the maximum seems {found.distance[k]:.2g} errors away. Pass a law "
            "nearer to the data, or tighter bounds=."
        )
    elif held := [n for n, p, b, t in zip(names, point, low, high, strict=True) if p in (b, t)]:
        shown = ", ".join(f"{name} = {values[name]:.4g}" for name in held)
        status = (
            f"at its bound: {shown}. The other values hold given this one; keep it by fixed= "
            "(or noise=False), or widen bounds=."
        )
    q, ratio, error = _residual_spectrum(data, np.asarray(found.expected[k]), k)
    return Fit(
        model=f"likelihood of {type(model.law).__name__}" + " with noise" * (NOISE in names),
        values=values,
        stderr=dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        chi2=float((((ratio - 1) / error) ** 2).sum()),
        dof=max(len(q) - len(names), 0),
        status=status,
        details={
            "log_likelihood": -float(found.deviance[k]),
            "maps": data.maps,
            "modes": float(data.multiplicity.sum()),
            "errors": data.observer.errors,
            "residual_spectrum": (q, ratio, error),
        },
    )


def _residual_spectrum(
    data: Periodogram, expected: Float[np.ndarray, " mode"], k: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bins of |q|, the mean of I/f in each and its standard error; 1 if the model holds."""
    bins = bins_of(data.q, data.multiplicity, MODES_PER_BIN)
    count = np.bincount(bins, data.multiplicity)
    ratio = np.bincount(bins, data.multiplicity * data.periodogram[k] / expected) / count
    q = np.exp(np.bincount(bins, data.multiplicity * np.log(data.q)) / count)
    return q, ratio, np.sqrt(2 / count) * data.observer.broadening
