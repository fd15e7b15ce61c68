"""Table II: the whole path at a small size, its settings, and the paper's own table beside it."""

import json

import numpy as np
import pytest

import jaxsurf as js
from jaxsurf import theory
from jaxsurf.analysis.table2 import (
    COLUMNS,
    Table2Settings,
    merge_scales,
    paper_entry,
    reproduce_table2,
)
from jaxsurf.analysis.table2_runs import _curvatures, grow
from jaxsurf.curve import Curve

# Sublattice updates: the fastest to compile and to run; what is tested here is the path.
SMALL = Table2Settings(
    p_plus=(0.1, 0.5),
    sizes=(32, 64),
    equilibrate=600,
    measure=400,
    snapshots=10,
    replicas=6,
    points=60,
    draws=20,
    scheme="sublattice",
    seed=2,
)


@pytest.fixture(scope="module")
def table():
    said = []
    table = reproduce_table2(SMALL, progress=lambda share, text: said.append((share, text)))
    assert said[0] == (0.0, "p₊ = 0.1, L = 32: equilibrating")
    assert said[-1] == (1.0, "done")
    assert all(0 <= a[0] <= b[0] for a, b in zip(said[:-1], said[1:], strict=True))
    return table


def test_every_curve_and_column_is_there(table):
    assert set(table.curves) == {(p, side) for p in (0.1, 0.5) for side in (32, 64)}
    for curves in table.curves.values():
        assert set(curves) == {
            "spectrum 10",
            "spectrum 11",
            "curvature 2",
            "curvature 3",
            "mean_length",
            "length_tail",
            "height skewness",
            "height kurtosis",
            "curvature skewness",
        }
        assert all(curve.surfaces == SMALL.replicas for curve in curves.values())
    assert table.side == 64
    for row in table.rows:
        assert list(row.entries) == list(COLUMNS)
        assert 0 < row.winding < 0.3
        for entry in row.entries.values():
            assert np.isfinite(entry.value)
            assert entry.statistical > 0
            assert abs(entry.pull) < 10


def test_growth_and_equilibrium_are_told_apart(table):
    grown, equilibrium = table.rows
    # alpha 0.35 against 0.1 and loops of dimension 1.3 against 1.45: 5 of the errors, even here
    for column, sign in (("alpha C2", 1), ("D_f direct", -1)):
        a, b = grown.entries[column], equilibrium.entries[column]
        assert sign * (a.value - b.value) > 3 * np.hypot(a.statistical, b.statistical)
    third = table.curves[0.1, 64]["curvature 3"]
    still = table.curves[0.5, 64]["curvature 3"]
    assert np.abs(third.mean / third.stderr)[0] > 5  # growth breaks the symmetry up-down
    assert np.abs(still.mean / still.stderr)[0] < 5
    # heights of surfaces that evaporate are lopsided, those in equilibrium are not
    assert grown.skewness[0] > 4 * grown.skewness[1]
    assert abs(equilibrium.skewness[0]) < 4 * equilibrium.skewness[1]
    assert all(error > 0 for row in table.rows for _, error in (row.skewness, row.kurtosis))


def test_the_skewness_of_the_curvature_is_that_of_its_moments(table):
    for curves in table.curves.values():
        second, third = curves["curvature 2"], curves["curvature 3"]
        ratio = third.mean / second.mean**1.5
        skewness = curves["curvature skewness"]
        assert (skewness.kind, skewness.detail("order")) == ("curvature_skewness", None)
        # the jackknife takes off a bias that is small against the error
        assert np.all(np.abs(skewness.mean - ratio) < 0.5 * skewness.stderr)
        assert np.all(skewness.stderr > 0)


def test_curvatures_in_one_pass_are_the_public_measure():
    maps = np.random.default_rng(0).gamma(2.0, size=(3, 32, 32)).astype(np.float32)
    for order, curve in _curvatures(maps).items():
        public = js.curvature_moment(maps, order=order)
        # float32: compiled together or apart, sums of 10^3 terms
        np.testing.assert_allclose(curve.samples, public.samples, rtol=1e-4, atol=1e-3)
        np.testing.assert_array_equal(curve.scale, public.scale)
        np.testing.assert_array_equal(curve.weights, public.weights)
        assert (curve.kind, curve.details) == (public.kind, public.details)


