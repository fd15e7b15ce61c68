r"""The single-step model: integer heights whose nearest neighbours differ by exactly 1.

A local minimum may rise by 2 (deposition), a local maximum fall by 2 (evaporation). With $p_+$ the
chance of deposition, $p_+ = 1/2$ is an equilibrium surface (square ice, every allowed surface
equally likely): logarithmically rough, $S(q) \to 6/(\pi q^2)$, $D_2 \simeq (6/\pi^2) \ln r$. Any
other $p_+$ grows or shrinks, and belongs to the KPZ class ($\alpha \approx 0.39$, $z \approx 1.61$)
after a crossover that is slow near 1/2. Three update schemes, which agree at $p_+ = 1/2$:

- "random-sequential", the reference: sites are picked at random, a minimum rises with probability
  $p_+$, a maximum falls with $1 - p_+$. A sweep is one pick a site on average (Poisson clocks).
- "paper": first the kind of event, deposition with probability $p_+$, then a random site among
  those where it is allowed. Nothing is refused, so a sweep (one event a site) is several of the
  above; and since minima and maxima are not equally many, it is the local rule at a slightly other
  $p_+$. Events come one after the other, which is far slower to simulate.
- "sublattice": one sublattice at once, then the other. The fastest, and exact at $p_+ = 1/2$ only:
  elsewhere it changes local statistics (at $p_+ = 0.1$ the density of local minima is 0.257, not
  0.204) and amplitudes, not exponents.

The state is the heights; a step is a pure function of key and state, and sweep number k of a
surface takes its randomness from the key, the surface and k alone: a run cut in pieces, saved and
resumed, is the same run bit for bit.

Source: the paper's Sec. VI; P. Meakin, P. Ramanlal, L. M. Sander and R. C. Ball, Phys. Rev. A 34,
5091 (1986); M. Plischke, Z. Racz and D. Liu, Phys. Rev. B 35, 3485 (1987).
"""

import os
from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from jaxsurf._checks import (
    check_choice,
    check_in_range,
    check_integer,
    check_key,
    check_shape,
    is_traced,
)
from jaxsurf.surfaces._site_streams import random_words
from jaxsurf.surfaces._step_updates import SCHEMES, Lattice, join, split

#: Every how many sweeps to look, or the sweeps to look at.
Snapshots = int | Iterable[int] | Int[np.ndarray, " time"] | None


class SingleStep(eqx.Module):
    """Surfaces of the single-step model at one moment of their growth: a pytree.

    Attributes:
        heights: one surface, or a batch; nearest neighbours differ by 1.
        p_plus: the chance that an event is a deposition, one number a surface.
        sweeps: how many sweeps it has grown for.
        scheme: "random-sequential", "paper" or "sublattice".
    """

    heights: Int[Array, "*batch x y"]
    p_plus: Float[Array, "*batch"]
    sweeps: Int[Array, ""]
    scheme: str = eqx.field(static=True)

    def save(self, path: str | os.PathLike) -> None:
        """Write the state to an .npz file, from which `load_single_step` resumes bit for bit."""
        np.savez(
            path,
            heights=np.asarray(self.heights),
            p_plus=np.asarray(self.p_plus),
            sweeps=np.asarray(self.sweeps),
            scheme=np.asarray(self.scheme),
        )


def load_single_step(path: str | os.PathLike) -> SingleStep:
    """The state that `SingleStep.save` wrote.

    Arguments:
        path: the .npz file.

    Returns:
        A `SingleStep`; `run_single_step` with the key of the saved run continues that run.

    Raises:
        ValueError: a file that holds no single-step state.
    """
    with np.load(path) as file:
        if missing := {"heights", "p_plus", "sweeps", "scheme"} - set(file.files):
            raise ValueError(
                f"a saved single-step state must hold heights, p_plus, sweeps and scheme; {path} "
                f"lacks {sorted(missing)}. Pass a file that SingleStep.save wrote."
            )
        check_choice("scheme", str(file["scheme"]), SCHEMES)
        _check_step_surface(file["heights"])
        return SingleStep(
            jnp.asarray(file["heights"]),
            jnp.asarray(file["p_plus"]),
            jnp.asarray(file["sweeps"]),
            str(file["scheme"]),
        )


