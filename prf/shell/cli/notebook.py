"""What Python calls show: progress while they work, and a card with a picture in a notebook when they are done."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from prf.shell.cli.progress import Reporter, Silent, progress

ProgressCallback = Callable[[float, Mapping[str, object]], None]
"""What a caller may give instead of True: it gets the share that is done, and what a bar shows beside it."""

MOST_BYTES = 70_000
"""Of the picture of a card: a notebook keeps every card that it shows."""


class _Caller:
    """Reports to a callable."""

    def __init__(self, callback: ProgressCallback, total: float) -> None:
        self._callback, self._total = callback, total

    def update(self, completed: float, **fields: object) -> None:
        """Call it with the share that is done."""
        self._callback(completed / self._total, fields)


@contextmanager
def reported(wanted: bool | ProgressCallback, total: float, description: str) -> Iterator[Reporter]:
    """Yield what long work reports to; `total` and `description` as in :func:`prf.shell.cli.progress.progress`.

    `wanted`: True: a bar on a terminal or in a notebook, elsewhere a line every ten seconds. False: nothing. A callable
    gets the share in [0, 1] and a mapping of what the bar would show beside it.
    """
    if callable(wanted):
        yield _Caller(wanted, total)
    elif not wanted:
        yield Silent()
    else:
        with progress(total, description) as reporter:
            yield reporter


def card(title: str, facts: Mapping[str, str], png: bytes | None = None) -> str:
    """Return the HTML of a result for a notebook: a table of facts, and a small copy of a picture if there is one."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    picture = ""
    if png is not None:
        data = base64.b64encode(small_copy(png)).decode("ascii")
        picture = f"<img alt='{html.escape(title)}' style='max-width:100%' src='data:image/png;base64,{data}'>"
    return f"<div><b>{html.escape(title)}</b><table>{rows}</table>{picture}</div>"


def small_copy(png: bytes) -> bytes:
    """Return a picture in few colours, scaled down until it has at most `MOST_BYTES`."""
    from PIL import Image  # matplotlib brings it

    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.thumbnail((960, 960))
    while True:
        buffer = io.BytesIO()
        picture.quantize(32, kmeans=3, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
        if buffer.tell() <= MOST_BYTES:
            return buffer.getvalue()
        picture = picture.resize((picture.width * 9 // 10, picture.height * 9 // 10), Image.Resampling.LANCZOS)
