r"""What a collapse is fitted to: the logarithms of all curves, stacked, with their covariance.

Surfaces of different sizes are independent; curves of different measures at one size are taken to
come from the same surfaces, row by row, if they have the same number of them, and their covariance
is then kept. $\ln \bar y$ is biased by $-\sigma^2/2\bar y^2$, which is put right.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsurf.curve import Curve
from jaxsurf.fitting._resample import pulls, shrunk_covariance

#: A point with a larger relative error has no useful logarithm.
LARGEST_ERROR = 0.2
#: Neighbouring points of a curve closer than this ratio say nearly the same thing.
SPARSEST = 1.4

Limits = tuple[float | int, float | int]
Window = Limits | Callable[[Curve, float], Limits] | None


@dataclass(frozen=True)
class Block:
    """Curves from one set of surfaces, and where their points stand in the stack."""

    curves: tuple[Curve, ...]
    rows: Int[np.ndarray, " point"]
    covariance: Float[np.ndarray, "point point"]


@dataclass(frozen=True)
class Stack:
    """All points of a collapse, one after the other.

    Attributes:
        x: scales.
        log_y: logarithms of the means.
        size: L (or t) of each point.
        measure: which measure each point belongs to.
        blocks: the groups of points whose errors are correlated.
    """

    x: Float[np.ndarray, " point"]
    log_y: Float[np.ndarray, " point"]
    size: Float[np.ndarray, " point"]
    measure: Int[np.ndarray, " point"]
    blocks: tuple[Block, ...]

    def stderr(self) -> Float[np.ndarray, " point"]:
        """Standard errors of `log_y`."""
        errors = np.zeros(len(self.x))
        for block in self.blocks:
            errors[block.rows] = np.sqrt(np.diag(block.covariance))
        return errors

    def whitening(
        self, use: Bool[np.ndarray, " point"], slope: Float[np.ndarray, " point"]
    ) -> Float[np.ndarray, "point point"]:
        """The matrix that makes the errors of the points in use independent and of size one.

        Arguments:
            use: points to keep; the rows of the others are zero.
            slope: d ln Y / d ln y of each point.
        """
        matrix = np.zeros((len(self.x), len(self.x)))
        for block in self.blocks:
            kept = use[block.rows]
            rows = block.rows[kept]
            if len(rows):
                scaled = block.covariance[np.ix_(kept, kept)] * np.outer(slope[rows], slope[rows])
                matrix[np.ix_(rows, rows)] = np.linalg.inv(np.linalg.cholesky(scaled))
        return matrix

    def position(self) -> Float[np.ndarray, " point"]:
        """Where each point stands in its curve: 0 at its smallest scale, 1 at its largest."""
        position = np.zeros(len(self.x))
        for block in self.blocks:
            for measure in np.unique(self.measure[block.rows]):
                rows = block.rows[self.measure[block.rows] == measure]
                log = np.log(self.x[rows])
                position[rows] = (log - log.min()) / np.ptp(log)
        return position

    def bootstrap(self, draws: int, rng: np.random.Generator) -> Iterator["Stack"]:
        """Stacks of surfaces drawn again, each with the covariance its own surfaces show.

        Fitting a draw with the covariance of the data would hide that the covariance, too, is known
        from these surfaces only: errors would come out too small by a half with 25 surfaces.
        """
        for _ in range(draws):
            log_y, blocks = self.log_y.copy(), []
            for block in self.blocks:
                surfaces = block.curves[0].surfaces
                rows = rng.integers(surfaces, size=surfaces)
                curves = tuple(curve.resample(rows) for curve in block.curves)
                shift, covariance = self._drawn(block, curves)
                if len(np.unique(rows)) < 3:  # of two surfaces every correlation is +-1
                    covariance = block.covariance
                log_y[block.rows] += shift * np.sqrt(surfaces / max(surfaces - 3, 1))
                blocks.append(Block(block.curves, block.rows, covariance))
            yield Stack(self.x, log_y, self.size, self.measure, tuple(blocks))

    def _drawn(self, block: Block, curves: tuple[Curve, ...]) -> tuple[np.ndarray, np.ndarray]:
        """How far the logarithms moved in a draw, and their covariance in it."""
        before, after = (
            np.concatenate([np.asarray(curve.mean, float) for curve in group])
            for group in (block.curves, curves)
        )
        usable = after > 0  # a point that a draw misses altogether stays where it was
        after = np.where(usable, after, before)
        relative = np.concatenate([pulls(curve) for curve in curves], 1) / after
        spread = np.sqrt((relative**2).sum(0))
        usable &= spread > 0
        if not usable.all():
            old = np.concatenate([pulls(curve) for curve in block.curves], 1) / before
            relative = np.where(usable, relative, old)
        return np.log(after / before), shrunk_covariance(relative)[0]


def stack_curves(measures: Sequence[Mapping[float, Curve]], window: Window) -> Stack:
    """Select, thin and stack the curves of every measure and size.

    Raises:
        ValueError: a curve with too few surfaces or no usable points, named by kind and size.
    """
    groups: dict[tuple[float, int], list[tuple[int, Curve]]] = {}
    for index, curves in enumerate(measures):
        for size, curve in sorted(curves.items()):
            usable = _usable(curve, float(size), window)
            groups.setdefault((float(size), curve.surfaces), []).append((index, usable))
    x, log_y, sizes, measure, blocks, first = [], [], [], [], [], 0
    for (size, _), members in groups.items():
        curves = tuple(curve for _, curve in members)
        mean = np.concatenate([np.asarray(curve.mean, float) for curve in curves])
        relative = np.concatenate([pulls(curve) for curve in curves], 1) / mean
        covariance, _ = shrunk_covariance(relative)
        rows = first + np.arange(len(mean))
        first += len(mean)
        blocks.append(Block(curves, rows, covariance))
        x.append(np.concatenate([np.asarray(curve.scale, float) for curve in curves]))
        log_y.append(np.log(mean) + (relative**2).sum(0) / 2)
        sizes.append(np.full(len(mean), size))
        measure.append(np.concatenate([np.full(len(c.scale), i) for i, c in members]))
    return Stack(
        np.concatenate(x),
        np.concatenate(log_y),
        np.concatenate(sizes),
        np.concatenate(measure),
        tuple(blocks),
    )


def systematic_errors(
    variants: Sequence[tuple[str, Any, Any]], names: tuple[str, ...], best: Any
) -> dict[str, float]:
    """Largest shift of a refit with one choice changed, less what chance shifts it by.

    Arguments:
        variants: (choice, values, variance beyond that of the best fit) of each refit. A refit to
            part of the data has the larger variance, and the difference between the two fits has
            the difference of the variances (Hausman 1978).
        names: the parameters.
        best: values of the fit to all data.
    """
    if not variants:
        return {}
    excess = [np.clip((values - best) ** 2 - more, 0.0, None) for _, values, more in variants]
    return dict(zip(names, np.sqrt(np.max(excess, 0)).tolist(), strict=True))


def _usable(curve: Curve, size: float, window: Window) -> Curve:
    if curve.surfaces < 3:
        raise ValueError(
            f"each curve needs at least 3 surfaces for its covariance; got {curve.surfaces} for "
            f"{curve.kind} at {size:g}. Measure more surfaces, or cut the map into parts."
        )
    low, high = window(curve, size) if callable(window) else window or (-np.inf, np.inf)
    scale, mean = np.asarray(curve.scale, float), np.asarray(curve.mean, float)
    inside = (scale >= low) & (scale <= high) & (scale > 0) & (mean > 0)
    spread = np.asarray(curve.stderr, float)
    inside &= (spread > 0) & (spread <= LARGEST_ERROR * mean)
    kept, last = [], -np.inf
    for point in np.flatnonzero(inside):
        if np.log(scale[point]) >= last + np.log(SPARSEST) - 1e-9:
            kept.append(point)
            last = np.log(scale[point])
    if len(kept) < 3:
        raise ValueError(
            f"each curve needs at least 3 points with an error below {LARGEST_ERROR:.0%}; got "
            f"{len(kept)} for {curve.kind} at {size:g} in the window ({low:g}, {high:g}). "
            "Widen the window, add surfaces or leave this size out."
        )
    samples, weights = np.asarray(curve.samples, float), np.asarray(curve.weights, float)
    return Curve(
        curve.kind,
        scale[kept],
        samples[:, kept],
        weights[:, kept],
        units=curve.units,
        details=curve.details,
    )