def init_single_step(
    shape: tuple[int, int],
    *,
    p_plus: float | int | Float[Array | np.ndarray, "*models"],
    batch: int | None = None,
    scheme: str = "random-sequential",
    start: str | Int[Array | np.ndarray, "*any x y"] = "flat",
    key: Key[Array, ""] | None = None,
) -> SingleStep:
    """The state before the first sweep.

    Arguments:
        shape: (Lx, Ly) in sites, both even.
        p_plus: chance of deposition in [0, 1]; an array simulates each of its values.
        batch: how many independent surfaces of each p_plus; None for one without a batch axis.
        scheme: "random-sequential", "paper" or "sublattice"; see the module.
        start: "flat", heights 0 and 1 in a checkerboard; "random", even sites at 0 and odd sites at
            +1 or -1 by a fair coin; or integer heights that broadcast to the batch.
        key: needed by start="random" only.

    Returns:
        A `SingleStep` with heights `[*models, batch, Lx, Ly]`.

    Raises:
        ValueError: p_plus outside [0, 1], an odd or tiny side, an unknown scheme, a start that is
            not a step surface or does not fit the shape.
        TypeError: start="random" without a key.
    """
    lx, ly = check_shape(shape)
    for side in (lx, ly):
        if side % 2:
            raise ValueError(
                f"both sides of a single-step surface must be even; got {(lx, ly)}. Around an odd "
                "periodic side steps of +1 and -1 cannot add up to zero: use an even side."
            )
    check_in_range("p_plus", p_plus, 0.0, 1.0, remedy="It is the probability of deposition.")
    check_choice("scheme", scheme, SCHEMES)
    models = jnp.asarray(p_plus, jnp.float32)
    leading = models.shape
    if batch is not None:
        leading += (check_integer("batch", batch, low=1, remedy="Pass None for a single surface."),)
        models = jnp.broadcast_to(models[..., None], leading)
    full = (*leading, lx, ly)
    odd = (np.arange(lx)[:, None] + np.arange(ly)[None, :]) % 2
    if not isinstance(start, str):
        _check_step_surface(start)
        try:
            heights = jnp.asarray(np.broadcast_to(np.asarray(start), full), jnp.int32)
        except ValueError as error:
            raise ValueError(
                f"start must broadcast to {full}; got shape {np.shape(start)}. "
                "Pass one surface, or one for each p_plus and member of the batch."
            ) from error
    elif start == "flat":
        heights = jnp.broadcast_to(jnp.asarray(odd, jnp.int32), full)
    elif start == "random":
        if key is None:
            raise TypeError('start="random" needs a key; got None. Pass key=jax.random.key(0).')
        check_key(key)
        keys = _surface_keys(jax.random.fold_in(key, _START), leading)
        coins = random_words(keys, (lx, ly)).reshape(full)
        coin = jnp.where(coins >> jnp.uint32(31) == 1, jnp.int32(1), jnp.int32(-1))
        heights = jnp.where(jnp.broadcast_to(jnp.asarray(odd == 1), full), coin, jnp.int32(0))
    else:
        raise ValueError(
            f'start must be "flat", "random" or heights; got {start!r}. Pass one of these.'
        )
    return SingleStep(heights, models, jnp.asarray(0, jnp.int32), scheme)


def step_single_step(key: Key[Array, ""], state: SingleStep) -> SingleStep:
    """One sweep: a pure function, to be jitted, vmapped or scanned.

    Arguments:
        key: the key of the whole run; the sweep's own randomness is folded from `state.sweeps`.
        state: the surfaces.

    Returns:
        The surfaces one sweep later.
    """
    keys = _surface_keys(key, state.p_plus.shape)
    lattice, p = _to_lattice(state)
    lattice = _sweep(keys, lattice, p, state.sweeps, state.scheme)
    return _from_lattice(state, lattice, state.sweeps + 1)


