"""HeightMap: heights with the spacing, units and source that give them a meaning.

An instrument or a file knows more than an array of numbers. What is known is kept beside the
heights from reading to the axis labels of a picture; what is not known is said to be in sites and
unit heights.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Real


@dataclass(frozen=True, eq=False)
class HeightMap:
    """One height map.

    Attributes:
        heights: `[x, y]` in `height_unit`; NaN where a pixel is missing.
        spacing: distance between neighbouring sites, in `length_unit`.
        length_unit: unit of the spacing; "sites" if unknown.
        height_unit: unit of the heights; "1" if unknown.
        source: where it came from, for captions.

    Raises:
        TypeError: heights that are not real numbers.
        ValueError: heights that are not a map, or a spacing that is not positive.

    >>> HeightMap(np.zeros((4, 6)), spacing=0.5, length_unit="nm")
    HeightMap(4 x 6 sites of 0.5 nm, heights in 1)
    """

    heights: Real[np.ndarray, "x y"]
    spacing: float = 1.0
    length_unit: str = "sites"
    height_unit: str = "1"
    source: str = ""

    def __post_init__(self):
        if self.heights.dtype.kind not in "iuf":
            raise TypeError(
                f"heights must be real numbers; got dtype {self.heights.dtype}. "
                "Pass the real part, or the modulus, of complex data."
            )
        if self.heights.ndim != 2 or min(self.heights.shape) < 4:
            raise ValueError(
                f"heights must be a map of at least 4 x 4 sites; got shape {self.heights.shape}. "
                "Pass one two-dimensional array."
            )
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise ValueError(
                f"spacing must be positive and finite; got {self.spacing}. "
                "Pass the distance between neighbouring sites, 1.0 if it is unknown."
            )

    @property
    def valid(self) -> Bool[np.ndarray, "x y"]:
        """True where a height was measured."""
        return np.isfinite(self.heights)

    def with_heights(self, heights: Float[np.ndarray, "x y"]) -> "HeightMap":
        """The same map with other heights: levelled, filtered or cropped ones."""
        return replace(self, heights=heights)

    def __repr__(self) -> str:
        rows, columns = self.heights.shape
        gone = int((~self.valid).sum())
        text = f"HeightMap({rows} x {columns} sites of {self.spacing:g} {self.length_unit}, "
        text += f"heights in {self.height_unit}"
        text += f", {gone} missing" if gone else ""
        return text + (f", from {self.source})" if self.source else ")")

    def _repr_html_(self) -> str:
        finite = self.heights[self.valid]
        facts = {
            "size": " x ".join(f"{n * self.spacing:g}" for n in self.heights.shape)
            + f" {self.length_unit}",
            "sites": " x ".join(map(str, self.heights.shape)),
            "missing": str(self.heights.size - finite.size),
            "rms height": f"{finite.std():.4g} {self.height_unit}" if finite.size else "none",
            "source": self.source or "unknown",
        }
        rows = "".join(f"<tr><th>{name}</th><td>{fact}</td></tr>" for name, fact in facts.items())
        return f"<table>{rows}</table>"
