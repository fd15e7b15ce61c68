r"""Taking out the plane and fading the edges, before the Fourier transform of an open map.

The heights are projected on the plane that fits them best (least squares over the valid sites), the
rest is multiplied by a window w(x) w(y), and the result divided by the root of the mean square of
the window, so that the spectral density keeps its normalisation. A missing site has window zero.

Source: R. W. Hamming, Digital Filters (1989); M. C. Jacobs et al., Surf. Topogr. 5, 013001 (2017).
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

#: Windows as sums of cosines, w = a_0 - a_1 cos(2 pi t) + a_2 cos(4 pi t), 0 < t < 1 along a side.
WINDOWS: dict[str, tuple[float, ...]] = {
    "none": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}


def window_along(side: int, window: str) -> Float[np.ndarray, " x"]:
    """One side's window, at the sites' centres t = (i + 1/2)/L: positive on every site."""
    t = (np.arange(side) + 0.5) / side
    return sum(
        (-1) ** k * a * np.cos(2 * np.pi * k * t) for k, a in enumerate(WINDOWS[window])
    ) * np.ones(side)


@partial(jax.jit, static_argnames=("window",))
def levelled_and_windowed(
    heights: Float[Array, "surface x y"], valid: Bool[Array, "surface x y"] | None, window: str
) -> Float[Array, "surface x y"]:
    """Heights minus their plane, times a window of unit mean square."""
    lx, ly = heights.shape[-2:]
    w = window_along(lx, window)[None, :, None] * window_along(ly, window)[None, None, :]
    return _faded(without_plane(heights, valid), jnp.asarray(w, heights.dtype), valid)


@jax.jit
def centred_on_valid(
    heights: Float[Array, "surface x y"], valid: Bool[Array, "surface x y"]
) -> Float[Array, "surface x y"]:
    """Heights minus the mean of the valid sites, the missing ones windowed to zero."""
    count = jnp.maximum(jnp.sum(valid, (-2, -1), keepdims=True), 1).astype(heights.dtype)
    mean = jnp.sum(heights, (-2, -1), keepdims=True) / count
    return _faded(heights - mean, jnp.ones((1, 1, 1), heights.dtype), valid)


def _faded(
    heights: Float[Array, "surface x y"],
    window: Float[Array, "1 _ _"],
    valid: Bool[Array, "surface x y"] | None,
) -> Float[Array, "surface x y"]:
    if valid is not None:
        window = window * valid.astype(heights.dtype)
    # Every site has a positive window, so that only a map without valid sites has mean square zero.
    square = jnp.mean(window**2, (-2, -1), keepdims=True)
    return heights * (window / jnp.sqrt(jnp.where(square > 0, square, jnp.ones_like(square))))


def without_plane(
    heights: Float[Array, "surface x y"], valid: Bool[Array, "surface x y"] | None
) -> Float[Array, "surface x y"]:
    """Heights minus their least-squares plane; zero on missing sites."""
    basis = [jnp.asarray(p, heights.dtype) for p in _plane_functions(heights.shape[-2:])]
    if valid is None:  # the three functions are orthogonal over the whole map
        rest = heights
        for p in basis:
            slope = jnp.sum(heights * p, (-2, -1), keepdims=True) / jnp.sum(p * p)
            rest = rest - slope * p
        return rest
    weight = valid.astype(heights.dtype)
    overlap = jnp.stack(
        [jnp.stack([jnp.sum(weight * p * q, (-2, -1)) for q in basis], -1) for p in basis], -2
    )
    projection = jnp.stack([jnp.sum(weight * heights * p, (-2, -1)) for p in basis], -1)
    slopes = jnp.linalg.solve(overlap, projection[..., None])[..., 0]
    plane = sum(slopes[:, k, None, None] * p for k, p in enumerate(basis))
    return weight * (heights - plane)


def check_plane(valid: np.ndarray) -> None:
    """Raise unless the valid sites of each map span a plane."""
    basis = np.concatenate(_plane_functions(valid.shape[-2:]))
    for i, one in enumerate(valid):
        if np.linalg.matrix_rank(basis[:, one] @ basis[:, one].T) < 3:
            raise ValueError(
                "mask must leave at least 3 valid sites not on one line, to level a map by its "
                f"plane; surface {i} has {np.count_nonzero(one)}. Leave that map out."
            )


def _plane_functions(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1, x and y from -1 to 1, as `[1, x, y]` arrays."""
    x = np.linspace(-1, 1, shape[0])[None, :, None] * np.ones((1, 1, shape[1]))
    y = np.linspace(-1, 1, shape[1])[None, None, :] * np.ones((1, shape[0], 1))
    return np.ones((1, *shape)), x, y
