"""Check the links of the built site: every internal target exists, and nothing is loaded from a network.

``python docs/check_links.py docs/_build`` lists each fault as ``PAGE: what``, and fails if there is one.  Links that a
reader follows to other sites are not tried.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}  # by the browser itself
UNLOADED = {"canonical", "next", "prev", "search", "author", "index"}  # relations of <link> that load nothing
ELSEWHERE = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')\s]+)""")  # in a style sheet


class Page(HTMLParser):
    """The anchors of a page, its links, and the addresses that it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Note the anchors and addresses of a tag."""
        values = {name: value or "" for name, value in attributes}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        address = values.get(LOADED.get(tag, ""))
        if address is not None and values.get("rel") not in UNLOADED:
            self.loaded.append(address)
        elif tag == "a" and "href" in values:
            self.links.append(values["href"])


read = cache(Page)


def faults(site: Path) -> Iterator[str]:
    """Yield the faults of all pages of a site."""
    for path in sorted(set(site.rglob("*.html")) - set(site.glob("_static/**/*"))):
        page = read(path)
        for address in page.loaded:
            if urlsplit(address).netloc:
                yield f"{path.relative_to(site)}: loads {address}"
        for address in page.loaded + page.links:
            fault = broken(path, address)
            if fault:
                yield f"{path.relative_to(site)}: {address} {fault}"
    for path in sorted(site.rglob("*.css")):
        for address in ELSEWHERE.findall(path.read_text()):
            yield f"{path.relative_to(site)}: loads {address}"


def broken(path: Path, address: str) -> str:
    """Return the reason why an address in a page leads nowhere; empty if it leads somewhere or to another site."""
    parts = urlsplit(address)
    if parts.scheme or parts.netloc:
        return ""
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
    if not target.is_file():
        return "does not exist"
    if parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in read(target).anchors:
        return "has no such anchor"
    return ""


if __name__ == "__main__":
    site = Path(sys.argv[1])
    if not (site / "index.html").is_file():
        sys.exit(f"{site} holds no site; build it first")
    found = list(faults(site.resolve()))
    print("\n".join(found) or "all links lead somewhere")
    sys.exit(bool(found))
