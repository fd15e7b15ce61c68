"""Make the README's pictures and its table, from the README's own code and `jaxsurf table1`.

    python docs/make_images.py

Nothing in `docs/images` and between the README's table markers is drawn or typed by hand.
"""

import io
import os
import re
import shutil
import tempfile
from pathlib import Path

from jaxsurf import cli
from jaxsurf.cli import _terminal

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"


def main() -> None:
    """Run the ten lines, then the table."""
    readme = ROOT / "README.md"
    text = readme.read_text()
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        ten_lines = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0]
        exec(ten_lines, {})
        for name in re.findall(r'savefig\("(.*?)"\)', ten_lines):
            shutil.copy(name, IMAGES / name)
        printed = io.StringIO()
        _terminal.console.file = printed
        _terminal.console.width = 80
        cli.main(["table1"])
        shutil.copy("table1/exponents.png", IMAGES / "table1.png")
    table = printed.getvalue().replace("\n\n", "\n").strip("\n")
    table = "\n".join(line.rstrip() for line in table.splitlines() if line.strip())
    block = f"<!-- table1 -->\n```text\n{table}\n```\n<!-- end -->"
    readme.write_text(re.sub(r"<!-- table1 -->.*<!-- end -->", lambda _: block, text, flags=re.S))


if __name__ == "__main__":
    main()
