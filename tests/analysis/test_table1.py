"""Table I: the whole path at a small size, its settings, and the paper's own table beside it."""

import numpy as np
import pytest

from jaxsurf import theory
from jaxsurf.analysis.table1 import (
    EXPONENTS,
    Table1Settings,
    draw,
    paper_table,
    paper_values,
    reproduce_table1,
    theory_values,
)

SMALL = Table1Settings(alphas=(0.4, -1.0), sizes=(32, 64), surfaces=4, points=100, seed=3)


@pytest.fixture(scope="module")
def table():
    shares = []
    table = reproduce_table1(SMALL, progress=lambda share, text: shares.append((share, text)))
    assert shares[0] == (0.0, "α = 0.4, L = 32")
    assert shares[-1][0] == 1.0
    assert all(a[0] <= b[0] for a, b in zip(shares[:-1], shares[1:], strict=True))
    return table


def test_every_curve_and_exponent_is_there(table):
    assert set(table.curves) == {(0.4, 32), (0.4, 64), (-1.0, 32), (-1.0, 64)}
    for kinds in table.curves.values():
        assert {kind for kind, _ in EXPONENTS.values()} == set(kinds)
        assert all(curve.surfaces == 4 for curve in kinds.values())
    for row in table.rows:
        for name in EXPONENTS:
            assert np.isfinite(row.value(name))
            assert row.fits[name].converged
            assert row.errors(name)[0] > 0
    assert table.example.shape == (64, 64)
    assert table.example_alpha == 0.4


def test_smooth_and_white_surfaces_are_told_apart(table):
    rough, white = table.rows
    # percolation hulls are rougher loops: D_f 1.75 against 1.3, tau - 2 0.57 against 0.23; even at
    # L = 64 the differences exceed 5 of the errors, which the wrong assignment would not
    for name in ("D_f", "tau-2"):
        error = np.hypot(rough.fits[name].total_error("exponent"), white.errors(name)[0])
        assert white.value(name) - rough.value(name) > 3 * error


def test_same_seed_same_table_whatever_else_is_simulated(table):
    alone = Table1Settings(alphas=(0.4,), sizes=(64,), surfaces=4, points=100, seed=3)
    again = reproduce_table1(alone)
    assert again.rows[0].value("D_f") == table.rows[0].value("D_f")
    other = draw(0.4, 64, Table1Settings(surfaces=4, seed=4))
    assert not np.allclose(other[0], table.example)


def test_records_are_plain(table):
    import json

    assert json.loads(json.dumps(table.to_dict()))["rows"][0]["alpha"] == 0.4
    record = table.to_rows()[0]
    assert record["D_f"] == table.rows[0].value("D_f")
    assert record["D_f paper"] == 1.31


def test_the_papers_table_is_complete_and_its_theory_is_ours():
    records = paper_table("table1_gaussian.csv")
    assert [r["alpha"] for r in records] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    for record in records:
        predicted = theory_values(record["alpha"])
        assert predicted["D_f"] == pytest.approx(record["Df_theory"], abs=1e-9)
        assert predicted["tau-2"] == pytest.approx(record["tau_minus_2_theory"], abs=1e-9)
        assert predicted["2x_l"] == 1.0
    assert paper_values(0.4) == {"2x_l": (1.01, 0.01), "D_f": (1.31, 0.02), "tau-2": (0.24, 0.01)}
    assert paper_values(0.5) == {}
    white = theory_values(-1.0)
    assert white["D_f"] == theory.PERCOLATION.fractal_dimension
    assert white["2x_l"] == 1.25


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"alphas": ()}, ValueError, "alphas and sizes must not be empty"),
        ({"alphas": (2.0,)}, ValueError, r"alpha must lie in \[-1, 2\); got 2.0"),
        ({"sizes": (2,)}, ValueError, "at least 4; got 2"),
        ({"sizes": (32,)}, ValueError, "the largest size must lie in"),
        ({"surfaces": 1}, ValueError, "surfaces must be at least 2; got 1"),
        ({"points": 0}, ValueError, "points must be at least 1; got 0"),
        ({"points": 4.5}, TypeError, "points must be an integer; got 4.5"),
        ({"seed": -1}, ValueError, "seed must be at least 0"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse(change, error, message):
    with pytest.raises(error, match=message):
        Table1Settings(**change)
