"""Pictures of the gallery: every PIL image and plotly figure that an example makes, shown where it was made.

Plotly comes from one local file among the site's static files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PIL import Image
from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs
from sphinx.application import Sphinx

PLOTLY = "plotly.min.js"
"""Name of the one file of plotly among the static files."""


def _new(block: tuple[Any, ...], variables: dict[str, Any]) -> list[Any]:
    """Return the pictures and figures in variables that no earlier block showed, in order."""
    del block
    kept = variables["example_globals"].setdefault("__pictures__", [])
    found = []
    for value in list(variables["example_globals"].values()):
        if isinstance(value, Image.Image | Figure) and all(value is not other for other in kept):
            kept.append(value)
            found.append(value)
    return found


def scraper(block: tuple[Any, ...], variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Write new pictures beside the page and return the text that shows them, for Sphinx-Gallery."""
    parts: list[str] = []
    for value in _new(block, variables):
        if isinstance(value, Image.Image):
            path = Path(next(variables["image_path_iterator"]))
            path.parent.mkdir(parents=True, exist_ok=True)
            value.save(path)
            name = path.relative_to(Path(settings["src_dir"])).as_posix()
            parts.append(
                f".. image-sg:: /{name}\n   :alt: {_words(value)}\n   :srcset: /{name}\n   :class: xf-wide\n"
            )
        else:
            parts.append(_figure(value))
    return "\n".join(parts)


def _words(picture: Image.Image) -> str:
    return str(picture.info.get("Description", "pictures of the example"))


def _figure(figure: Figure) -> str:
    """Return a figure as an element of a page of the gallery."""
    html = figure.to_html(
        full_html=False,
        include_plotlyjs=f"../../_static/{PLOTLY}",
        default_height="420px",
        config={"responsive": True},
    )
    lines = "\n".join(f"   {line}" for line in html.splitlines())
    return f".. raw:: html\n\n{lines}\n"


def _write_plotly(app: Sphinx, error: Exception | None) -> None:
    """Write the one file of plotly beside the built pages."""
    if error is None and app.builder.format == "html":
        static = Path(app.outdir) / "_static"
        static.mkdir(exist_ok=True)
        (static / PLOTLY).write_text(get_plotlyjs(), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Write plotly when all pages are built."""
    app.connect("build-finished", _write_plotly)
    return {"parallel_read_safe": True}
