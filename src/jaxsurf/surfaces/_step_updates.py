r"""One sweep of the single-step model under each of its three update schemes.

All three are the same move at different moments. A site is free if its four neighbours agree, on a
height n; it is then a local minimum (at n - 1) or a local maximum (at n + 1). The local rule picks
sites at random, raises a minimum with probability p and lowers a maximum with 1 - p: whatever the
site was, a picked free site is afterwards at n + 1 with probability p and at n - 1 with 1 - p.
Neighbours of neighbours do not disturb each other, so a whole sublattice can move at once.

`random_sequential` gives each site its own Poisson clock of rate 1, which picks sites in the same
order in law as N random picks, and runs the clocks in parallel by letting a site act once its tick
precedes every tick of its neighbours (conservative parallel simulation: Lubachevsky, J. Comput.
Phys. 75, 103 (1988); Korniss et al., Phys. Rev. Lett. 84, 1351 (2000)). Until the first tick M of a
neighbour nothing around the site changes, so of all its own ticks before M only the last one's coin
matters, and by memorylessness its next tick is M plus an Exp(1) time: both are drawn at once. No
approximation is made; two ticks at the same float32 instant, one pair in 10^7, are put in order of
sublattice.

Each function takes a key a surface, both sublattices `[surface, x, y/2]` and p `[surface, 1, 1]`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from jaxsurf.surfaces._site_streams import (
    Streams,
    coin_and_wait,
    next_words,
    random_words,
    seed_streams,
    uniform,
)

Sublattice = Int[Array, "surface x half"]
Times = Float[Array, "surface x half"]


class Lattice(NamedTuple):
    """Heights of the sites with x + y even and odd; site (x, y) is at column y // 2."""

    even: Sublattice
    odd: Sublattice