def test_derived_columns_follow_from_their_source(table):
    for row in table.rows:
        e = row.entries
        assert e["alpha D_f"].value == pytest.approx(3 - 2 * e["D_f FSS"].value)
        assert e["alpha D_f"].statistical == pytest.approx(2 * e["D_f FSS"].statistical)
        tail = e["tau-2 FSS"].value
        assert e["alpha tau"].value == pytest.approx((1 - 3 * tail) / (1 - tail))
        assert e["alpha tau"].error == pytest.approx(2 * e["tau-2 FSS"].error / (1 - tail) ** 2)


def test_the_same_surfaces_whatever_else_is_simulated():
    alone = Table2Settings(**{**vars(SMALL), "p_plus": (0.5,), "replicas": 3, "sizes": (16, 64)})
    say = lambda share, text: None  # noqa: E731
    few, many = grow(0.5, 64, alone, say), grow(0.5, 64, SMALL, say)
    np.testing.assert_array_equal(few, many[:, :3])
    assert few.shape == (10, 3, 64, 64)
    assert np.all(np.diff(few.astype(int), axis=0).any((1, 2, 3)))


def test_records_are_plain(table):
    plain = json.loads(json.dumps(table.to_dict()))
    assert [row["p_plus"] for row in plain["rows"]] == [0.1, 0.5]
    assert plain["rows"][0]["columns"]["alpha C2"]["paper"] == [0.33, 0.02]
    record = table.to_rows()[1]
    assert record["tau-2 FSS"] == table.rows[1].entries["tau-2 FSS"].value
    assert record["tau-2 FSS paper"] == 0.36


def test_the_papers_errors_are_propagated_anew():
    assert paper_entry(0.1, "alpha C2") == (0.33, 0.02)
    assert paper_entry(0.2, "alpha C2") is None
    for p, value, quoted in ((0.1, 0.37, 0.03), (0.3, -0.08, 0.05), (0.5, -0.13, 0.05)):
        found, error = paper_entry(p, "alpha tau")
        assert found == value
        assert error > quoted  # Table II's own errors of alpha from tau are too small
        tail, of_tail = paper_entry(p, "tau-2 FSS")
        assert error == pytest.approx(2 * of_tail / (1 - tail) ** 2)
        # and its values follow from its tau - 2 to the digits given
        assert theory.alpha_from_length_tail(tail) == pytest.approx(value, abs=0.006)
    for p in (0.1, 0.3, 0.5):
        value, error = paper_entry(p, "alpha D_f")
        assert value == pytest.approx(3 - 2 * paper_entry(p, "D_f FSS")[0], abs=0.006)
        assert error == pytest.approx(0.04)


def test_merged_scales_are_in_order():
    a = Curve("directional_spectrum", np.array([1.0, 3.0]), np.array([[1.0, 3.0], [2.0, 6.0]]))
    b = Curve("directional_spectrum", np.array([2.0]), np.array([[2.0], [4.0]]))
    merged = merge_scales([a, b])
    np.testing.assert_array_equal(merged.scale, [1, 2, 3])
    np.testing.assert_array_equal(merged.samples, [[1, 2, 3], [2, 4, 6]])


def test_quick_is_the_same_work_in_small():
    quick, full = Table2Settings.quick(seed=4), Table2Settings()
    assert quick.seed == 4
    assert (quick.p_plus, quick.sizes, quick.scheme) == (full.p_plus, full.sizes, full.scheme)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"p_plus": ()}, "needs a p_plus and two sizes"),
        ({"sizes": (128,)}, "needs a p_plus and two sizes"),
        ({"p_plus": (0.1, 1.5)}, r"p_plus must lie in \[0, 1\]"),
        ({"sizes": (32, 65)}, "sizes must be even; got 65"),
        ({"sizes": (8, 64)}, "a size must be at least 16; got 8"),
        ({"sizes": (16, 32)}, r"the largest size must lie in \[64, inf\]; got 32"),
        ({"equilibrate": 0}, "equilibrate must be at least 1; got 0"),
        ({"snapshots": 5}, "snapshots must be at least 10; got 5"),
        ({"snapshots": 15}, "snapshots must be a multiple of 10; got 15"),
        ({"measure": 50}, "measure must be at least 100; got 50"),
        ({"replicas": 2}, "replicas must be at least 3; got 2"),
        ({"points": 0}, "points must be at least 1; got 0"),
        ({"draws": 5}, "draws must be at least 20; got 5"),
        ({"scheme": "fast"}, "scheme must be one of"),
        ({"seed": -1}, "seed must be at least 0; got -1"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, message):
    with pytest.raises(ValueError, match=message):
        Table2Settings(**change)
