"""Fig. 11: small maps end to end, and the paper's own setting as slow evidence."""

import json

import numpy as np
import pytest

from jaxsurf.analysis.crossover import (
    MEASURES,
    PERCOLATION,
    CrossoverSettings,
    reproduce_crossover,
)
from jaxsurf.report.crossover import crossover_figures


def test_small_maps_end_to_end():
    seen = []
    settings = CrossoverSettings(side=128, cutoff=8, surfaces=12, points=200, draws=20)
    result = reproduce_crossover(settings, progress=lambda share, text: seen.append(share))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    # L = 16 xi only: alpha and xi are seen, with errors of a few per cent
    assert abs(result.joint.values["alpha"] - 0.4) < 0.1
    assert abs(result.joint.values["xi"] - 8) < 1.5
    assert [row["measure"] for row in result.to_rows()] == list(MEASURES)
    json.dumps(result.to_dict())
    figure = crossover_figures(result)["crossover"]
    assert len(figure.axes) == 4


@pytest.mark.slow
def test_the_papers_setting():
    result = reproduce_crossover()
    print(result.joint, result.separate, result.agreement, result.to_rows(), sep="\n")
    assert abs(result.joint.values["alpha"] - 0.4) < 0.02  # the bar
    assert abs(result.joint.values["xi"] - 16) < 1.0
    chi2, dof = result.agreement
    assert dof == 3
    assert chi2 < 11.3  # 1 % of ensembles have more if the four xi are one
    for kind, exact in PERCOLATION.items():
        fit = result.beyond[kind]
        total = np.hypot(fit.stderr["exponent"], fit.systematic["exponent"])
        assert abs(fit.values["exponent"] - exact) < 2.5 * total, kind
        assert total < 0.2  # the control: the self-affine exponent is told apart


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"alpha": 1.2}, "alpha must lie in"),
        ({"cutoff": 100}, "cutoff must lie in"),
        ({"cutoff": -3.0}, "cutoff must lie in"),
        ({"surfaces": 2}, "surfaces must be at least 5"),
        ({"points": 0}, "points must be at least 1"),
        ({"side": 2}, "at least 4"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, message):
    with pytest.raises(ValueError, match=message):
        CrossoverSettings(**change)
