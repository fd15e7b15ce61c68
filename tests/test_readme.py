"""The Python of the README and the docs runs as it stands, and their links lead somewhere."""

import re
from pathlib import Path

import pytest

import jaxsurf as js

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
DOCS = sorted((ROOT / "docs").glob("*.md"))
LINKS = [
    (page, link)
    for page in [README, *DOCS]
    for link in re.findall(r"\]\((?!http)(.*?)\)", page.read_text())
]


def blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)


def test_python_blocks_run_and_save_their_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # a twentieth of the work: the code is what is tested, the figures belong to the full size
    source = blocks(README)[0]
    assert "(512, 512)" in source
    assert "batch=25" in source
    exec(source.replace("(512, 512)", "(128, 128)").replace("batch=25", "batch=4"), {})
    for name in re.findall(r'savefig\("(.*?)"\)', source):
        assert (tmp_path / name).read_bytes()[:4] == b"\x89PNG"
    assert "exponent" in capsys.readouterr().out


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.name)
def test_pages_run(page, capsys):
    for block in blocks(page):
        exec(block, {})
    assert capsys.readouterr().out


@pytest.mark.parametrize(("page", "link"), LINKS, ids=lambda part: getattr(part, "name", part))
def test_links_lead_somewhere(page, link):
    assert (page.parent / link.split("#")[0]).exists()


def test_pages_name_only_what_exists():
    """Every function named with code marks in the docs is public."""
    for page in DOCS:
        for name in re.findall(r"`(?:js\.)?([a-z]\w+)\(", page.read_text()):
            assert hasattr(js, name) or hasattr(js.Curve, name), (page.name, name)
