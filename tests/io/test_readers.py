"""Readers and HeightMap: what is in a file comes out, and what is no map is refused."""

import numpy as np
import pytest

from jaxsurf.io.heightmap import HeightMap
from jaxsurf.io.readers import read_heights

HEIGHTS = np.arange(30.0).reshape(5, 6) ** 1.5


def test_npy(tmp_path):
    np.save(tmp_path / "film.npy", HEIGHTS)
    surface = read_heights(tmp_path / "film.npy")
    np.testing.assert_array_equal(surface.heights, HEIGHTS)
    assert (surface.spacing, surface.length_unit, surface.source) == (1.0, "sites", "film.npy")


def test_integer_heights_stay_integers(tmp_path):
    np.save(tmp_path / "steps.npy", np.arange(16).reshape(4, 4))
    assert read_heights(str(tmp_path / "steps.npy")).heights.dtype.kind == "i"


def test_npz_with_units(tmp_path):
    path = tmp_path / "film.npz"
    np.savez(path, heights=HEIGHTS, other=HEIGHTS, spacing=0.5, length_unit="nm", height_unit="pm")
    surface = read_heights(path)
    np.testing.assert_array_equal(surface.heights, HEIGHTS)
    assert (surface.spacing, surface.length_unit, surface.height_unit) == (0.5, "nm", "pm")
    np.savez(path, anything=HEIGHTS)
    np.testing.assert_array_equal(read_heights(path).heights, HEIGHTS)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_text_tables(tmp_path, delimiter):
    path = tmp_path / "film.csv"
    np.savetxt(path, HEIGHTS, delimiter=delimiter, header="a comment", fmt="%.17g")
    np.testing.assert_array_equal(read_heights(path).heights, HEIGHTS)


def test_missing_values_in_text_become_missing_sites(tmp_path):
    path = tmp_path / "film.csv"
    rows = [",".join(f"{x}" for x in row) for row in HEIGHTS]
    rows[2] = rows[2].replace(rows[2].split(",")[1], "", 1)
    path.write_text("\n".join(rows))
    surface = read_heights(path)
    assert (~surface.valid).sum() == 1
    assert "1 missing" in repr(surface)


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.bmp", lambda p: p.write_text("x"), r"suffix must be one of .*got '.bmp'"),
        ("a.npy", lambda p: np.save(p, np.zeros(8)), "must be a map of at least 4 x 4"),
        ("a.npy", lambda p: np.save(p, np.zeros((4, 4), complex)), "real numbers; got dtype compl"),
        (
            "a.npz",
            lambda p: np.savez(p, a=np.zeros(3)),
            "must hold one two-dimensional array; got n",
        ),
        ("a.npz", lambda p: np.savez(p, a=HEIGHTS, b=HEIGHTS), "Name the heights one of"),
        ("a.csv", lambda p: p.write_text("1,2,3\n1,2\n"), "as many numbers in every row"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_what_is_no_map_is_refused(tmp_path, name, write, message):
    write(tmp_path / name)
    with pytest.raises(ValueError, match=message):
        read_heights(tmp_path / name)


def test_nothing_is_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], object), allow_pickle=True)
    with pytest.raises(ValueError, match="allow_pickle"):
        read_heights(tmp_path / "a.npy")


def test_no_such_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="no file at .*nowhere.npy"):
        read_heights(tmp_path / "nowhere.npy")


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_spacing_must_be_positive(spacing):
    with pytest.raises(ValueError, match="spacing must be positive and finite; got"):
        HeightMap(HEIGHTS, spacing)


def test_notebook_view_says_size_and_roughness():
    view = HeightMap(HEIGHTS, 2.0, "nm", "pm", "film")._repr_html_()
    assert "10 x 12 nm" in view
    assert f"{HEIGHTS.std():.4g} pm" in view
