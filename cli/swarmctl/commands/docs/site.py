"""The pages of the documentation site on this machine."""

import webbrowser
from difflib import get_close_matches
from pathlib import Path

import msgspec

from swarmctl.terminal.output import Output
from swarmware.errors import NotFound, SwarmError
from swarmware.model.config import share_dir


class DocumentationPage(msgspec.Struct, frozen=True):
    """A page of the documentation on this machine."""

    path: str
    """The HTML file."""
    url: str
    """Address of the file for a browser."""
    opened: bool
    """Whether a browser was started with it."""


def site() -> Path:
    """Folder of the built documentation.

    Raises: NotFound where it was not built.
    """
    share = share_dir().parent
    places = (
        share / "doc" / "site",
        share / "doc" / "swarmware" / "site",
    )  # of a checkout, of an installation
    for place in places:
        if (place / "index.html").is_file():
            return place
    if (share / "doc" / "conf.py").is_file():
        raise NotFound(
            f"documentation: {places[0]} is not built; expected its index.html: run `make docs` in "
            f"{share.parent}. The pages as text are in {share / 'doc'}"
        )
    raise NotFound(
        f"documentation: not in this installation; expected {places[1] / 'index.html'}, which a wheel of "
        "`make dist` contains"
    )


def page_names() -> list[str]:
    """Names of the pages: paths below the site without their ending.

    Raises: NotFound where the site was not built.
    """
    folder = site()
    return sorted(str(path.relative_to(folder).with_suffix("")) for path in folder.rglob("*.html"))


def show_page(name: str, out: Output, *, only_path: bool) -> None:
    """Open a page in a browser, or only print where it is.

    Raises: NotFound for a page that does not exist, SwarmError without a browser.
    """
    names = page_names()
    wanted = name.removesuffix(".html").removesuffix(".md").strip("/")
    found = wanted if wanted in names else f"{wanted}/index"
    if found not in names:
        near = get_close_matches(wanted, names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"expected one of {', '.join(names)}"
        raise NotFound(f"page {name!r}: not in the documentation; {hint}")
    path = site() / f"{found}.html"
    if not only_path and not webbrowser.open(path.as_uri()):
        raise SwarmError(f"no browser: expected one on PATH or in $BROWSER; the page is {path}")
    if out.settings.structured:
        out.document(DocumentationPage(str(path), path.as_uri(), opened=not only_path))
    elif only_path:
        out.verbatim(str(path))
    else:
        out.say(f"opened {path.as_uri()}")
