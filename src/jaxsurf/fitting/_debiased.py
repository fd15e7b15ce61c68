r"""The expected periodogram of an open or masked map, exactly, from the law's autocovariance.

A map with edges leaks power between wave numbers, and steep spectra leak the most. Two things keep
the likelihood honest. The heights are replaced by their steps to the next site along x and y,
$y_j(x) = h(x + e_j) - h(x)$, which exist wherever two neighbours do and are nearly white where the
heights are steep; levelling the map takes the mean out of each. And the power of what is left, with
windows $g_j$ (1 where the step exists), is compared with its own expectation,

$$f(q) = \frac{a^2}{\sum_j n_j} \sum_j \left\langle \left| \sum_x g_j(x)
  [y_j(x) - \bar y_j]\, e^{-iq\cdot x} \right|^2 \right\rangle, \qquad n_j = \sum_x g_j(x),$$

which follows from the autocovariance $c_j$ that the law gives to the steps: without the mean it is
the transform of $c_j(u) \sum_x g_j(x) g_j(x + u)$, and what levelling takes away is one convolution
of $g_j$ with $c_j$. Leakage is in f, so it biases nothing. What it costs is independence of the
modes; the variance of the gradient, $J_{kl} = \frac12 \mathrm{tr}(B_k C B_l C)$ with C the
covariance of the windowed steps and B_k the quadratic form of the k-th derivative, is estimated
with random signs (Hutchinson), each product by FFT.

Of the heights with a taper, the curvature at one site, and steps, the last lose least: see
`docs/fits.md`.

Source: Guillaumin, Sykulski, Olhede & Simons, J. R. Stat. Soc. B 84, 1526 (2022).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from jaxsurf import _grid
from jaxsurf._checks import check_integer
from jaxsurf.fitting._whittle import Here, Periodogram

FEWEST_STEPS = 64
PROBED = 5e4  # sites times probes: errors of alpha to 0.5 %, of the cutoff to 5 %


class CutOut(eqx.Module):
    """A window cut out of a periodic surface, seen through its steps from site to site.

    Attributes:
        window: g, 1 where both ends of a step along x, or y, are valid.
        overlap: sum of g(x) g(x + u) at lags u = 0 ... L - 1, -L ... -1 of both axes.
        own: transform of g on the map.
        wide: transform of g on the surrounding periodic surface.
        q: |q| of the surrounding surface's modes.
        step: the symbol of a step there, e^{iqa} - 1.
        own_q: |q| of the map's own modes.
        own_filter: mean of the steps' |symbol|^2 there.
        signs: random signs on the map, which probe the variance of the gradient.
        broadening: by how much missing sites widen the scatter of a bin of modes, at most.
        shape: of the surrounding surface, in sites.
        spacing: the lattice constant.
        has_kinks: false: the window smooths the kinks of a sharp cutoff nearly away.
    """

    window: Float[Array | np.ndarray, "2 x y"]
    overlap: Float[Array | np.ndarray, "2 xx yy"]
    own: Complex[Array | np.ndarray, "2 x half"]
    wide: Complex[Array | np.ndarray, "2 u v"]
    q: Float[Array | np.ndarray, "u v"]
    step: Complex[Array | np.ndarray, "2 u v"]
    own_q: Float[Array | np.ndarray, " mode"]
    own_filter: Float[Array | np.ndarray, " mode"]
    signs: Float[Array | np.ndarray, "probe 2 x y"]
    broadening: Any
    shape: tuple[int, int] = eqx.field(static=True)
    spacing: float = eqx.field(static=True)
    has_kinks: bool = eqx.field(static=True, default=False)
    errors: str = eqx.field(static=True, default="sandwich")

    @property
    def steps(self) -> Float[Array, " 2"]:
        """How many steps there are along x and y."""
        return jnp.asarray(self.window).sum((1, 2))

    def expected(self, density: Any) -> Float[Array, " mode"]:
        """The mean of the periodogram of the steps, given S(q) of the heights as a function."""
        spectrum = self._spectrum(density)[None] * jnp.abs(self.step) ** 2
        lx, ly = self.window.shape[1:]
        seen = self._near(jnp.fft.irfft2(spectrum, s=self.shape)) * self.overlap
        seen = seen.reshape(2, 2, lx, 2, ly).sum((1, 3))
        total = jnp.fft.rfft2(seen.sum(0)).real
        spread = jnp.fft.irfft2(spectrum * self.wide, s=self.shape)[:, :lx, :ly]
        with_mean = jnp.fft.rfft2(self.window * spread)  # covariance of each mode with the mean
        share = self.own / self.steps[:, None, None]
        of_mean = seen.sum((1, 2))[:, None, None] * jnp.abs(share) ** 2
        level = jnp.sum(of_mean - 2 * (with_mean * share.conj()).real, 0)
        return (self.spacing**2 / jnp.sum(self.steps) * (total + level)).ravel()[1:]

    def rough(self, density: Any) -> Float[Array, " mode"]:
        """What would be expected without leakage, which costs no transform: a start."""
        return density(jnp.asarray(self.own_q)) * self.own_filter

    def rough_spectrum(
        self, periodogram: Float[np.ndarray, "map mode"]
    ) -> Float[np.ndarray, "map mode"]:
        """S(q) but for leakage, to start from."""
        return periodogram / self.own_filter

    def gradient_variance(
        self, density: Any, here: Here, maps: Any
    ) -> Float[Array, "parameter parameter"]:
        """The variance of the likelihood's gradient, of so many maps together."""
        spectrum = self._spectrum(density)
        lx, ly = self.window.shape[1:]
        scale = self.spacing**2 * lx * ly / jnp.sum(self.steps)
        weights = here.slopes * jnp.exp(-here.log_expected)[:, None]
        rows = jnp.pad(weights.T, ((0, 0), (1, 0)))  # nothing at q = 0
        forms = scale * rows.reshape(-1, lx, ly // 2 + 1)

        def level(field: Array) -> Array:  # the steps that exist, less their mean
            mean = jnp.sum(self.window * field, (1, 2)) / self.steps
            return jnp.where(self.window > 0, field - mean[:, None, None], 0.0)

        def covariance(field: Array) -> Array:  # C v, by embedding in the periodic surface
            modes = jnp.fft.rfft2(level(field), s=self.shape)
            modes = spectrum * jnp.sum(self.step.conj() * modes, 0)
            return level(jnp.fft.irfft2(self.step * modes[None], s=self.shape)[:, :lx, :ly])

        def form(weights: Array, field: Array) -> Array:  # B v
            return jnp.fft.irfft2(weights[None] * jnp.fft.rfft2(field), s=(lx, ly))

        def probe(total: Array, sign: Array) -> tuple[Array, None]:
            sign = jnp.asarray(sign, total.dtype)
            spread = covariance(sign)
            right = jax.lax.map(lambda weights: covariance(form(weights, spread)), forms)
            left = jax.lax.map(lambda weights: form(weights, sign), forms)
            return total + jnp.einsum("kjxy,ljxy->kl", left, right), None

        empty = jnp.zeros((forms.shape[0], forms.shape[0]))
        total, _ = jax.lax.scan(probe, empty, jnp.asarray(self.signs))
        trace = total / self.signs.shape[0]
        return 0.25 * maps * (trace + trace.T)

    def _spectrum(self, density: Any) -> Float[Array, "u v"]:
        return density(self.q).at[0, 0].set(0.0) / self.spacing**2

    def _near(self, covariance: Array) -> Array:
        """The lags that fit into the map, of those on the surrounding surface."""
        for axis, side in ((1, self.window.shape[1]), (2, self.window.shape[2])):
            near = jax.lax.slice_in_dim(covariance, 0, side, axis=axis)
            wide = self.shape[axis - 1]
            far = jax.lax.slice_in_dim(covariance, wide - side, wide, axis=axis)
            covariance = jnp.concatenate([near, far], axis)
        return covariance


def observe(
    maps: Float[np.ndarray, "map x y"],
    mask: Bool[np.ndarray, "x y"] | None,
    boundary: str,
    spacing: float,
    surround: int,
) -> Periodogram:
    """The periodogram of the maps' steps and the observer that knows its expectation."""
    shape = (maps.shape[1], maps.shape[2])
    check_integer("surround", surround, low=2, remedy="2 suffices unless waves exceed the map.")
    valid = np.ones(shape, bool) if mask is None else np.asarray(mask)
    exists = np.stack([valid & np.roll(valid, -1, axis) for axis in (0, 1)])
    if boundary == "open":
        exists[0, -1, :] = False
        exists[1, :, -1] = False
    if min(steps := exists.sum((1, 2))) < FEWEST_STEPS:
        raise ValueError(
            f"the map needs {FEWEST_STEPS} pairs of valid neighbours or more along each axis; got "
            f"{steps.tolist()}. Pass a larger map, or a mask with fewer isolated sites."
        )
    window = exists.astype(float)
    around = shape if boundary == "periodic" else (surround * shape[0], surround * shape[1])
    heights = np.where(valid, maps, 0.0)
    periodogram = np.zeros((len(maps), shape[0], shape[1] // 2 + 1))
    for axis in (0, 1):
        step = (np.roll(heights, -1, axis + 1) - heights) * window[axis]
        level = step.sum((1, 2), keepdims=True) / steps[axis]
        periodogram += np.abs(np.fft.rfft2(step - level * window[axis])) ** 2
    flat = periodogram.reshape(len(maps), -1)[:, 1:] * (spacing**2 / steps.sum())
    multiplicity = np.broadcast_to(_grid.mode_multiplicity(shape), periodogram.shape[1:])
    probes = int(np.ceil(PROBED / window[0].size))
    q = _grid.wave_number(shape, spacing).ravel()[1:]
    cut = CutOut(
        window,
        np.stack([_overlap(g, boundary) for g in window]),
        np.fft.rfft2(window),
        np.fft.rfft2(window, s=around),
        _positive(_grid.wave_number(around, spacing)),
        _step(around),
        q,
        (np.abs(_step(shape)) ** 2).mean(0).ravel()[1:],
        np.random.default_rng(0).choice([-1.0, 1.0], size=(probes, *window.shape)),
        np.sqrt(valid.size / valid.sum()),
        around,
        spacing,
    )
    return Periodogram(q, flat, multiplicity.ravel()[1:].copy(), cut)


def _overlap(window: Float[np.ndarray, "x y"], boundary: str) -> Float[np.ndarray, "xx yy"]:
    """How many pairs of steps lie at each lag."""
    lx, ly = window.shape
    if boundary == "periodic":  # every lag once: the far copies carry nothing
        pairs = np.fft.irfft2(np.abs(np.fft.rfft2(window)) ** 2, s=window.shape)
        return np.pad(pairs, ((0, lx), (0, ly)))
    padded = np.fft.rfft2(window, s=(2 * lx, 2 * ly))
    return np.fft.irfft2(np.abs(padded) ** 2, s=(2 * lx, 2 * ly))


def _step(shape: tuple[int, int]) -> Complex[np.ndarray, "2 x half"]:
    """The symbols e^{iqa} - 1 of a step along x and along y."""
    whole = (shape[0], shape[1] // 2 + 1)
    return np.stack([np.broadcast_to(np.expm1(1j * q), whole) for q in _grid.wave_numbers(shape)])


def _positive(q: Float[np.ndarray, "x half"]) -> Float[np.ndarray, "x half"]:
    q[0, 0] = 1.0  # the zero mode carries nothing; a harmless wave number keeps gradients finite
    return q
