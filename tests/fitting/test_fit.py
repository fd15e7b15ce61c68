import json

import numpy as np
import pytest

from jaxsurf.fitting.fit import Fit


def a_fit(**changes):
    fields = {
        "model": "power law of spectrum",
        "values": {"exponent": -2.8, "amplitude": 1.5},
        "stderr": {"exponent": 0.03, "amplitude": 0.1},
        "systematic": {"exponent": 0.04},
        "covariance": np.diag([9e-4, 1e-2]),
        "chi2": 10.0,
        "dof": 10,
    }
    return Fit(**fields | changes)


def test_total_error_adds_in_quadrature():
    assert a_fit().total_error("exponent") == pytest.approx(0.05)  # 3-4-5
    assert a_fit().total_error("amplitude") == pytest.approx(0.1)


def test_p_value():
    # chi2 of 2 degrees of freedom: exp(-chi2/2)
    assert a_fit(chi2=6.0, dof=2).p_value == pytest.approx(np.exp(-3.0))
    assert a_fit(chi2=6.0, dof=0).p_value == 1.0


def test_a_failed_fit_never_looks_like_a_good_one():
    failed = a_fit(status="failed: nothing to fit. Widen the window.")
    assert not failed.converged
    assert "failed: nothing to fit. Widen the window." in repr(failed)
    assert "failed" in failed._repr_html_()
    assert a_fit().converged


def test_what_is_printed():
    text = repr(a_fit(notes=("one surface only",)))
    assert "exponent  = -2.8 ± 0.03 (statistical) ± 0.04 (systematic)" in text
    assert "amplitude = 1.5 ± 0.1\n" in text
    assert "note: one surface only" in text


def test_json_round_trip():
    fit = a_fit(details={"window": (1, np.float64(2.0)), "table": {4: np.arange(2)}})
    again = json.loads(json.dumps(fit.to_dict()))
    assert again["values"] == {"exponent": -2.8, "amplitude": 1.5}
    assert again["details"] == {"window": [1, 2.0], "table": {"4": [0, 1]}}
    assert again["covariance"] == [[9e-4, 0.0], [0.0, 1e-2]]
