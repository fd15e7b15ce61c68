r"""The band in which a measured spectrum leaves the true one.

For Gaussian heights the real and imaginary parts of every mode are independent normals, so that
$2 |\tilde h(q)|^2 / \langle|\tilde h(q)|^2\rangle$ is $\chi^2$ with two degrees of freedom, and the
mean over a ring of n modes (mirror images counted, which are not independent) and N surfaces is
$\chi^2_{nN} / (nN)$ times the true S. The interval is exact for a single mode and needs no second
surface.

Windows and masks blur the modes into each other, and neighbouring lines of one map are correlated:
there fewer values are independent than are counted, and the band is too narrow.

Source: D. B. Percival and A. T. Walden, Spectral Analysis for Physical Applications (1993), 6.6.
"""

import numpy as np
from jaxtyping import Float

from jaxsurf._checks import check_in_range
from jaxsurf.curve import Curve

SPECTRA = ("spectrum", "directional_spectrum", "line_spectrum")


def spectrum_band(
    spectrum: Curve, level: float = 0.95
) -> tuple[Float[np.ndarray, " scale"], Float[np.ndarray, " scale"]]:
    r"""Confidence interval of each point of a spectrum of Gaussian heights.

    $$\nu \bar S / \chi^2_{\nu,(1 + p)/2} \le S \le \nu \bar S / \chi^2_{\nu,(1 - p)/2}$$

    Arguments:
        spectrum: what `power_spectrum`, `directional_spectrum` or `line_spectrum` returned.
        level: the probability p that the interval holds the true value, at each point by itself.

    Returns:
        The lower and the upper ends, in the spectrum's unit; nu is the curve's count of modes.

    Raises:
        ValueError: a curve that is no spectrum, a level outside (0, 1).

    Source: Percival and Walden, Sec. 6.6.

    >>> import jax
    >>> from jaxsurf.measures.fourier import power_spectrum
    >>> low, high = spectrum_band(power_spectrum(jax.random.normal(jax.random.key(0), (64, 64))))
    >>> bool(low[-1] < 1 < high[-1])
    True
    """
    if spectrum.kind not in SPECTRA:
        raise ValueError(
            f"spectrum must be of a kind among {list(SPECTRA)}; got {spectrum.kind!r}. "
            "Other curves have errors over surfaces: Curve.stderr."
        )
    check_in_range("level", level, 0, 1, closed=(False, False), remedy="Pass 0.95 for 95 %.")
    freedom = np.asarray(spectrum.count, float)
    total = freedom * np.asarray(spectrum.mean, float)
    from scipy.special import chdtri  # a fifth of a second that `import jaxsurf` can spare

    return total / chdtri(freedom, (1 - level) / 2), total / chdtri(freedom, (1 + level) / 2)
