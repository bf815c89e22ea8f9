"""Every document that is cited is in the repository, and so is the part of it that is meant."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.architecture.sources import ROOT

PLACES = ("lib", "daemons", "cli", "etc", "share", "tests", ".ci", ".")
"""Folders whose text may cite; of the root only its own files."""
TEXT = {".py", ".md", ".toml", ".json", ".yaml", ".yml", ".sh", ".service", ".conf", ".target", ""}
MADE = {"build", "dist", "node_modules", "target", "__pycache__"}
DOCUMENT = re.compile(r"(?<![\w/.*-])((?:[\w.-]+/)*[\w-]+\.md)\b")
MARKDOWN_LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)\s#]+)(?:#[^)]*)?\)")
DECISION = re.compile(r"\bADRs? (\d+)(?:(?:, | and |-|–| to )(\d+))*")
SECTION = re.compile(r"([\w/-]+\.md),? (?:section )?(\d+(?:\.\d+)*)")
PLACE = re.compile(
    r"(?<![\w/.$}-])((?:tests|lib|daemons|cli|etc/swarm|share/doc|share/swarm)/[\w/-]+(?:\.\w+)*)"
)
FENCED = re.compile(r"```.*?```", re.DOTALL)
TUTORIALS = "share/doc/tutorials/"
"""Pages whose blocks of code name files that the reader makes."""
BUILT = "share/doc/site"
"""The documentation site: only where `make docs` was run."""
ELSEWHERE = re.compile(
    r"scale study|the study\b|\bdesign,? section|\bissue of the\b|\bthe design\b", re.IGNORECASE
)
"""Names of documents that have no file, so a reader cannot open them."""


def texts() -> Iterator[tuple[str, str]]:
    for place in PLACES:
        folder = ROOT / place
        for path in sorted(folder.glob("*") if place == "." else folder.rglob("*")):
            if (
                path.is_file()
                and path.suffix in TEXT
                and not MADE & set(path.relative_to(ROOT).parts)
                and path != Path(__file__)
            ):
                yield str(path.relative_to(ROOT)), path.read_text("utf-8", errors="replace")


TEXTS = dict(texts())
DOCUMENTS = {name for name in TEXTS if name.endswith(".md")}
DECISIONS = {int(Path(name).name[:4]) for name in DOCUMENTS if re.search(r"/adr/\d{4}-", name)}
FORMER_ROW = re.compile(r"^\| (\d+) \| [^|]+ \| (?:\[(\d+)\]\((\d{4})-[^|]+|`[^`|]+\.py`) \|$", re.MULTILINE)
"""Number of a decision without a page any more, then the number and page of the decision that contains it;
a note on an algorithm is in the docstring of its module instead."""
FORMER_DECISIONS = [
    tuple(int(number or 0) for number in row) for row in FORMER_ROW.findall(TEXTS["share/doc/adr/README.md"])
]


def found(cited: str, by: str) -> str | None:
    """The document that is meant: from the root, beside the one who cites, or the only one of this name."""
    near = {os.path.normpath(Path(by).parent / cited), cited}
    named = [name for name in sorted(DOCUMENTS) if name in near or name.endswith(f"/{cited}")]
    return named[0] if named else None


def test_every_document_that_is_cited_is_in_repository() -> None:
    missing = [
        f"{name}: {cited}"
        for name, text in TEXTS.items()
        for cited in DOCUMENT.findall(FENCED.sub("", text) if TUTORIALS in name else text)
        if found(cited, name) is None
    ]
    assert missing == []


def test_every_path_that_is_cited_is_in_repository() -> None:
    missing = [
        f"{name}: {cited}"
        for name, text in TEXTS.items()
        if name != "pyproject.toml"  # where things go in a wheel
        for cited in PLACE.findall(text)
        if not (ROOT / cited).exists() and not cited.startswith(BUILT)
    ]
    assert missing == []


def test_section_cited_by_number_has_heading() -> None:
    missing = [
        f"{name}: {cited} {number}"
        for name, text in TEXTS.items()
        for cited, number in SECTION.findall(re.sub(r"\s+", " ", text))
        if (page := found(cited, name)) is not None
        and not re.search(rf"^#+ {re.escape(number)}\b", TEXTS[page], re.MULTILINE)
    ]
    assert missing == []


def test_every_decision_that_is_cited_has_its_page() -> None:
    cited = {
        (name, int(number))
        for name, text in TEXTS.items()
        for match in DECISION.finditer(re.sub(r"\s+", " ", text))
        for number in re.findall(r"\d+", match[0])
    }
    assert cited
    assert sorted(item for item in cited if item[1] not in DECISIONS) == []


def test_each_number_has_one_decision_or_former_row() -> None:
    numbers = [*DECISIONS, *(former for former, _, _ in FORMER_DECISIONS)]
    assert sorted(numbers) == list(range(1, max(numbers) + 1))


def test_former_decision_is_part_of_valid_decision() -> None:
    assert FORMER_DECISIONS
    moved = [row for row in FORMER_DECISIONS if row[1]]
    assert [row for row in moved if row[1] != row[2] or row[1] not in DECISIONS] == []


@pytest.mark.parametrize("name", sorted(DOCUMENTS))
def test_every_link_of_a_page_leads_somewhere(name: str) -> None:
    links = MARKDOWN_LINK.findall(TEXTS[name])
    assert [link for link in links if not ((ROOT / name).parent / link).exists()] == []


def test_no_text_rests_on_document_outside_repository() -> None:
    assert {name: ELSEWHERE.findall(text) for name, text in TEXTS.items() if ELSEWHERE.search(text)} == {}


PAGES = {
    name: TEXTS[name] for name in DOCUMENTS if Path(name).name not in {"types.md", "cli.md", "CHANGELOG.md"}
}
"""Documents that people write: neither generated pages nor the history."""
IDENTIFIER = re.compile(r"(?<![\w$])[A-Za-z_][A-Za-z0-9_]{2,}")
OF_OTHERS = {
    *("activating", "unprivileged_userns_clone", "toctree", "SWARMCTL_TRACEBACK", "arived"),
    *("nftables", "rclpy", "_part2", "_ned", "utimensat", "PREEMPT_RT", "u24", "u64", "u48", "i24", "i64"),
}
"""Words in backticks that are from other programs, composed by the code, types of the wire, or examples
of what is refused."""
SECTIONS = re.compile(r"\bsections? (\d+(?:\.\d+)?)(?:(?:, | and | to )(\d+(?:\.\d+)?))*")
IN_BRACKETS = re.compile(r"\((\d\.\d)[,)]")
"""How the page of the protocol cites a section of its own."""


@pytest.fixture(scope="module")
def code() -> set[str]:
    """Words of the code and of the names of files."""
    text = "\n".join(text for name, text in TEXTS.items() if name not in PAGES)
    names = " ".join(
        str(path.relative_to(ROOT)) for place in PLACES[:-1] for path in (ROOT / place).rglob("*")
    )
    return set(re.findall(r"[A-Za-z_]\w+", f"{text} {names} {' '.join(DOCUMENTS)}"))


@pytest.mark.parametrize("name", sorted(PAGES))
def test_name_in_backticks_is_one_of_code(name: str, code: set[str]) -> None:
    text = FENCED.sub("", PAGES[name])
    made = {word for block in FENCED.findall(PAGES[name]) for word in IDENTIFIER.findall(block)}
    cited = {word for quoted in re.findall(r"`([^`\n]+)`", text) for word in IDENTIFIER.findall(quoted)}
    assert sorted(cited - code - OF_OTHERS - (made if TUTORIALS in name else set())) == []


@pytest.mark.parametrize("name", sorted(PAGES))
def test_an_anchor_of_a_link_is_a_heading(name: str) -> None:
    for page, anchor in re.findall(r"\]\((?!https?:)([^)\s#]*)#([^)\s]+)\)", PAGES[name]):
        text = ((ROOT / name).parent / page if page else ROOT / name).read_text("utf-8")
        headings = {
            re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-")
            for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        }
        assert anchor in headings, f"{name}: {page}#{anchor}"


def test_section_that_protocol_cites_of_itself_has_heading() -> None:
    text = re.sub(r"RFC \d+[^)\n]*|\w+\.md[^)\n]*", "", PAGES["share/doc/protocol.md"])  # of other documents
    headings = set(re.findall(r"^#+ (\d+(?:\.\d+)?)", text, re.MULTILINE))
    cited = {number for match in SECTIONS.finditer(text) for number in re.findall(r"\d+(?:\.\d+)?", match[0])}
    in_brackets = set(IN_BRACKETS.findall(text))
    assert cited
    assert in_brackets
    assert sorted((cited | in_brackets) - headings) == []
