"""The gallery of demos: runs each of them and writes demos/README.md, with a picture, a number and a sentence each.

python demos/gallery.py
"""

from __future__ import annotations

import runpy
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
DEMOS = (
    "one_pulley",
    "omega_range",
    "characteristic",
    "two_pulleys",
    "characteristic_drive",
    "flat_belt",
    "steel_band",
    "polyamide",
    "serpentine",
)
PICTURES = {"one_pulley": "deformed_belt"}  # of those whose picture has another name
HEAD = """# Demos

Each is a script that tells its physics, ends in asserts, and runs in seconds: `./run demo NAME`, or
`python demos/demo_NAME.py`, also under `mpirun`. `python demos/notebooks.py` makes notebooks of them. The drives are
TOML files beside them, to start from: `belt-fenicsx demos/flat_belt.toml --plot drive.png`.

This page is written by `python demos/gallery.py`.
"""


def picture(name: str) -> str:
    """The file of a demo's picture."""
    return f"{PICTURES.get(name, name)}.png"


def title(name: str) -> str:
    """The title of a demo, its first line of text."""
    lines = (HERE / f"demo_{name}.py").read_text().splitlines()
    return next(line for line in lines if line.startswith("# # ")).removeprefix("# # ")


def entry(name: str, headline: str) -> str:
    """What the gallery says of a demo."""
    link, shown = f"[`demo_{name}.py`](demo_{name}.py)", f"![{title(name)}](figures/{picture(name)})"
    return f"## {title(name)}\n\n{link}: {headline}\n\n{shown}\n"


def main() -> None:
    """Runs all demos, copies their pictures and writes the page."""
    sys.path.insert(0, str(HERE))
    entries = [HEAD]
    for name in DEMOS:
        demo = runpy.run_path(str(HERE / f"demo_{name}.py"), run_name="__main__")
        shutil.copyfile(HERE / "output" / picture(name), HERE / "figures" / picture(name))
        entries.append(entry(name, demo["headline"]()))
    (HERE / "README.md").write_text("\n".join(entries))


if __name__ == "__main__":
    main()