def run_single_step(
    key: Key[Array, ""],
    state: SingleStep,
    *,
    sweeps: int,
    snapshots: Snapshots = None,
    observe: Callable[[Int[Array, "*batch x y"]], Any] | None = None,
) -> tuple[SingleStep, Any]:
    """Grow for a number of sweeps, looking at the surfaces on the way.

    Only what `observe` returns is kept of a snapshot, so a long history costs no memory.

    Arguments:
        key: randomness; the same key continues a run that was saved, or cut in pieces.
        state: where to start.
        sweeps: how many sweeps to grow for, at least 1.
        snapshots: every how many sweeps to look, or the sweeps to look at, counted from this call's
            start, ascending; None for never. 0 is the start itself.
        observe: what to keep of the heights `[*batch, x, y]` at a snapshot, any pytree of arrays;
            None keeps the heights. Compiled with the run: pass the same function to run again fast.

    Returns:
        The state at the end, and what was kept, stacked along a leading axis (None without
        snapshots).

    Raises:
        ValueError: fewer than 1 sweep; snapshots below 0, beyond the run, or not ascending.
        TypeError: a key that is not a typed JAX key.
    """
    check_key(key)
    total = check_integer("sweeps", sweeps, low=1, remedy="Pass how long to grow.")
    times = _snapshot_times(snapshots, total)
    waits = np.diff(times, prepend=0, append=total).astype(np.int32)
    state, kept = _run(key, state, waits, observe)
    # The last stretch only leads to the end of the run.
    return state, (jax.tree.map(lambda x: x[:-1], kept) if len(times) else None)


def grow_single_step(
    shape: tuple[int, int],
    *,
    p_plus: float | int | Float[Array | np.ndarray, "*models"],
    sweeps: int,
    key: Key[Array, ""],
    scheme: str = "random-sequential",
    batch: int | None = None,
    start: str | Int[Array | np.ndarray, "*any x y"] = "flat",
    snapshots: Snapshots = None,
) -> Int[Array, "..."]:
    r"""Surfaces grown by the single-step model.

    $$h \to h + 2 \text{ at a local minimum with probability } p_+, \quad
      h \to h - 2 \text{ at a local maximum with probability } 1 - p_+$$

    Arguments:
        shape: (Lx, Ly) in sites, both even.
        p_plus: chance of deposition in [0, 1]; an array grows surfaces for each of its values.
        sweeps: how long to grow, in updates a site.
        key: randomness; surface i is the same whatever the batch.
        scheme: "random-sequential", "paper" or "sublattice"; see the module.
        batch: how many independent surfaces of each p_plus; None for one without a batch axis.
        start: "flat", "random", or integer heights.
        snapshots: every how many sweeps, or at which sweeps, to keep the heights; None for the end
            only.

    Returns:
        Integer heights `[*models, batch, Lx, Ly]` at the end of the run; with snapshots, those at
        the snapshots, `[snapshot, *models, batch, Lx, Ly]`.

    Raises:
        ValueError: p_plus outside [0, 1], an odd or tiny side, fewer than 1 sweep, an unknown
            scheme, a start that is not a step surface, snapshots beyond the run.
        TypeError: a key that is not a typed JAX key.

    Source: the paper's Sec. VI A.

    >>> import jax, jaxsurf as js
    >>> h = js.grow_single_step((16, 16), p_plus=0.1, sweeps=20, key=jax.random.key(0), batch=3)
    >>> h.shape, int(abs(h[:, 1:] - h[:, :-1]).min()), int(abs(h[:, 1:] - h[:, :-1]).max())
    ((3, 16, 16), 1, 1)
    """
    check_key(key)
    state = init_single_step(shape, p_plus=p_plus, batch=batch, scheme=scheme, start=start, key=key)
    state, kept = run_single_step(key, state, sweeps=sweeps, snapshots=snapshots)
    return state.heights if snapshots is None else kept


