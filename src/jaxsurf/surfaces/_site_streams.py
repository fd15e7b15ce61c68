"""One fast random stream a site, seeded from a JAX key.

Growth needs about ten random words a site and sweep, most of them in vector lanes that then do
nothing. A cryptographic generator for each would take nearly all the time, so the key's own
generator seeds, at every sweep anew, one xoroshiro64** generator a site, which is asked for a few
words and thrown away.

Source: D. Blackman and S. Vigna, Scrambled linear pseudorandom number generators, ACM Trans. Math.
Softw. 47, 36 (2021).
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, UInt32

Words = UInt32[Array, "..."]


class Streams(NamedTuple):
    """The two words of state of one xoroshiro64** generator a site."""

    first: Words
    second: Words


def seed_streams(keys: Key[Array, " surface"], shape: tuple[int, ...]) -> Streams:
    """Independent streams `[surface, *shape]`, those of one surface from its own key."""
    words = random_words(keys, (2, *shape))
    return Streams(words[:, 0], words[:, 1])


def random_words(keys: Key[Array, " surface"], shape: tuple[int, ...]) -> Words:
    """Random 32-bit words `[surface, *shape]`, those of one surface from its own key.

    Drawn in a row and then folded up: XLA compiles threefry over a flat array ten times faster.
    """
    count = math.prod(shape)
    rows = jax.vmap(lambda key: jax.random.bits(key, (count,), jnp.uint32))(keys)
    return rows.reshape(-1, *shape)


def next_words(streams: Streams) -> tuple[Words, Streams]:
    """One random 32-bit word from each stream, and the streams after it."""
    first, second = streams
    word = _rotate(first * jnp.uint32(0x9E3779BB), 5) * jnp.uint32(5)
    second = second ^ first
    mixed = _rotate(first, 26) ^ second ^ (second << jnp.uint32(9))
    return word, Streams(mixed, _rotate(second, 13))


def uniform(words: Words) -> Float[Array, "..."]:
    """Uniform numbers in [0, 1), multiples of 2^-24."""
    return (words >> jnp.uint32(8)).astype(jnp.float32) * jnp.float32(2.0**-24)


def coin_and_wait(
    words: Words, probability: Float[Array, "..."]
) -> tuple[Bool[Array, "..."], Float[Array, "..."]]:
    """From each word a coin with the given probability and, independently, an Exp(1) waiting time.

    Which side of `probability` a uniform number falls on is the coin; where on that side is again
    uniform, and gives the time.
    """
    number = uniform(words)
    coin = number < probability
    low = jnp.where(coin, jnp.float32(0.0), probability)
    width = jnp.where(coin, probability, 1 - probability)
    return coin, -jnp.log(1 - (number - low) / width)


def _rotate(words: Words, by: int) -> Words:
    return (words << jnp.uint32(by)) | (words >> jnp.uint32(32 - by))
