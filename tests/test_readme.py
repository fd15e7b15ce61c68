"""The README's Python runs as it stands and makes the pictures it shows."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parent.parent / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(), re.DOTALL)


def test_python_blocks_run_and_save_their_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # a twentieth of the work: the code is what is tested, the figures belong to the full size
    source = blocks("python")[0]
    assert "(512, 512)" in source
    assert "batch=25" in source
    exec(source.replace("(512, 512)", "(128, 128)").replace("batch=25", "batch=4"), {})
    for name in re.findall(r'savefig\("(.*?)"\)', source):
        assert (tmp_path / name).read_bytes()[:4] == b"\x89PNG"
    assert "exponent" in capsys.readouterr().out


@pytest.mark.parametrize("link", re.findall(r"\]\((?!http)(.*?)\)", README.read_text()))
def test_links_lead_somewhere(link):
    assert (README.parent / link.split("#")[0]).exists()
