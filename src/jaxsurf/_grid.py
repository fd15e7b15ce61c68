r"""The grid and THE Fourier convention; every other file cites this one.

Heights $h[x, y]$ live on $L_x \times L_y$ sites with spacing $a$; the area is $A = L_x L_y a^2$.
The spectral density is

$$S(q) = |\tilde h(q)|^2 / A, \qquad \tilde h(q) = a^2 \sum_x h(x) e^{-iq\cdot x},$$

so that $D_2(r) = (2/A) \sum_q S(q) (1 - \cos q\cdot r)$ and the variance is $(1/A) \sum_{q \ne 0}
S(q)$. Wave numbers fill the first zone $[-\pi/a, \pi/a]^2$. Arrays of wave numbers are in the order
of `rfft2`: the second axis holds $q_y \ge 0$ only, and a mode there stands for itself and its
mirror image (`mode_multiplicity`).

Everything here depends on the shape alone and is plain NumPy in float64: under `jit` it is a
constant.

Source: the paper's Eqs. (struc2), (power), (FTg), with the sign and the factors put right.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

BIN_RATIO = 1.1  # the paper's logarithmic bins, (r, 1.1 r)


def wave_numbers(
    shape: tuple[int, int], spacing: float = 1.0
) -> tuple[Float[np.ndarray, "x 1"], Float[np.ndarray, "1 half"]]:
    """The components q_x and q_y of the modes of `rfft2`, in 1/length."""
    along_x = 2 * np.pi * np.fft.fftfreq(shape[0], spacing)
    along_y = 2 * np.pi * np.fft.rfftfreq(shape[1], spacing)
    return along_x[:, None], along_y[None, :]


def wave_number(shape: tuple[int, int], spacing: float = 1.0) -> Float[np.ndarray, "x half"]:
    """The length |q| of each mode of `rfft2`, in 1/length."""
    return np.hypot(*wave_numbers(shape, spacing))


def mode_multiplicity(shape: tuple[int, int]) -> Float[np.ndarray, " half"]:
    """How many modes of the full zone each column of `rfft2` stands for: 1 or 2."""
    multiplicity = np.full(shape[1] // 2 + 1, 2.0)
    multiplicity[0] = 1.0
    if shape[1] % 2 == 0:
        multiplicity[-1] = 1.0
    return multiplicity


@dataclass(frozen=True)
class Bins:
    """Which bin each entry of a grid falls in, and what each bin stands for.

    Attributes:
        index: the bin of each entry; entries outside all bins have index `len(scale)`.
        scale: geometric mean of the entries' lengths in each bin.
        count: entries in each bin, mirror images counted; never zero.
    """

    index: Int[np.ndarray, "x y"]
    scale: Float[np.ndarray, " bin"]
    count: Float[np.ndarray, " bin"]


def logarithmic_edges(
    low: float, high: float, ratio: float = BIN_RATIO
) -> Float[np.ndarray, " edge"]:
    """Bin edges low, low*ratio, low*ratio^2, ... up to the first at or beyond `high`."""
    steps = int(np.ceil(np.log(high / low) / np.log(ratio) - 1e-9))
    return low * ratio ** np.arange(max(steps, 1) + 1)


def _bins(
    length: Float[np.ndarray, "x y"],
    multiplicity: Float[np.ndarray, " y"],
    edges: Float[np.ndarray, " edge"],
) -> Bins:
    """Sort the entries of a grid into bins, dropping bins that no entry falls in."""
    raw = np.searchsorted(edges, length, side="right") - 1
    inside = (raw >= 0) & (raw < len(edges) - 1)
    weight = np.broadcast_to(multiplicity, length.shape)
    count = np.bincount(raw[inside], weight[inside], minlength=len(edges) - 1)
    logs = np.bincount(
        raw[inside], (weight * np.log(np.where(length > 0, length, 1.0)))[inside], len(edges) - 1
    )
    kept = np.flatnonzero(count)
    renumbered = np.full(len(edges) - 1, len(kept))
    renumbered[kept] = np.arange(len(kept))
    index = np.where(inside, renumbered[np.clip(raw, 0, len(edges) - 2)], len(kept))
    return Bins(index, np.exp(logs[kept] / count[kept]), count[kept])


@lru_cache(maxsize=64)
def radial_bins(
    shape: tuple[int, int], spacing: float = 1.0, ratio: float = BIN_RATIO, corners: bool = False
) -> Bins:
    """Logarithmic bins of |q| from the longest wave of the map to the zone's edge pi/a.

    The corners of the zone, |q| > pi/a, are left out unless asked for: there the bins are no longer
    full rings.
    """
    lowest = 2 * np.pi / (max(shape) * spacing)
    highest = np.pi / spacing * (np.sqrt(2.0) if corners else 1.0)
    edges = logarithmic_edges(lowest * (1 - 1e-12), highest * (1 + 1e-9), ratio)
    edges[-1] = highest * (1 + 1e-9)  # the last ring ends at the zone's edge
    return _bins(wave_number(shape, spacing), mode_multiplicity(shape), edges)


def separations(shape: tuple[int, int]) -> tuple[Int[np.ndarray, "x 1"], Int[np.ndarray, "1 y"]]:
    """The shortest periodic displacement to each site from the origin, in sites."""
    along_x = (np.arange(shape[0]) + shape[0] // 2) % shape[0] - shape[0] // 2
    along_y = (np.arange(shape[1]) + shape[1] // 2) % shape[1] - shape[1] // 2
    return along_x[:, None], along_y[None, :]


@lru_cache(maxsize=64)
def separation_bins(shape: tuple[int, int], ratio: float = BIN_RATIO) -> Bins:
    """Logarithmic bins of the separation r = 1 ... L/2, in sites, on a periodic map."""
    edges = logarithmic_edges(1.0 - 1e-9, min(shape) / 2 * (1 + 1e-9), ratio)
    edges[-1] = min(shape) / 2 * (1 + 1e-9)
    return _bins(np.hypot(*separations(shape)), np.ones(shape[1]), edges)


def default_scales(shape: tuple[int, int], ratio: float = 1.25) -> Int[np.ndarray, " scale"]:
    """Whole scales 1 ... L/4, roughly equally spaced in their logarithm."""
    largest = max(min(shape) // 4, 1)
    steps = int(np.ceil(np.log(largest) / np.log(ratio))) if largest > 1 else 0
    return np.unique(np.round(np.geomspace(1, largest, steps + 1)).astype(int))
