"""The documentation site, built once: complete, readable and searchable without a network."""

import json
import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "share/doc"


class Addresses(HTMLParser):
    """What a browser loads for a page, where its links lead, and the anchors in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors.add(given.get("id", ""))
        self.loaded += [given[name] for name in ("src", "poster", "data", "srcset") if name in given]
        if tag == "link" and given.get("rel") != "canonical":
            self.loaded.append(given["href"])
        elif tag == "a" and "href" in given:
            self.links.append(given["href"])


pytestmark = pytest.mark.timeout(600)  # the first test may build the whole site on a busy computer


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the site that SWARM_SITE names, or of a site that is built here."""
    if built := os.environ.get("SWARM_SITE"):
        return Path(built)
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        ["make", "site", f"SITE={folder}"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Addresses]:
    return {path: Addresses(path.read_text("utf-8")) for path in site.rglob("*.html")}


def test_every_markdown_page_is_on_the_site(site: Path) -> None:
    made = {str(path.relative_to(site).with_suffix("")) for path in site.rglob("*.html")}
    written = {str(path.relative_to(PAGES).with_suffix("")) for path in PAGES.rglob("*.md")}
    assert written - made == set()
    assert len(written) > 40


def test_every_page_is_linked_from_index(site: Path, pages: dict[Path, Addresses]) -> None:
    reached, ahead = set(), [site / "index.html"]
    while ahead:
        page = ahead.pop()
        if page in reached or page not in pages:
            continue
        reached.add(page)
        ahead += [(page.parent / unquote(urlsplit(link).path)).resolve() for link in pages[page].links]
    # the field on every page leads to the search
    assert {str(page.relative_to(site)) for page in set(pages) - reached} == {"search.html"}


def test_a_page_loads_nothing_from_a_network(site: Path, pages: dict[Path, Addresses]) -> None:
    away = re.compile(r"^(?:\w+:)?//")
    assert {path.name: url for path, page in pages.items() for url in page.loaded if away.match(url)} == {}
    for style in site.rglob("*.css"):
        assert re.findall(r"(?:url\(|@import)\s*['\"]?(?:\w+:)?//[^)]*", style.read_text()) == [], style
    inline = [
        text for path in pages for text in re.findall(r"<style.*?</style>", path.read_text(), re.DOTALL)
    ]
    assert [text for text in inline if "//" in text or "@import" in text] == []


def test_resources_and_links_of_page_exist(site: Path, pages: dict[Path, Addresses]) -> None:
    missing = []
    for path, page in pages.items():
        for url in [*page.loaded, *page.links]:
            parts = urlsplit(url)
            if parts.scheme or not (parts.path or parts.fragment):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[target].anchors if target in pages else {parts.fragment}
            # the page of the search links to itself, the theme to the top of a page
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in anchors | {"top"}):
                missing.append(f"{path.relative_to(site)}: {url}")
    assert missing == []


def test_search_works_on_page_from_file(site: Path, pages: dict[Path, Addresses]) -> None:
    scripts = {urlsplit(url).path for url in pages[site / "search.html"].loaded}
    assert {"searchindex.js", "_static/searchtools.js", "_static/language_data.js"} <= scripts
    # a browser refuses `fetch` to a page from a file; only summaries of the results are fetched
    assert "SHOW_SEARCH_SUMMARY: false" in (site / "_static/documentation_options.js").read_text()
    assert (site / "searchindex.js").read_text("utf-8").startswith("Search.setIndex({")


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node, to run the script of the search page")
@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("quorum", "missions"),
        ("swarmctl mission abort", "cli"),
        ("doorbells", "protocol"),
        ("BatteryState", "types"),
    ],
)
def test_the_search_finds_a_page_by_its_words(site: Path, words: str, page: str) -> None:
    script = Path(__file__).with_name("search.js")
    done = subprocess.run(["node", script, site, words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert page in json.loads(done.stdout)[:10]
