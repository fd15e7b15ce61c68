"""The single-step model: exact moves, exact laws of a small lattice, then equilibrium and KPZ."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

import jaxsurf as js
from jaxsurf.analysis.snapshots import pool_snapshots
from jaxsurf.surfaces import _step_updates as updates

SCHEMES = ["random-sequential", "paper", "sublattice"]


def around(heights):
    """The heights of the four neighbours, on a new first axis."""
    h = np.asarray(heights)
    return np.stack([np.roll(h, shift, axis) for axis in (-2, -1) for shift in (1, -1)])


def is_step_surface(heights):
    return bool(np.all(np.abs(around(heights) - np.asarray(heights)) == 1))


def minima(heights):
    """Share of local minima on each surface."""
    return np.all(around(heights) == np.asarray(heights) + 1, 0).mean((-2, -1))


def maxima(heights):
    return minima(-np.asarray(heights))


def variance(heights):
    return np.asarray(heights).astype(float).var((-2, -1))


def height_correlation(heights, r):
    h = np.asarray(heights).astype(float)
    return np.mean([((h - np.roll(h, r, axis)) ** 2).mean((-2, -1)) for axis in (-2, -1)], 0)


def skewness(heights):
    h = np.asarray(heights).astype(float)
    h = h - h.mean((-2, -1), keepdims=True)
    return (h**3).mean((-2, -1)) / (h**2).mean((-2, -1)) ** 1.5


def pull(values, expected):
    """How many standard errors the mean of independent values lies from what is expected."""
    values = np.asarray(values)
    return (values.mean() - expected) / (values.std(ddof=1) / np.sqrt(values.size))


# --- exact ---------------------------------------------------------------------------------------


def test_sublattices_come_apart_and_together():
    h = jnp.arange(2 * 6 * 8, dtype=jnp.int32).reshape(2, 6, 8)
    apart = updates.split(h)
    x, y = np.indices((6, 8))
    np.testing.assert_array_equal(
        np.sort(np.ravel(apart.even)), np.sort(np.asarray(h)[:, (x + y) % 2 == 0].ravel())
    )
    np.testing.assert_array_equal(updates.join(apart), h)
    by_roll = [updates.split(jnp.asarray(n)) for n in around(h)]
    for is_odd in (False, True):
        found = np.stack(updates.neighbours(apart[1 - is_odd], is_odd))
        expected = np.stack([n[int(is_odd)] for n in by_roll])
        np.testing.assert_array_equal(np.sort(found, 0), np.sort(expected, 0))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("start", ["flat", "random"])
def test_stays_a_step_surface(scheme, start):
    grown = js.grow_single_step(
        (10, 6),
        p_plus=np.array([0.0, 0.3, 1.0]),
        sweeps=60,
        scheme=scheme,
        batch=4,
        start=start,
        snapshots=[0, 1, 2, 30, 60],
        key=jax.random.key(3),
    )
    assert grown.shape == (5, 3, 4, 10, 6)
    assert is_step_surface(grown)
    assert not is_step_surface(np.asarray(grown) * 2)  # the control: the check can fail
    change = np.diff(np.asarray(grown), axis=0)
    assert np.all(change % 2 == 0)
    assert np.all(change[:, 0] <= 0)  # p_plus = 0 only evaporates
    assert np.all(change[:, 2] >= 0)  # p_plus = 1 only deposits
    assert np.all(change[1:, :, :, 0, 0].any(0).any(-1))  # and every model moves


def test_sublattice_updates_at_p_one_raise_the_flat_surface_by_two_a_sweep():
    grown = js.grow_single_step(
        (6, 8), p_plus=1.0, sweeps=5, scheme="sublattice", key=jax.random.key(0), snapshots=1
    )
    flat = np.indices((6, 8)).sum(0) % 2
    np.testing.assert_array_equal(grown, flat + 2 * np.arange(1, 6)[:, None, None])


def exact_course(p, times):
    """The local rule on the 4 x 4 lattice from the flat start, by its master equation.

    Returns the expected density of minima and of maxima and the variance at each time.
    """
    flat = np.indices((4, 4)).sum(0) % 2
    index, states, rows, columns, rates = {flat.tobytes(): 0}, [flat], [], [], []
    for here, state in enumerate(states):  # `states` grows while we walk it
        for kind, rate in ((2, p), (-2, 1 - p)):
            allowed = np.all(around(state) == state + kind // 2, 0)
            for site in np.argwhere(allowed):
                new = state.copy()
                new[tuple(site)] += kind
                new -= new.min() // 2 * 2  # heights up to a common even constant
                if new.tobytes() not in index:
                    index[new.tobytes()] = len(states)
                    states.append(new)
                rows.append(index[new.tobytes()])
                columns.append(here)
                rates.append(rate)
    n = len(states)
    gain = scipy.sparse.csr_array((rates, (rows, columns)), shape=(n, n))
    generator = gain - scipy.sparse.diags_array(np.asarray(gain.sum(0)).ravel())
    course = [scipy.sparse.linalg.expm_multiply(t * generator, np.eye(n)[0]) for t in times]
    seen = np.stack(
        [minima(np.stack(states)), maxima(np.stack(states)), variance(np.stack(states))]
    )
    return np.stack(course) @ seen.T


def test_random_sequential_solves_the_master_equation():
    p, times, surfaces = 0.1, [1, 2, 6], 20_000
    grow = partial(
        js.grow_single_step, (4, 4), p_plus=p, sweeps=times[-1], batch=surfaces, snapshots=times
    )
    exact = exact_course(p, times)
    grown = np.asarray(grow(key=jax.random.key(4)))
    other = np.asarray(grow(key=jax.random.key(4), scheme="sublattice"))
    for k, measure in enumerate((minima, maxima, variance)):
        for t in range(len(times)):
            # 4.5 standard errors: 1 in 15,000 for each of 9 figures of relative error 0.2 to 0.6 %
            assert abs(pull(measure(grown[t]), exact[t, k])) < 4.5, (measure.__name__, times[t])
            # the control: parallel updates are another process, and this would tell
            assert abs(pull(measure(other[t]), exact[t, k])) > 9


@partial(jax.jit, static_argnums=(1, 2))
def strictly_sequential(key, side, sweeps, p):
    """The local rule as one says it: one random site after another. One surface, flat start."""
    flat = jnp.asarray((np.indices((side, side)).sum(0) % 2).astype(np.int32))

    def pick(h, key):
        site, coin = jax.random.split(key)
        x, y = jax.random.randint(site, (2,), 0, side)
        n = jnp.stack([h[(x + 1) % side, y], h[x - 1, y], h[x, (y + 1) % side], h[x, y - 1]])
        raises = jax.random.uniform(coin) < p
        step = jnp.where(raises, jnp.int32(1), jnp.int32(-1))
        allowed = jnp.all(n == h[x, y] + step)
        return h.at[x, y].add(jnp.where(allowed, 2 * step, jnp.int32(0))), None

    return jax.lax.scan(pick, flat, jax.random.split(key, sweeps * side**2))[0]


def test_random_sequential_agrees_with_strictly_sequential():
    side, sweeps, p, surfaces = 12, 12, 0.1, 600
    keys = jax.random.split(jax.random.key(8), surfaces)
    one_by_one = jax.vmap(strictly_sequential, (0, None, None, None))(keys, side, sweeps, p)
    grow = partial(js.grow_single_step, (side, side), p_plus=p, sweeps=sweeps, batch=surfaces)
    at_once = grow(key=jax.random.key(9))
    in_sublattices = grow(key=jax.random.key(9), scheme="sublattice")

    def distance(a, b, measure):
        a, b = measure(a), measure(b)
        return abs(a.mean() - b.mean()) / np.sqrt((a.var() + b.var()) / surfaces)

    measures = {
        "minima": minima,
        "maxima": maxima,
        "mean height": lambda h: np.asarray(h).mean((-2, -1)),
        "variance": variance,
        "D2(3)": lambda h: height_correlation(h, 3),
        "skewness": skewness,
    }
    for name, measure in measures.items():
        # 4 standard errors: 1 in 16,000 for each of 6 figures
        assert distance(one_by_one, at_once, measure) < 4, name
    for name in ("minima", "maxima", "mean height"):  # the control
        assert distance(one_by_one, in_sublattices, measures[name]) > 10, name


# --- keys, batches, snapshots, saving ------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_run_cut_saved_and_resumed_is_the_same_run(scheme, tmp_path):
    key = jax.random.key(5)
    state = js.init_single_step((8, 8), p_plus=np.array([0.1, 0.6]), batch=2, scheme=scheme)
    whole, _ = js.run_single_step(key, state, sweeps=7)
    part, seen = js.run_single_step(key, state, sweeps=3, snapshots=1)
    part.save(tmp_path / "state.npz")
    resumed, _ = js.run_single_step(key, js.load_single_step(tmp_path / "state.npz"), sweeps=3)
    resumed = js.step_single_step(key, resumed)
    np.testing.assert_array_equal(resumed.heights, whole.heights)
    np.testing.assert_array_equal(seen[-1], part.heights)
    assert int(resumed.sweeps) == 7
    assert resumed.scheme == scheme
    np.testing.assert_array_equal(resumed.p_plus, state.p_plus)
    other, _ = js.run_single_step(jax.random.key(6), state, sweeps=7)
    assert np.any(np.asarray(other.heights) != np.asarray(whole.heights))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_surface_is_the_same_whatever_the_batch(scheme):
    grow = partial(js.grow_single_step, (8, 12), sweeps=9, scheme=scheme, key=jax.random.key(2))
    models = np.array([0.2, 0.7])
    both = grow(p_plus=models, batch=5, start="random")
    few = grow(p_plus=models, batch=2, start="random")
    np.testing.assert_array_equal(both[:, :2], few)
    assert len(np.unique(np.asarray(both).reshape(10, -1), axis=0)) == 10


def test_step_is_pure_and_can_be_mapped_over_p():
    models = jnp.array([0.0, 0.5, 1.0])
    state = js.init_single_step((6, 6), p_plus=0.5)
    key = jax.random.key(0)

    def mean_height(p):
        moved = js.step_single_step(
            key, js.SingleStep(state.heights, p, state.sweeps, state.scheme)
        )
        return jnp.mean(moved.heights.astype(jnp.float32))

    means = jax.jit(jax.vmap(mean_height))(models)
    assert float(means[0]) < 0.5 < float(means[2])  # flat is at 1/2; the same ticks, other coins
    np.testing.assert_array_equal(means, jnp.stack([mean_height(p) for p in models]))


def test_observe_keeps_only_what_it_returns():
    state = js.init_single_step((8, 8), p_plus=0.3, batch=3)

    def low_and_high(heights):
        return heights.min((-2, -1)), heights.max((-2, -1))

    end, kept = js.run_single_step(
        jax.random.key(1), state, sweeps=10, snapshots=4, observe=low_and_high
    )
    assert [k.shape for k in kept] == [(2, 3), (2, 3)]
    _, heights = js.run_single_step(jax.random.key(1), state, sweeps=10, snapshots=[4, 8])
    np.testing.assert_array_equal(kept[0], heights.min((-2, -1)))
    assert int(end.sweeps) == 10


# --- equilibrium and KPZ -------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equilibrium_density_of_minima(scheme):
    # Square ice on the infinite lattice has 5/24; a 32 x 32 torus is within 0.0003 of it.
    grown = js.grow_single_step(
        (32, 32),
        p_plus=0.5,
        sweeps=400,
        scheme=scheme,
        batch=64,
        snapshots=range(200, 401, 10),
        key=jax.random.key(11),
    )
    share = minima(grown).mean(0)
    assert abs(share.mean() - 5 / 24) < 0.002  # the bar
    assert abs(pull(share, 5 / 24)) < 4.5
    assert abs(pull(share, 5 / 24 + 0.002)) > 4.5  # the control: an error of 0.002 would be seen
    assert abs(pull(skewness(grown).mean(0), 0.0)) < 3  # the bar


def test_growth_at_one_tenth_and_its_mirror():
    # Bars: minima 0.204(3), D2(2) = 1.57(3), skewness 0.23(5); mirrored at p_plus = 0.9.
    grown = js.grow_single_step(
        (64, 64),
        p_plus=np.array([0.1, 0.9]),
        sweeps=1200,
        batch=8,
        snapshots=range(400, 1201, 100),
        key=jax.random.key(12),
    )
    down, up = np.asarray(grown).swapaxes(0, 1)
    for h in (down, -up):
        assert abs(minima(h).mean() - 0.204) < 0.003
        assert abs(height_correlation(h, 2).mean() - 1.57) < 0.03
        assert abs(skewness(h).mean() - 0.23) < 0.08  # 0.05, and 0.03 for the error of 8 surfaces
    assert abs(minima(up).mean() - 0.204) > 0.003  # the control: the wrong way up


# --- evidence ------------------------------------------------------------------------------------

TORUS = 64  # side of the surfaces measured below


def equilibrium(scheme):
    """Surfaces at p_plus = 1/2, [snapshot, surface, x, y], far apart in time."""
    # The slowest mode forgets in 240 sweeps; an event a site of the paper's rule is 4.8 sweeps.
    every = 100 if scheme != "paper" else 20
    grown = js.grow_single_step(
        (TORUS, TORUS),
        p_plus=0.5,
        sweeps=60 * every,
        scheme=scheme,
        batch=48,
        snapshots=np.arange(20, 61) * every,
        key=jax.random.key(5),
    )
    return np.asarray(grown).astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_equilibrium_is_square_ice(scheme):
    h = equilibrium(scheme)
    # S(q) q^2 -> 6/pi within 2 %; the mean over modes of 0.15 < q < 0.6 has an error of 0.4 %
    spectrum = (np.abs(np.fft.fft2(h)) ** 2).mean(0) / TORUS**2
    q = 2 * np.pi * np.fft.fftfreq(TORUS)
    lattice = (2 * np.sin(q / 2)) ** 2
    length = np.hypot(q[:, None], q[None, :])
    chosen = (length > 0.15) & (length < 0.6)
    stiffness = (spectrum * (lattice[:, None] + lattice[None, :]))[:, chosen].mean(1) * np.pi / 6
    assert abs(stiffness.mean() - 1) < 0.02, stiffness.mean()
    assert abs(pull(stiffness, 1.05)) > 4  # the control
    # D_2 = (6/pi^2) [ln r - pi r^2 / 2 L^2] + c on a torus; slope within 2 %, its error 0.5 %.
    # Along the axes alone the lattice would add 0.7 % at these r; diagonals take it off.
    r, correlation = [], []
    for k in range(2, 9):
        r.append(k)
        correlation.append(height_correlation(h, k).mean(0))
        if k * np.sqrt(2) <= 8:
            r.append(k * np.sqrt(2))
            turned = [np.roll(h, (k, sign * k), (-2, -1)) for sign in (1, -1)]
            correlation.append(np.mean([(h - t) ** 2 for t in turned], (0, 1, -2, -1)))
    r = np.array(r)
    slope = np.polyfit(np.log(r) - np.pi * r**2 / (2 * TORUS**2), np.array(correlation), 1)[0]
    slope = slope * np.pi**2 / 6
    assert abs(slope.mean() - 1) < 0.02, slope.mean()
    assert abs(pull(slope, 1.05)) > 4  # the control
    share = minima(h).mean(0)
    assert abs(share.mean() - 5 / 24) < 0.002
    assert abs(pull(skewness(h).mean(0), 0.0)) < 3


@pytest.mark.slow
def test_growth_is_mirrored_at_one_minus_p():
    grown = js.grow_single_step(
        (64, 64),
        p_plus=np.array([0.1, 0.9]),
        sweeps=4000,
        batch=32,
        snapshots=range(1000, 4001, 100),
        key=jax.random.key(13),
    )
    down, up = np.asarray(grown).swapaxes(0, 1)
    for h in (down, -up):
        assert abs(minima(h).mean() - 0.204) < 0.003
        assert abs(height_correlation(h, 2).mean() - 1.57) < 0.03
        assert abs(skewness(h).mean() - 0.23) < 0.05
    # <C_b^3>/<C_b^2>^(3/2) of p and 1 - p are mirror images, and at no scale zero
    scales = np.array([1, 2, 4, 8, 16])
    # one map a run and time, so far apart that they count as independent
    near_zero = [(h[::5] - h[::5, :, :1, :1]).astype(np.float32) for h in (down, up)]
    curves = [js.curvature_skewness(h.reshape(-1, 64, 64), scales) for h in near_zero]
    # so are the heights: opposite skewness, the same kurtosis
    skews, kurtoses = (
        [pool_snapshots(measure(h.reshape(-1, 64, 64)), 32) for h in near_zero]
        for measure in (js.height_skewness, js.height_kurtosis)
    )
    for (a, b), sign in ((skews, 1), (kurtoses, -1)):
        assert abs(a.mean[0] + sign * b.mean[0]) < 4 * np.hypot(a.stderr[0], b.stderr[0])
    a, b = skews
    assert a.mean[0] - b.mean[0] > 6 * np.hypot(a.stderr[0], b.stderr[0])  # the control
    error = np.hypot(curves[0].stderr, curves[1].stderr)
    assert np.all(np.abs(curves[0].mean + curves[1].mean) < 4 * error)
    assert np.all(np.abs(curves[0].mean - curves[1].mean) > 6 * error)  # the control
    # the sign at b = 1 is opposite to that of larger b
    assert curves[0].mean[0] * curves[0].mean[2] < 0


# --- misuse --------------------------------------------------------------------------------------

GOOD = {"shape": (8, 8), "p_plus": 0.1, "sweeps": 4, "key": jax.random.key(0)}
TILTED = np.indices((8, 8)).sum(0)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"p_plus": 1.2}, ValueError, r"p_plus must lie in \[0, 1\]; got 1.2"),
        ({"p_plus": np.array([0.1, -0.1])}, ValueError, r"p_plus must lie in \[0, 1\]"),
        ({"p_plus": np.nan}, ValueError, r"p_plus must lie in \[0, 1\]; got nan"),
        ({"shape": (8, 7)}, ValueError, r"must be even; got \(8, 7\)"),
        ({"shape": (2, 8)}, ValueError, "must be at least 4; got 2"),
        ({"sweeps": 0}, ValueError, "sweeps must be at least 1; got 0"),
        ({"sweeps": 2.5}, TypeError, "sweeps must be an integer; got 2.5"),
        ({"scheme": "parallel"}, ValueError, "scheme must be one of"),
        ({"batch": 0}, ValueError, "batch must be at least 1; got 0"),
        ({"start": "rough"}, ValueError, "start must be .* got 'rough'"),
        (
            {"start": TILTED},
            ValueError,
            "differ by exactly 1, across the periodic edges too; got 16",
        ),
        ({"start": TILTED * 1.0}, ValueError, "must be integer heights"),
        ({"start": TILTED[:6, :6] % 2}, ValueError, r"start must broadcast to \(8, 8\)"),
        ({"snapshots": 5}, ValueError, "every 5 sweeps lie beyond the run of 4"),
        ({"snapshots": 0}, ValueError, "snapshots must be at least 1; got 0"),
        ({"snapshots": [1, 5]}, ValueError, "within the run, 0 to 4 sweeps; got"),
        ({"snapshots": [-1, 3]}, ValueError, "within the run, 0 to 4 sweeps; got"),
        ({"snapshots": [3, 2]}, ValueError, "ascending order; got"),
        ({"snapshots": []}, ValueError, "ascending order; got"),
        ({"key": jax.random.PRNGKey(0)}, TypeError, "key must be a typed JAX key"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, error, message):
    with pytest.raises(error, match=message):
        js.grow_single_step(**(GOOD | change))


@pytest.mark.usefixtures("as_a_user")
def test_a_random_start_needs_a_key():
    with pytest.raises(TypeError, match='start="random" needs a key'):
        js.init_single_step((8, 8), p_plus=0.1, start="random")


def test_loading_refuses_other_files(tmp_path):
    np.savez(tmp_path / "other.npz", heights=TILTED)
    with pytest.raises(ValueError, match="lacks .*'p_plus'"):
        js.load_single_step(tmp_path / "other.npz")
    state = js.init_single_step((8, 8), p_plus=0.1)
    js.SingleStep(state.heights * 2, state.p_plus, state.sweeps, state.scheme).save(
        tmp_path / "no.npz"
    )
    with pytest.raises(ValueError, match="must differ by exactly 1"):
        js.load_single_step(tmp_path / "no.npz")
