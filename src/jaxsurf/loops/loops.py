"""Loops: the contour loops found on a set of surfaces, one entry a loop.

How loops were sampled decides what an average over them means, so the container remembers it.
Loops through random points (`sampling="points"`, Appendix C) come in proportion to their length and
to the inverse of the gradient along them; whole level sets (`sampling="levels"`) hold each loop
once. Exponents are the same, amplitudes are not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

if TYPE_CHECKING:
    from jaxsurf.curve import Curve


_PER_LOOP = ("length", "radius", "area", "winding", "is_open", "surface", "level", "weight")
_PER_SURFACE = ("pairs", "level_sets", "plaquettes", "valid")


@dataclass(frozen=True, repr=False)
class Loops:
    """Contour loops of one or more surfaces.

    Lengths are in sites and areas in sites squared, as whole numbers; `spacing` turns them into
    units of length, and the curves are in those units.

    Attributes:
        length: steps of the loop, an even number of at least 4; for an open loop, the steps to the
            edge.
        radius: the larger side of the smallest box around the unwrapped loop; 0 for loops that
            wind, which no box holds.
        area: enclosed area, positive around a hill and negative around a pit; 0 for loops that wind
            or are open, which enclose none.
        winding: times the loop winds around a periodic map along x and y.
        is_open: whether the loop runs into the edge of an open map or an invalid site.
        surface: number of the surface, 0 ... surfaces - 1.
        level: height of the loop.
        surfaces: how many surfaces were searched.
        shape: sites of each map.
        spacing: lattice constant.
        weight: what the loop stands for. Of loops through points, the range of heights of the
            start's plaquette times its strands; of level sets, the interval of height its level
            stands for; of levels through points, how many of those points are on it.
        sampling: "points", "levels" or "levels through points".
        boundary: "periodic" or "open".
        pairs: points at distance [r, r + 1) of the start, summed over the closed loops of each
            surface, r = 0 left out; None if they were not counted.
        redrawn: starting points drawn again because a height coincided with the level.
        notes: what was done to the heights, in words.
        centroid: mean position of the loop's points, in units of length; None for traced loops.
        vertices: plaquettes passed by each loop, end to end and unwrapped; None if not kept.
        level_sets: of whole level sets, how many of each surface were searched.
        plaquettes: of whole level sets, how many valid plaquettes each surface has.
        valid: of whole level sets of masked maps, which plaquettes were searched.
    """

    length: Int[np.ndarray, " loop"]
    radius: Int[np.ndarray, " loop"]
    area: Int[np.ndarray, " loop"]
    winding: Int[np.ndarray, "loop 2"]
    is_open: Bool[np.ndarray, " loop"]
    surface: Int[np.ndarray, " loop"]
    level: Float[np.ndarray, " loop"]
    weight: Float[np.ndarray, " loop"]
    surfaces: int
    shape: tuple[int, int]
    spacing: float = 1.0
    sampling: str = "points"
    boundary: str = "periodic"
    pairs: Int[np.ndarray, "surface r"] | None = None
    redrawn: int = 0
    notes: tuple[str, ...] = field(default=())
    centroid: Float[np.ndarray, "loop 2"] | None = None
    vertices: Int[np.ndarray, "point 2"] | None = None
    level_sets: Int[np.ndarray, " surface"] | None = None
    plaquettes: Int[np.ndarray, " surface"] | None = None
    valid: Bool[np.ndarray, "surface x y"] | None = None

    @property
    def closed(self) -> Bool[np.ndarray, " loop"]:
        """Loops that neither wind nor are open: those the statistics are taken over."""
        return ~(self.is_open | self.winding.any(1))

    @property
    def share_winding(self) -> float:
        """The share of loops left out because they wind around the map."""
        return float(np.mean(self.winding.any(1))) if len(self) else 0.0

    @property
    def share_open(self) -> float:
        """The share of loops left out because they run into an edge."""
        return float(np.mean(self.is_open)) if len(self) else 0.0

    def select(self, which: Bool[np.ndarray, " loop"] | Int[np.ndarray, " chosen"]) -> "Loops":
        """Some of the loops, by a boolean or index array; G(r) cannot be split and is dropped."""
        chosen = np.arange(len(self))[which]
        kept = {name: getattr(self, name)[chosen] for name in _PER_LOOP}
        if self.centroid is not None:
            kept["centroid"] = self.centroid[chosen]
        if self.vertices is not None:
            length = self.length[chosen]
            begin = np.repeat((np.cumsum(self.length) - self.length)[chosen], length)
            within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
            kept["vertices"] = self.vertices[begin + within]
        return replace(self, pairs=None, **kept)

    def path(self, index: int | np.integer) -> Float[np.ndarray, "point 2"]:
        """The points of one loop in order, in units of length, unwrapped; the first one repeated.

        Site (i, j) of the map is at (i, j) times the spacing; a loop runs through the centres of
        plaquettes. The repeated point of a winding loop is a period away, and pieces of open loops
        have none.

        Raises:
            ValueError: paths were not kept.
        """
        if self.vertices is None:
            raise ValueError(
                "path needs the points of each loop; these loops have none. "
                "Call level_loops with paths=True."
            )
        begin = int(self.length[:index].sum())
        points = self.vertices[begin : begin + int(self.length[index])]
        if not self.is_open[index]:
            closing = points[:1] + self.winding[index] * np.array(self.shape)
            points = np.concatenate([points, closing])
        return (points + 0.5) * self.spacing

    @staticmethod
    def join(parts: "Sequence[Loops]") -> "Loops":
        """The loops of several sets of surfaces of one shape, traced in one way.

        Surfaces are numbered on, in the order of the parts.

        Raises:
            ValueError: no parts, or parts of different shape, spacing, sampling or boundary.
        """
        if not parts:
            raise ValueError("parts must not be empty; got []. Pass the loops to join.")
        first = parts[0]
        if len(parts) == 1:
            return first
        for other in parts[1:]:
            for name in ("shape", "spacing", "sampling", "boundary"):
                if getattr(other, name) != getattr(first, name):
                    raise ValueError(
                        f"loops to join must share {name}; got {getattr(first, name)!r} and "
                        f"{getattr(other, name)!r}. Join only loops traced in one way."
                    )
        offset = np.cumsum([0] + [p.surfaces for p in parts[:-1]])
        numbers = [p.surface + start for p, start in zip(parts, offset, strict=True)]
        return replace(
            Loops.together(parts),
            **{name: _joined(parts, name) for name in _PER_SURFACE},
            surface=np.concatenate(numbers),
            surfaces=sum(p.surfaces for p in parts),
            redrawn=sum(p.redrawn for p in parts),
            notes=tuple(dict.fromkeys(note for p in parts for note in p.notes)),
        )

    @staticmethod
    def together(parts: "Sequence[Loops]") -> "Loops":
        """The loops of several level sets of the same surfaces."""
        if len(parts) == 1:
            return parts[0]
        names = (*_PER_LOOP, "centroid", "vertices")
        return replace(parts[0], **{name: _joined(parts, name) for name in names})

    def mean_length(self, **options: object) -> "Curve":
        """Mean length of loops of radius R; see `jaxsurf.loops.statistics.mean_length`."""
        from jaxsurf.loops import statistics

        return statistics.mean_length(self, **options)  # pyright: ignore[reportArgumentType]

    def length_tail(self, **options: object) -> "Curve":
        """Share of loops longer than s; see `jaxsurf.loops.statistics.length_tail`."""
        from jaxsurf.loops import statistics

        return statistics.length_tail(self, **options)  # pyright: ignore[reportArgumentType]

    def correlation(self, **options: object) -> "Curve":
        """Chance that a site at distance r is on the loop.

        From the pairs counted along traced loops, see `statistics.correlation`, or from all pairs
        of whole level sets, see `pairs.all_pairs_correlation`.
        """
        from jaxsurf.loops import pairs, statistics

        if self.sampling == "points":
            return statistics.correlation(self, **options)  # pyright: ignore[reportArgumentType]
        return pairs.all_pairs_correlation(self, **options)  # pyright: ignore[reportArgumentType]

    def __len__(self) -> int:
        return len(self.length)

    def __repr__(self) -> str:
        return f"Loops({', '.join(f'{name} {value}' for name, value in self._summary())})"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{n}</th><td>{v}</td></tr>" for n, v in self._summary())
        return f"<table><caption>Loops</caption><tbody>{rows}</tbody></table>"

    def _summary(self) -> list[tuple[str, str]]:
        how = {"points": "through random points", "levels": "of whole level sets"}.get(
            self.sampling, "of the level sets through random points"
        )
        closed = self.closed
        said = [
            ("loops", f"{len(self)} {how}"),
            ("surfaces", f"{self.surfaces} of {self.shape[0]} x {self.shape[1]} {self.boundary}"),
            ("winding", f"{100 * self.share_winding:.2g} %"),
        ]
        if self.is_open.any():
            said.append(("open", f"{100 * self.share_open:.2g} %"))
        if closed.any():
            length, radius = self.length[closed], self.radius[closed]
            said.append(("length", f"{length.min()}...{length.max()}"))
            said.append(("radius", f"{radius.min()}...{radius.max()}"))
        if self.redrawn:
            said.append(("starts redrawn", str(self.redrawn)))
        return said + [("note", note) for note in self.notes]


def _joined(parts: "Sequence[Loops]", name: str) -> np.ndarray | None:
    """One array of all parts end to end; None if any of them lacks it."""
    arrays = [getattr(p, name) for p in parts]
    if len(arrays) == 1:
        return arrays[0]
    return None if any(each is None for each in arrays) else np.concatenate(arrays)
