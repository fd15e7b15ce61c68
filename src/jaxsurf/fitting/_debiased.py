r"""The expected periodogram of an open or masked map, exactly, from the law's autocovariance.

A map with edges leaks power between wave numbers, and steep spectra leak the most. Two things keep
the likelihood honest. The heights are replaced by their curvature at one site,
$y(x) = \sum_m [h(x + e_m) - h(x)]$, which is blind to any plane, levelled or not, and nearly white
where the heights are steep; sites without their four neighbours are masked. And the periodogram of
what is left, with window g (1 on valid sites), is compared with its own expectation

$$f(q) = \frac{a^2}{\sum g^2} \sum_u c_y(u)\, R_g(u)\, e^{-iq\cdot u}, \qquad
  R_g(u) = \sum_x g(x)\, g(x + u),$$

with $c_y$ the autocovariance that the law gives to y: leakage is in f, so it biases nothing. What
it costs is independence of the modes; the variance of the gradient,
$J_{kl} = \frac12 \mathrm{tr}(B_k C B_l C)$ with C the covariance of g y and B_k the quadratic form
of the k-th derivative, is estimated with random signs (Hutchinson), each product by FFT.

Source: Guillaumin, Sykulski, Olhede & Simons, J. R. Stat. Soc. B 84, 1526 (2022).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsurf import _grid
from jaxsurf._checks import check_integer
from jaxsurf.fitting._whittle import Here, Periodogram

FEWEST_SITES = 64
PROBED = 2e4  # sites times probes: traces, to about sqrt(2/PROBED) = 1 %


class CutOut(eqx.Module):
    """A window cut out of a periodic surface, seen through its curvature at one site.

    Attributes:
        window: g, 1 on sites with a valid curvature.
        overlap: R_g on lags 0 ... L - 1, -L ... -1 of both axes, over the sum of g^2.
        q: |q| of the surrounding periodic surface's modes.
        filter: |K(q)|^2 there, K the symbol of the curvature.
        own_filter: the same on the map's own modes.
        shape: of the surrounding surface, in sites.
        spacing: the lattice constant.
        signs: random signs on the map, which probe the variance of the gradient.
        broadening: by how much the window widens the scatter of a bin of modes.
        has_kinks: false: the window smooths the kinks of a sharp cutoff.
    """

    window: Float[Array | np.ndarray, "x y"]
    overlap: Float[Array | np.ndarray, "xx yy"]
    q: Float[Array | np.ndarray, "u v"]
    filter: Float[Array | np.ndarray, "u v"]
    own_filter: Float[Array | np.ndarray, " mode"]
    shape: tuple[int, int] = eqx.field(static=True)
    signs: Float[Array | np.ndarray, "probe x y"]
    spacing: float = eqx.field(static=True)
    broadening: float = eqx.field(static=True)
    has_kinks: bool = eqx.field(static=True, default=False)
    errors: str = eqx.field(static=True, default="sandwich")

    def expected(self, density: Any) -> Float[Array, " mode"]:
        """The mean of the periodogram of y, given S(q) of the heights as a function."""
        spectrum = self._curvature_spectrum(density)
        covariance = jnp.fft.irfft2(spectrum, s=self.shape) / self.spacing**2
        lx, ly = self.window.shape
        for axis, side in ((0, lx), (1, ly)):
            near = jax.lax.slice_in_dim(covariance, 0, side, axis=axis)
            far = jax.lax.slice_in_dim(
                covariance, self.shape[axis] - side, self.shape[axis], axis=axis
            )
            covariance = jnp.concatenate([near, far], axis)
        seen = (covariance * self.overlap).reshape(2, lx, 2, ly).sum((0, 2))
        return self.spacing**2 * jnp.fft.rfft2(seen).real.ravel()[1:]

    def rough_spectrum(
        self, periodogram: Float[np.ndarray, "map mode"]
    ) -> Float[np.ndarray, "map mode"]:
        """S(q) but for leakage, to start from."""
        return periodogram / self.own_filter

    def gradient_variance(
        self, density: Any, here: Here, maps: Any
    ) -> Float[Array, "parameter parameter"]:
        """The variance of the likelihood's gradient, of so many maps together."""
        spectrum = self._curvature_spectrum(density) / self.spacing**2
        lx, ly = self.window.shape
        scale = self.spacing**2 * lx * ly / jnp.sum(self.window**2)
        weights = here.slopes * jnp.exp(-here.log_expected)[:, None]
        rows = jnp.pad(weights.T, ((0, 0), (1, 0)))  # nothing at q = 0
        forms = scale * rows.reshape(-1, lx, ly // 2 + 1)

        def covariance(field: Array) -> Array:  # C v, by embedding in the periodic surface
            modes = jnp.fft.rfft2(self.window * field, s=self.shape)
            spread = jnp.fft.irfft2(modes * spectrum, s=self.shape)
            return self.window * spread[:lx, :ly]

        def form(weights: Array, field: Array) -> Array:  # B v
            return jnp.fft.irfft2(weights * jnp.fft.rfft2(field), s=(lx, ly))

        def probe(total: Array, sign: Array) -> tuple[Array, None]:
            spread = covariance(sign)
            right = jax.lax.map(lambda weights: covariance(form(weights, spread)), forms)
            left = jax.lax.map(lambda weights: form(weights, sign), forms)
            return total + jnp.einsum("kxy,lxy->kl", left, right), None

        empty = jnp.zeros((forms.shape[0], forms.shape[0]))
        total, _ = jax.lax.scan(probe, empty, jnp.asarray(self.signs))
        trace = total / self.signs.shape[0]
        return 0.25 * maps * (trace + trace.T)

    def _curvature_spectrum(self, density: Any) -> Array:
        return (density(self.q) * self.filter).at[0, 0].set(0.0)


def observe(
    maps: Float[np.ndarray, "map x y"],
    mask: Bool[np.ndarray, "x y"] | None,
    boundary: str,
    spacing: float,
    surround: int,
) -> Periodogram:
    """The periodogram of the maps' curvature and the observer that knows its expectation."""
    shape = (maps.shape[1], maps.shape[2])
    check_integer("surround", surround, low=2, remedy="2 suffices unless waves exceed the map.")
    valid = np.ones(shape, bool) if mask is None else np.asarray(mask)
    heights = np.where(valid, maps, 0.0)
    steps = [np.roll(heights, s, axis) for axis in (1, 2) for s in (1, -1)]
    curvature = sum(steps) - 4 * heights
    window = valid & np.logical_and.reduce(
        [np.roll(valid, s, axis) for axis in (0, 1) for s in (1, -1)]
    )
    if boundary == "open":
        window[[0, -1], :] = False
        window[:, [0, -1]] = False
    sites = int(window.sum())
    if sites < FEWEST_SITES:
        raise ValueError(
            f"the map needs {FEWEST_SITES} valid sites or more whose four neighbours are valid; "
            f"got {sites}. Pass a larger map, or a mask with fewer isolated sites."
        )
    around = shape if boundary == "periodic" else (surround * shape[0], surround * shape[1])
    overlap = _overlap(window.astype(float), boundary) / sites
    periodogram = np.abs(np.fft.rfft2(np.where(window, curvature, 0.0))) ** 2
    flat = periodogram.reshape(len(maps), -1)[:, 1:] * (spacing**2 / sites)
    multiplicity = np.broadcast_to(_grid.mode_multiplicity(shape), periodogram.shape[1:])
    cut = CutOut(
        window.astype(float),
        overlap,
        _positive(_grid.wave_number(around, spacing)),
        _symbol(around),
        _symbol(shape).ravel()[1:],
        around,
        np.random.default_rng(0).choice([-1.0, 1.0], size=(_probes(window.size), *shape)),
        spacing,
        float(np.sqrt(window.size / sites)),
    )
    q = _grid.wave_number(shape, spacing).ravel()[1:]
    return Periodogram(q, flat, multiplicity.ravel()[1:].copy(), cut)


def _probes(sites: int) -> int:
    return int(np.clip(np.ceil(PROBED / sites), 1, 32))


def _overlap(window: Float[np.ndarray, "x y"], boundary: str) -> Float[np.ndarray, "xx yy"]:
    """How many pairs of valid sites lie at each lag."""
    lx, ly = window.shape
    if boundary == "periodic":  # every lag once: the far copies carry nothing
        pairs = np.fft.irfft2(np.abs(np.fft.rfft2(window)) ** 2, s=window.shape)
        return np.pad(pairs, ((0, lx), (0, ly)))
    padded = np.fft.rfft2(window, s=(2 * lx, 2 * ly))
    return np.fft.irfft2(np.abs(padded) ** 2, s=(2 * lx, 2 * ly))


def _symbol(shape: tuple[int, int]) -> Float[np.ndarray, "x half"]:
    """|K(q)|^2 of the curvature at one site, K = 2 cos(q_x a) + 2 cos(q_y a) - 4."""
    q_x, q_y = _grid.wave_numbers(shape)
    return (4 * np.sin(q_x / 2) ** 2 + 4 * np.sin(q_y / 2) ** 2) ** 2


def _positive(q: Float[np.ndarray, "x half"]) -> Float[np.ndarray, "x half"]:
    q[0, 0] = 1.0  # the zero mode carries nothing; a harmless wave number keeps gradients finite
    return q
