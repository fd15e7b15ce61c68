"""The command line as a user runs it: whole commands, their files, and their one-line errors."""

import json
import subprocess
import sys

import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf import cli

QUICK = ["table1", "--sizes", "64", "--alphas", "0.4", "--surfaces", "3", "--points", "50"]


def run(*words):
    try:
        cli.main([str(word) for word in words])
    except SystemExit as stop:
        return stop.code or 0
    return 0


def test_table1_prints_the_table_and_writes_its_files(tmp_path, capsys):
    output = tmp_path / "out"
    assert run(*QUICK, "--output", output) == 0
    printed = capsys.readouterr().out
    assert "Table I, direct" in printed
    assert "α = 0.4" in printed
    assert "1.31 ± 0.02" in printed  # the paper's value beside ours
    assert "1.300" in printed  # and the theory
    names = {path.name for path in output.iterdir()}
    assert names == {
        "table1.csv",
        "table1.json",
        "table1_curves.npz",
        "contours.png",
        "mean_length.png",
        "length_tail.png",
        "loop_correlation.png",
        "exponents.png",
    }
    content = json.loads((output / "table1.json").read_text())
    assert content["settings"]["surfaces"] == 3
    assert content["versions"]["jaxsurf"]
    assert (output / "mean_length.png").read_bytes()[:4] == b"\x89PNG"


def test_table2_prints_the_table_and_writes_its_files(tmp_path, capsys):
    output = tmp_path / "out"
    words = ["table2", "--p-plus", 0.5, "--sizes", 16, 64, "--equilibrate", 20, "--measure", 20]
    words += ["--snapshots", 10, "--replicas", 4, "--points", 60, "--scheme", "sublattice"]
    assert run(*words, "--output", output) == 0
    printed = capsys.readouterr().out
    assert "p₊ = 0.5" in printed
    assert "0.135 ± 0.002" in printed  # the paper's value beside ours
    names = {path.name for path in output.iterdir()}
    assert {
        "table2.csv",
        "table2.json",
        "table2_curves.npz",
        "spectrum.png",
        "collapse.png",
    } <= names


def test_table1_with_finite_size_scaling(tmp_path, capsys):
    output = tmp_path / "out"
    words = [*QUICK, "--fss-sizes", 64, 96, 128, "--fss-sites", 200_000, "--output", output]
    assert run(*words) == 0
    printed = capsys.readouterr().out
    assert "Table I, FSS: L = 64 to 128" in printed
    assert "nearer to theory" in printed
    assert {"fss.csv", "fss.json", "fss_curves.npz"} <= {path.name for path in output.iterdir()}


def test_table1_collapses_its_own_curves(tmp_path, capsys):
    output = tmp_path / "out"
    words = ["table1", "--sizes", 64, 128, 256, "--alphas", 0.4, "--surfaces", 12]
    assert run(*words, "--points", 300, "--fss-same", "--output", output) == 0
    printed = capsys.readouterr().out
    assert "Table I, FSS: L = 64 to 256" in printed
    content = json.loads((output / "fss.json").read_text())
    assert content["settings"] is None  # nothing was simulated beyond the direct table
    assert content["rows"][0]["exponents"]["D_f"]["paper"] == [1.32, 0.03]
    assert (output / "exponents_against_size.png").read_bytes()[:4] == b"\x89PNG"


def test_crossover_prints_the_knees_and_draws_the_panels(tmp_path, capsys):
    output = tmp_path / "out"
    words = ["crossover", "--side", 128, "--cutoff", 8, "--surfaces", 6, "--points", 100]
    assert run(*words, "--output", output) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "All measures together: α =" in printed
    assert {"crossover.csv", "crossover.json", "crossover_curves.npz"} <= {
        path.name for path in output.iterdir()
    }


def test_growth_prints_the_exponents_and_draws_them(tmp_path, capsys):
    output = tmp_path / "out"
    words = ["growth", "--side", 64, "--last", 16, "--first", 1, "--replicas", 5, "--points", 60]
    assert run(*words, "--scheme", "sublattice", "--output", output) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "single-step, p₊ = 0.1: L = 64, t = 1 to 16" in printed
    assert "z (collapse of S)" in printed
    assert {path.name for path in output.iterdir()} == {
        "growth.csv",
        "growth.json",
        "growth_curves.npz",
        "growth.png",
        "growth_loops.png",
    }


def test_an_interruption_says_so_and_writes_nothing(tmp_path, monkeypatch, capsys):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxsurf.analysis.table1.reproduce_table1", interrupted)
    assert run(*QUICK, "--output", tmp_path / "out") == 130
    assert "Interrupted: nothing was written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_measure_a_file(tmp_path, capsys):
    heights = js.sample(js.SelfAffine(0.4), (96, 80), key=jax.random.key(0))
    np.savetxt(tmp_path / "film.csv", heights, delimiter=",")
    output = tmp_path / "out"
    words = ["measure", tmp_path / "film.csv", "--spacing", 2.5, "--unit", "nm", "--points", 300]
    assert run(*words, "--output", output) == 0
    printed = capsys.readouterr().out
    for name in ("spectrum", "curvature variance", "loop dimension D_f", "loop lengths tau-2"):
        assert name in printed
    assert {path.name for path in output.iterdir()} == {
        "measure.json",
        "curves.npz",
        "map.png",
        "curves.png",
    }
    assert json.loads((output / "measure.json").read_text())["spacing"] == 2.5


def test_measure_the_demo_landscape(tmp_path, capsys):
    words = ["measure", "--demo", "--points", 100, "--output", tmp_path / "out"]
    assert run(*words) == 0
    assert "344 x 403 sites of 3 arcsec" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["measure"], "measure takes a FILE or --demo; got neither"),
        (["measure", "nowhere.npy"], "no file at 'nowhere.npy'"),
        (["table1", "--alphas", "3"], r"alpha must lie in [-1, 2); got 3.0"),
        (["table1", "--points", "0"], "points must be at least 1; got 0"),
        (["table1", "--sizes", "-64"], "at least 4; got -64"),
    ],
)
def test_mistakes_are_one_line(words, message, capsys):
    assert run(*words) == 2
    printed = " ".join(capsys.readouterr().err.split())
    assert message in printed
    assert "Traceback" not in printed


def test_help_names_the_commands():
    found = subprocess.run(
        [sys.executable, "-m", "jaxsurf.cli", "--help"], capture_output=True, text=True, check=True
    )
    assert "table1" in found.stdout
    assert "table2" in found.stdout
    assert "measure" in found.stdout
