"""Pictures as notebooks show them."""

from __future__ import annotations

import base64
import os
from pathlib import Path


class Picture:
    """A picture in SVG."""

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to a file."""
        Path(path).write_text(self.svg, encoding="utf-8")

    def html(self, about: str) -> str:
        """It as an image of its own in HTML, so that names in it meet no others; `about` is already safe."""
        data = base64.b64encode(self.svg.encode()).decode()
        return f'<img alt="{about}" style="max-width: 100%" src="data:image/svg+xml;base64,{data}">'
