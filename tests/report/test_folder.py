"""Results are written whole or not at all."""

import json

import numpy as np
import pytest

from jaxsurf.curve import Curve
from jaxsurf.report.folder import write_csv, write_curves, write_folder, write_json


def test_everything_is_there_and_other_files_stay(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    curve = Curve("spectrum", np.array([1.0, 2.0]), np.ones((3, 2)))
    records = [{"a": 1.5, "b": float("nan")}, {"a": 2.0, "b": 3.0}]
    folder = write_folder(
        tmp_path / "out",
        {
            "a.json": write_json({"x": np.float64(2.5), "bad": float("nan"), "y": np.arange(2)}),
            "a.csv": write_csv(records),
            "a.npz": write_curves({"one/two": curve}),
        },
    )
    assert sorted(p.name for p in folder.iterdir()) == ["a.csv", "a.json", "a.npz", "mine.txt"]
    content = json.loads((folder / "a.json").read_text())
    assert content["x"] == 2.5
    assert content["bad"] is None
    assert content["y"] == [0, 1]
    assert {"jaxsurf", "jax", "numpy", "python"} <= set(content["versions"])
    assert (folder / "a.csv").read_text() == "a,b\n1.5,\n2,3\n"
    with np.load(folder / "a.npz") as archive:
        np.testing.assert_array_equal(archive["one/two/samples"], np.ones((3, 2)))
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_interruption_leaves_what_was_there(tmp_path):
    folder = tmp_path / "out"
    write_folder(folder, {"a.txt": lambda p: p.write_text("old"), "b.txt": lambda p: p.touch()})

    def interrupted(path):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_folder(folder, {"a.txt": lambda p: p.write_text("new"), "b.txt": interrupted})
    assert (folder / "a.txt").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(NotADirectoryError, match="must be a folder; got a file. Name another"):
        write_folder(tmp_path / "out", {})