def split(heights: Int[Array, "surface x y"]) -> Lattice:
    """Take the two sublattices apart."""
    surfaces, lx, ly = heights.shape
    cells = heights.reshape(surfaces, lx // 2, 2, ly // 2, 2)
    even = jnp.stack([cells[:, :, 0, :, 0], cells[:, :, 1, :, 1]], 2)
    odd = jnp.stack([cells[:, :, 0, :, 1], cells[:, :, 1, :, 0]], 2)
    return Lattice(even.reshape(surfaces, lx, ly // 2), odd.reshape(surfaces, lx, ly // 2))


def join(lattice: Lattice) -> Int[Array, "surface x y"]:
    """Put the two sublattices together again: the inverse of `split`."""
    surfaces, lx, half = lattice.even.shape
    even, odd = (s.reshape(surfaces, lx // 2, 2, half) for s in lattice)
    rows = jnp.stack(
        [
            jnp.stack([even[:, :, 0], odd[:, :, 0]], -1),
            jnp.stack([odd[:, :, 1], even[:, :, 1]], -1),
        ],
        2,
    )
    return rows.reshape(surfaces, lx, 2 * half)


def neighbours(other: Array, is_odd: bool) -> tuple[Array, Array, Array, Array]:
    """What the four neighbours of each site of one sublattice hold, given the other sublattice."""
    row = jnp.arange(other.shape[-2])[None, :, None] % 2
    aside = jnp.where(row == int(is_odd), jnp.roll(other, 1, -1), jnp.roll(other, -1, -1))
    return jnp.roll(other, 1, -2), jnp.roll(other, -1, -2), other, aside


def _free(around: tuple[Array, Array, Array, Array]) -> Bool[Array, "surface x half"]:
    """Where the four neighbours agree."""
    return (around[0] == around[1]) & (around[1] == around[2]) & (around[2] == around[3])


def _moved(
    site: Sublattice, other: Sublattice, is_odd: bool, picked: Bool[Array, "..."] | bool, up: Array
) -> Sublattice:
    """Heights after the picked free sites have gone up or down."""
    around = neighbours(other, is_odd)
    step = jnp.where(up, jnp.int32(1), jnp.int32(-1))
    return jnp.where(_free(around) & picked, around[2] + step, site)


def sublattice(keys: Key[Array, " surface"], lattice: Lattice, p: Times) -> Lattice:
    """All sites of one sublattice at once, then all of the other."""
    shape = lattice.even.shape[1:]
    draws = random_words(keys, (2, *shape))
    up_even, up_odd = uniform(draws[:, 0]) < p, uniform(draws[:, 1]) < p
    even = _moved(lattice.even, lattice.odd, False, True, up_even)
    return Lattice(even, _moved(lattice.odd, even, True, True, up_odd))


def random_sequential(keys: Key[Array, " surface"], lattice: Lattice, p: Times) -> Lattice:
    """Each site at the ticks of its own Poisson clock, for one unit of time."""
    shape = lattice.even.shape[1:]
    streams = seed_streams(keys, (2, *shape))
    words, streams = next_words(streams)
    ticks = coin_and_wait(words, p[:, None])[1]
    halves = Streams(*(s[:, 0] for s in streams)), Streams(*(s[:, 1] for s in streams))

    def unfinished(carry):
        _, ticks, _ = carry
        return jnp.minimum(ticks[0].min(), ticks[1].min()) < 1

    def act(is_odd, site, other, tick, other_tick, streams):
        around = neighbours(other_tick, is_odd)
        first = jnp.minimum(jnp.minimum(around[0], around[1]), jnp.minimum(around[2], around[3]))
        quiet = jnp.minimum(first, jnp.float32(1.0))  # nothing nearby happens until then
        acts = (tick < quiet) if is_odd else ((tick <= quiet) & (tick < 1))
        words, streams = next_words(streams)
        up, wait = coin_and_wait(words, p)
        site = _moved(site, other, is_odd, acts, up)
        return site, jnp.where(acts, quiet + wait, tick), streams

    def round_of_acts(carry):
        (even, odd), (even_tick, odd_tick), (even_streams, odd_streams) = carry
        even, even_tick, even_streams = act(False, even, odd, even_tick, odd_tick, even_streams)
        odd, odd_tick, odd_streams = act(True, odd, even, odd_tick, even_tick, odd_streams)
        return Lattice(even, odd), (even_tick, odd_tick), (even_streams, odd_streams)

    start = (lattice, (ticks[:, 0], ticks[:, 1]), halves)
    return jax.lax.while_loop(unfinished, round_of_acts, start)[0]


CANDIDATES = 16  # sites tried at once by the paper's rule; about one in five is allowed


def paper(keys: Key[Array, " surface"], lattice: Lattice, p: Times) -> Lattice:
    """As many events as sites, one after the other: first the kind, then a site that allows it."""
    heights = join(lattice)
    surfaces, lx, ly = heights.shape
    surface = jnp.arange(surfaces)
    beside = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]

    def unfinished(carry):
        return jnp.any(carry[1] < lx * ly)

    def try_sites(carry):
        heights, events, raises, streams = carry
        words, streams = next_words(streams)
        x = (words[:, 1 : CANDIDATES + 1] % jnp.uint32(lx)).astype(jnp.int32)
        y = (words[:, CANDIDATES + 1 :] % jnp.uint32(ly)).astype(jnp.int32)
        sites = jnp.stack([(x + dx) % lx * ly + (y + dy) % ly for dx, dy in beside], -1)
        found = heights[surface[:, None, None], sites]
        step = jnp.where(raises, jnp.int32(1), jnp.int32(-1))
        allowed = (found[..., 1:] == (found[..., 0] + step[:, None])[..., None]).all(-1)
        best = allowed.argmax(1)
        happens = allowed.any(1) & (events < lx * ly)
        change = jnp.where(happens, 2 * step, jnp.int32(0))
        heights = heights.at[surface, sites[surface, best, 0]].add(change)
        # The kind of the next event; a kind once chosen waits for a site.
        raises = jnp.where(happens, uniform(words[:, 0]) < p[:, 0, 0], raises)
        return heights, events + happens.astype(jnp.int32), raises, streams

    streams = seed_streams(keys, (2 * CANDIDATES + 1,))
    words, streams = next_words(streams)
    raises = uniform(words[:, 0]) < p[:, 0, 0]
    events = jnp.zeros(surfaces, jnp.int32)
    flat = heights.reshape(surfaces, lx * ly)
    flat = jax.lax.while_loop(unfinished, try_sites, (flat, events, raises, streams))[0]
    return split(flat.reshape(surfaces, lx, ly))


SCHEMES = {"random-sequential": random_sequential, "paper": paper, "sublattice": sublattice}
