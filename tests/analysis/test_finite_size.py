"""The FSS columns: collapses of small maps end to end."""

import json

import numpy as np
import pytest

from jaxsurf.analysis.finite_size import (
    COLUMNS,
    KINDS,
    FiniteSizeSettings,
    collapse_table1,
    reproduce_finite_size,
)
from jaxsurf.analysis.table1 import Table1Settings, reproduce_table1
from jaxsurf.report.collapse import finite_size_figures

SMALL = FiniteSizeSettings(
    alphas=(0.4,), sizes=(64, 128, 256), sites=2**20, fewest=12, most=60, levels=4, draws=20
)


@pytest.fixture(scope="module")
def small():
    return reproduce_finite_size(SMALL)


def test_small_maps_end_to_end(small):
    row = small.rows[0]
    assert set(small.curves[0.4]) == set(KINDS)
    for name in COLUMNS:
        # maps of 64 to 256 sites: corrections of order one tenth beside the statistical error
        statistical, systematic = row.errors(name)
        assert abs(row.value(name) - row.theory[name]) < 0.1 + 4 * statistical
        # sizes over a factor of four determine the exponents
        assert 0 < statistical < 0.3
        assert row.pull(name) == pytest.approx(
            (row.value(name) - row.theory[name]) / np.hypot(statistical, systematic)
        )
        nearer = abs(row.value(name) - row.theory[name]) < abs(
            row.paper[name][0] - row.theory[name]
        )
        assert row.nearer(name) == nearer
    assert row.paper["D_f"] == (1.32, 0.03)
    for name in ("2x_l", "D_f"):
        assert [step.sizes for step in row.steps[name]] == [(64, 128), (128, 256)]
        last = row.steps[name][-1]
        assert abs(last.value - row.theory[name]) < 0.1 + 4 * last.error  # as above
    closes = row.relations()
    fractal, tail, twice = row.value("D_f"), row.value("tau-2"), row.value("2x_l")
    (first, first_error), (second, second_error) = closes.values()
    assert first == pytest.approx(fractal * (1 + tail) - 1.6)
    assert second == pytest.approx(fractal * (1 - tail) - 2 + twice)
    # relations that hold for any x_l; maps this small are off by a tenth at most
    assert abs(first) < 0.1 + 4 * first_error
    assert abs(second) < 0.1 + 4 * second_error
    assert 0 < first_error < 0.5
    record = small.to_rows()[0]
    assert record["tau-2 theory"] == pytest.approx(0.6 / 2.6)
    json.dumps(small.to_dict())


def test_pictures_of_the_collapse(small):
    figures = finite_size_figures(small)
    assert len(figures) == 4
    against = figures.pop("exponents_against_size")
    # error bars of both exponents at the one alpha, and its theory
    assert [len(axes.containers) for axes in against.axes] == [1, 1]
    for figure in figures.values():
        before, after = figure.axes
        assert len(before.get_lines()) == 3
        assert len(after.get_lines()) == 4  # three sizes and the master curve


def test_too_few_sizes_of_a_table_are_refused():
    table = reproduce_table1(Table1Settings(alphas=(0.4,), sizes=(64, 128), surfaces=3, points=20))
    with pytest.raises(ValueError, match=r"three sizes or more; got \(64, 128\)"):
        collapse_table1(table)


def test_a_table_of_white_noise_alone_has_no_column():
    table = reproduce_table1(
        Table1Settings(alphas=(-1.0,), sizes=(16, 32, 64), surfaces=3, points=20)
    )
    with pytest.raises(ValueError, match="got none. White noise has no such column"):
        collapse_table1(table)


def test_how_many_surfaces_a_size_gets():
    settings = FiniteSizeSettings(sites=2**20, fewest=12, most=100)
    assert [settings.surfaces(side) for side in (64, 256, 1024)] == [100, 16, 12]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sizes": (64, 128)}, "sizes must be three or more"),
        ({"alphas": ()}, "needs a surface with alpha from 0 to 1; got none"),
        ({"alphas": (1.4,)}, "alpha must lie in"),
        ({"fewest": 2}, "fewest must be at least 5"),
        ({"most": 3}, "most must be at least 12"),
        ({"levels": 0}, "levels must be at least 1"),
        ({"draws": 0}, "draws must be at least 20"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, message):
    with pytest.raises(ValueError, match=message):
        FiniteSizeSettings(**change)