_START, _SWEEPS = 0, 1  # names of the two uses of a surface's key


def _surface_keys(key: Key[Array, ""], leading: tuple[int, ...]) -> Key[Array, " surface"]:
    """One key a surface: its index along each leading axis folded in, one axis after the other."""
    keys = key[None]
    for size in leading:
        fold = jax.vmap(jax.vmap(jax.random.fold_in, (None, 0)), (0, None))
        keys = fold(keys, jnp.arange(size)).reshape(-1)
    return keys


def _to_lattice(state: SingleStep) -> tuple[Lattice, Float[Array, "surface 1 1"]]:
    return split(state.heights.reshape(-1, *state.heights.shape[-2:])), state.p_plus.reshape(
        -1, 1, 1
    )


def _from_lattice(state: SingleStep, lattice: Lattice, sweeps: Int[Array, ""]) -> SingleStep:
    heights = join(lattice).reshape(state.heights.shape)
    return SingleStep(heights, state.p_plus, sweeps, state.scheme)


def _sweep(keys, lattice, p, number, scheme):
    keys = jax.vmap(lambda key: jax.random.fold_in(jax.random.fold_in(key, _SWEEPS), number))(keys)
    return SCHEMES[scheme](keys, lattice, p)


@eqx.filter_jit
def _run(key, state, waits, observe):
    keys = _surface_keys(key, state.p_plus.shape)
    lattice, p = _to_lattice(state)

    def grow_and_look(carry, sweeps):
        lattice, number = carry

        def sweep(i, now):
            return _sweep(keys, now, p, number + i, state.scheme)

        lattice = jax.lax.fori_loop(0, sweeps, sweep, lattice)
        heights = _from_lattice(state, lattice, number).heights
        return (lattice, number + sweeps), heights if observe is None else observe(heights)

    carry, kept = jax.lax.scan(grow_and_look, (lattice, state.sweeps), jnp.asarray(waits))
    return _from_lattice(state, *carry), kept


def _snapshot_times(snapshots: Snapshots, total: int) -> Int[np.ndarray, " time"]:
    if snapshots is None:
        return np.zeros(0, int)
    if isinstance(snapshots, int | np.integer):
        every = check_integer("snapshots", snapshots, low=1, remedy="Pass an interval in sweeps.")
        times = np.arange(every, total + 1, every)
        if not len(times):
            raise ValueError(
                f"snapshots every {every} sweeps lie beyond the run of {total}. "
                "Pass a shorter interval."
            )
        return times
    times = np.asarray(list(snapshots))
    if not len(times) or times.dtype.kind not in "iu" or np.any(np.diff(times) <= 0):
        raise ValueError(
            f"snapshots must be whole sweeps in ascending order; got {times.tolist()}. "
            "Pass e.g. [1, 2, 4, 8]."
        )
    if times[0] < 0 or times[-1] > total:
        raise ValueError(
            f"snapshots must lie within the run, 0 to {total} sweeps; got {times.tolist()}. "
            "Grow for longer, or leave out the late ones."
        )
    return times


def _check_step_surface(heights: Any) -> None:
    """Raise unless all nearest neighbours, across the periodic edges too, differ by exactly 1."""
    if is_traced(heights):
        return
    values = np.asarray(heights)
    if values.dtype.kind not in "iu" or values.ndim < 2:
        raise ValueError(
            f"a step surface must be integer heights [..., x, y]; got {values.dtype} of shape "
            f"{values.shape}. Round them, and pass whole maps."
        )
    values = values.astype(np.int64)
    wrong = sum(int(np.sum(np.abs(values - np.roll(values, 1, axis)) != 1)) for axis in (-2, -1))
    if wrong:
        raise ValueError(
            f"nearest neighbours of a step surface must differ by exactly 1, across the periodic "
            f'edges too; got {wrong} that do not. Use start="flat" or "random".'
        )
