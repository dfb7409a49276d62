"""Pieces of a page: text made safe, templates filled, scripts that the page's own rules let run."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from prf import __version__
from prf.shell.cli.files import encoded
from prf.shell.cli.storage import jsonable

_PLACE = re.compile(r"\{\{(\w+)\}\}")


def escape(text: object) -> str:
    """Return text that is shown as it is, in elements and in quoted attributes."""
    return html.escape(str(text), quote=True)


def asset(name: str, package: str = "prf.shell.cli.page") -> str:
    """Return a template, style sheet or script of a package."""
    return files(package).joinpath("assets", name).read_text(encoding="utf-8")


def page(
    package: str, name: str, content: Mapping[str, str], scripts: Iterable[tuple[str, str]], more: str = ""
) -> tuple[str, str]:
    """Return the page `name` of a package, with what all pages share, and its content security policy.

    `content`: of the template. `scripts`: package and name of each, in the order in which they run, after the shared
    ones. `more`: of the policy.
    """
    head, body = [asset("theme.js")], [asset("page.js"), asset("canvas.js")]
    body += [asset(script, owner) for owner, script in scripts]
    policy = (
        f"default-src 'none'; script-src {script_sources([*head, *body])}; style-src 'unsafe-inline'; "
        f"img-src data: blob:; base-uri 'none'; form-action 'none'{more}"
    )
    shared = {
        "policy": policy,
        "style": asset("common.css") + asset(f"{name}.css", package),
        "theme": script_tags(head),
        "scripts": script_tags(body),
        "version": escape(__version__),
    }
    return fill(asset(f"{name}.html", package), {**content, **shared}), policy


def fill(template: str, content: Mapping[str, str]) -> str:
    """Return a template with every ``{{name}}`` replaced, once: values are not searched again."""
    return _PLACE.sub(lambda match: content[match.group(1)], template)


def script_tags(scripts: Iterable[str]) -> str:
    """Return scripts as elements of a page."""
    return "\n".join(f"<script>{_closed(script)}</script>" for script in scripts)


def script_sources(scripts: Iterable[str]) -> str:
    """Return what a content security policy calls scripts: digests, so that no other script can run."""
    digests = (hashlib.sha256(_closed(script).encode()).digest() for script in scripts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def _closed(script: str) -> str:
    """Return a script in which nothing ends its element early; in strings, the only place for it, that is the same."""
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def packed(content: bytes) -> str:
    """Return bytes as compressed text that no parser of pages mistakes for markup."""
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()


def packed_json(content: Any) -> str:
    """Return an object as JSON, as :func:`packed`."""
    text = json.dumps(jsonable(content), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return packed(encoded(text))


def table(head: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]], kind: str) -> str:
    """Return a table of cells that are markup already; each row with its attributes."""
    names = "".join(f'<th scope="col">{name}</th>' for name in head)
    lines = "".join(
        f"<tr{attributes}>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>" for attributes, cells in rows
    )
    return f'<table class="{kind}"><thead><tr>{names}</tr></thead><tbody>{lines}</tbody></table>'
