"""`swarmctl docs` opens the page, or prints a message if the page is missing."""

import json
import pydoc
import re
from pathlib import Path

import pytest

import swarmware
from swarmctl.commands.new.scaffold import KINDS
from swarmctl.main import main as swarmctl

opened: list[str] = []
PLACES = {"checkout": "doc/site", "installation": "doc/swarmware/site"}


def open_page(url: str) -> bool:
    opened.append(url)
    return True


@pytest.fixture
def share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder `share` of an installation without documentation, and a browser that notes what it opens."""
    (tmp_path / "share/swarm/templates").mkdir(parents=True)
    monkeypatch.setenv("SWARM_SHARE", str(tmp_path / "share/swarm"))
    opened.clear()
    monkeypatch.setattr("webbrowser.open", open_page)
    return tmp_path / "share"


@pytest.fixture(params=PLACES)
def site(request: pytest.FixtureRequest, share: Path) -> Path:
    folder = share / PLACES[request.param]
    for name in ("index.html", "cli.html", "howto/index.html", "howto/logs.html"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("<html>")
    return folder


def test_the_first_page_is_opened_from_its_file(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl(["docs"]) == 0
    assert opened == [(site / "index.html").as_uri()]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("name", "file"),
    [("cli", "cli.html"), ("howto", "howto/index.html"), ("howto/logs.html", "howto/logs.html")],
)
def test_a_page_is_opened_by_its_name(site: Path, name: str, file: str) -> None:
    assert swarmctl(["docs", name]) == 0
    assert opened == [(site / file).as_uri()]


def test_only_the_path_is_printed(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl(["docs", "--path"]) == 0
    assert (capsys.readouterr().out, opened) == (f"{site / 'index.html'}\n", [])


@pytest.mark.parametrize("options", [[], ["--path"]])
def test_the_document_has_path_and_address(
    site: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl(["docs", "-o", "json", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    page = site / "index.html"
    assert (found["path"], found["url"]) == (str(page), page.as_uri())
    assert found["opened"] == bool(opened) == (not options)


def test_unknown_page_is_refused_with_nearest_name(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl(["docs", "howto/log"]) == 6
    assert "did you mean 'howto/logs'?" in capsys.readouterr().err
    assert opened == []


def test_a_page_outside_of_the_site_is_refused(site: Path) -> None:
    (site.parent / "other.html").write_text("<html>")
    assert swarmctl(["docs", "../other"]) == 6
    assert opened == []


def test_checkout_without_site_names_building_command(
    share: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (share / "doc").mkdir()
    (share / "doc/conf.py").touch()
    assert swarmctl(["docs"]) == 6
    error = capsys.readouterr().err
    assert "run `make docs`" in error
    assert str(share / "doc") in error


def test_installation_without_site_says_where_it_would_be(
    share: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl(["docs", "-o", "json"]) == 6
    error = json.loads(capsys.readouterr().err)["error"]
    assert str(share / PLACES["installation"] / "index.html") in error
    assert "make docs" not in error


def test_without_a_browser_the_path_is_named(
    site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert swarmctl(["docs"]) == 1
    assert str(site / "index.html") in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("swarmware", "`swarmctl docs` opens the documentation"),
        ("swarmware", "`swarmctl docs tutorials`"),
        ("swarmware", "`swarmctl docs reference/library`"),
        ("swarmware", "`swarmctl new module NAME`"),
        ("swarmware", "share/swarm/examples"),
        ("swarmware", "variable SWARM_CONFIG, else /etc/swarm"),
        ("swarmware.Module", "joins the node"),
        ("swarmware.Service", "run"),
    ],
)
def test_the_help_of_python_says_where_to_look(name: str, words: str) -> None:
    shown = re.sub(r"\s+", " ", pydoc.plain(pydoc.render_doc(name)))
    assert words in shown


def test_what_the_help_of_python_names_exists() -> None:
    text = swarmware.__doc__ or ""
    root = Path(__file__).parents[3]
    pages = re.findall(r"`swarmctl docs ([\w/]+)`", text)
    assert len(pages) == 2
    for page in pages:
        assert any((root / "share/doc" / f"{page}{end}").is_file() for end in (".md", "/index.md")), page
    assert re.findall(r"\bnew (\w+)", text) == list(KINDS)
    assert all((root / place).is_dir() for place in re.findall(r"\bshare/\w+(?:/\w+)*", text))
