"""The field's language: no private words, docstrings with content, and no class name with two meanings."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from tests.architecture.sources import ROOT, ROOTS, nodes, parsed, walked

SOURCES = [
    path
    for folder in ROOTS
    for path in sorted((ROOT / folder).rglob("*.py"))
    if "__pycache__" not in path.parts
]
FRONT_PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
"""Documents that are read before any other."""
LONGEST: Final = {**dict.fromkeys(FRONT_PAGES, 110), ROOT / "share/doc/architecture.md": 449}
"""Lines of a page that is read in five minutes, and of the architecture, which fits one reading."""
PAGES = [
    path
    for path in (*FRONT_PAGES, *sorted((ROOT / "share/doc").rglob("*.md")))
    if path.name != "requirements.md"
]
"""Documents; the page of requirements quotes the sources of the capabilities and the names of tests."""
TESTS = sorted((ROOT / "tests").rglob("*.py"))
SHORTEST: Final = 4
"""Words of a docstring: fewer leave out the subject or the object."""
TWICE: Final = frozenset({"Config"})
"""Each daemon has a `Config` below its core, which the service runner finds by that name."""
TERMS: Final = frozenset({"HEARD"})
"""Identifiers that are standard terms: a link state of NHDP (RFC 6130, section 5.5)."""

IN_NAMES: Final = {
    "heard": "received; for a class: what was received",
    "wrong": "error, invalid",
    "most": "max",
    "least": "min",
    "said": "reported, announced",
}
"""Private words in identifiers, and the terms of the field; in a sentence they are plain words."""
ANYWHERE: Final = {
    "told": "announced, acknowledged, sent, reported",
    r"(?<!\.)tells?|telling": "announce, report, send, distinguish",
    "wish(?:es|ed)?": "subscription, request, specification",
    "anew": "again",
    "doubt(?:s|ed|ful)?": "variance, suspect, to be verified",
    "goodbyes?": "leave message",
    "newborn": "starting",
    "accumulators?": "battery",
    "akin": "same_epoch",
    "heritage": "inherited epoch",
    "bury|buries|buried": "remove, clean up",
    "strangers?": "unknown platform, unknown process",
    "hurry|hurries|hurried": "urgent",
    "restless": "livelock",
    "rumours?": "indirect report",
}
"""Private words in identifiers and in sentences, and the terms of the field."""
IN_TEXTS: Final = {
    "stands? there": "exists, is present, is defined",
    "no more(?! than)": "no longer, not any more",
    "manieth": "every n-th",
    "will not have it": "refuses",
    r"(?<!there )(?:is|are|was|were) no(?! (?:longer|more|other|one|such|better|worse|less)\b)": "is not a",
    "whoever": "the process, member or caller that",
    "somebody(?:'s)?": "another process, another member",
    "nobody(?:'s)?": "no process, no member, no operator",
    r"goes on(?! (?:the|a) )|go on\b|going on": "continues",
    "comes? back|came back": "restarts, returns, is reachable again",
    "stands? still": "is at rest, does not change",
    "lets? go of": "closes, releases",
    r"(?:gives?|given|gave) (?:\w+ )?back": "returns, releases",
    r"(?:takes?|taken|took) (?:\w+ )?away": "removes",
    "for people": "text for operators",
    "at first hand": "directly",
    "hand(?:s|ed)? (?:it |them )?out": "dispatch, assign",
    "signs? of life": "heartbeat",
    "(?:not |un)?heard (?:of|from|for)|unheard": "received",
    r"so (?:many|much|few|often)\b(?! (?:that|as)\b)": "a number of, at most n",
    "for so long|so long (?:ago|after)": "the time after which, for n seconds",
    "what is there": "the contents, the present state",
    "wants? to|wanted to": "requests, needs to",
    "right behind each other": "together, without a pause",
    "look(?:s|ed|ing)? (?:at|after|whether)": "checks, reads, inspects",
    "tak(?:e|es|en) for": "counts as, is mistaken for",
    "by chance": "at random",
    "nothing of": "no data of",
    "from scratch": "with a new interpreter, without a former state",
    "hearsay": "relayed, not authenticated by its origin",
    "believ(?:e|es|ed)": "accepts, trusts",
    "honest": "valid",
    "hears?|hearing": "receives",
    "newcomers?": "new node",
    "owed|owes": "pending",
    "as it came": "unchanged",
    "every(?:body|one)|any(?:body|one)": "all members, all nodes",
    "way back": "return, connection for answers",
    r"(?<!those )(?-i:Who) (?:has|is|\w+s)\b": "the process, node or user that",
}
"""Private phrases in sentences, and the terms of the field."""
NAMES: Final = {re.compile(form): instead for form, instead in (IN_NAMES | ANYWHERE).items()}
"""Whole parts of an identifier: of `told_ns`, `_told`, `Told`."""
PROSE: Final = {
    re.compile(rf"\b({form})\b", re.IGNORECASE): instead for form, instead in (ANYWHERE | IN_TEXTS).items()
}
"""In docstrings, comments, messages."""
ANY_IN_PROSE: Final = re.compile("|".join(form.pattern for form in PROSE), re.IGNORECASE)
"""Most texts have none of the words: one search in place of one for each."""


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


GRAMMAR: Final = {
    re.compile(pattern): instead
    for pattern, instead in (
        (r"; (?:[Nn]one|[Ee]mpty|left out|[-−]?[01]|[Ff]alse|[Tt]rue): ", "or None if …"),
        (r"; (?:absent|null|negative): ", "or null if …, or a negative number if …"),
        (r"; (?:None|[Ee]mpty) (?:if|when|without|where|before|while)\b", "or None if …"),
        (r"; whether\b", "returns True if …, and it is not known whether …"),
        (r"\b[Tt]h(?:at|ose) of\b", "the noun in place of the pronoun"),
        (r"\b[Oo]nes? that\b", "the noun in place of the pronoun"),
        (r"\bis none\b", "is missing, is not known"),
        (r"\b[Ww]hat (?:was|were) \w+ed\b", "a noun, such as `measurement`"),
    )
}
"""Telegraph style, and pronouns in place of nouns, which a reader of one line does not understand."""


def test_a_line_of_prose_names_its_subject() -> None:
    found = [
        f"{name(path)}:{line}: {text!r}; expected {instead}"
        for path in [*SOURCES, *PAGES, *TESTS]
        for line, text, instead in telegraphic(path)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Pause; None: no limit.", 1),
        ("Path; empty: the document.", 1),
        ("Descriptor; -1: closed.", 1),
        ("Record; absent: not drained.", 1),
        ("Result; null: the motors are calibrated.", 1),
        ("Exit code; negative: the signal.", 1),
        ("Fence in the map; None while the origin is not known.", 1),
        ("Members; empty without keys.", 1),
        ("Set the patterns; whether they changed.", 1),
        ("Asked whether they changed.", 0),
        ("Stamp of the value, or None without a value.", 0),
        ("The rate, or that of its owner.", 1),
        ("One that was lost is repeated.", 1),
        ("A key that is none is refused.", 1),
        ("It records what was measured.", 1),
        ("It holds what is needed.", 0),
    ],
)
def test_telegraph_style_is_found_in_prose(text: str, found: int) -> None:
    assert sum(bool(pattern.search(text)) for pattern in GRAMMAR) == found


def test_names_and_texts_use_terms_of_field() -> None:
    found = [
        f"{name(path)}:{line}: {text!r}; expected {instead}"
        for path in SOURCES
        for line, text, instead in uses(path)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("page", LONGEST, ids=name)
def test_page_is_not_too_long_to_read(page: Path) -> None:
    assert len(page.read_text("utf-8").splitlines()) <= LONGEST[page]


def test_documents_use_the_terms_of_the_field() -> None:
    found = [
        f"{name(path)}:{line}: {text!r}; expected {instead}"
        for path in PAGES
        for line, text, instead in found_in(
            1, re.sub(r"`[^`\n]*`|\]\([^)]*\)", "` `", path.read_text("utf-8"))
        )
    ]
    assert not found, "\n".join(found)


def test_a_class_name_has_one_meaning() -> None:
    found = [
        f"class {cls} is defined {len(files)} times: {', '.join(files)}; expected one meaning of a name"
        for cls, files in classes().items()
        if len(files) > 1 and cls not in TWICE
    ]
    assert not found, "\n".join(found)


def test_a_public_docstring_has_four_words_or_more() -> None:
    found = [
        f"{name(path)}:{line}: {text!r}; expected {SHORTEST} words or more: subject, verb, object"
        for path in SOURCES
        for line, text in docstrings(parsed(path))
        if len(re.findall(r"[\w'-]+", text)) < SHORTEST
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("Its owner is told.", "told"),
        ("The file is no table.", "is no"),
        ("There is no table.", ""),
        ("Whoever holds the lock decides.", "whoever"),
        ("Nobody writes this ring.", "nobody"),
        ("The writer goes on where it stopped.", "goes on"),
        ("Not heard for 5 s.", "not heard for"),
        ("The subscriber receives each value once.", ""),
        ("Spend so many bytes.", "so many"),
        ("A service that ran for so long is restarted.", "for so long"),
        ("Who gets the lock writes the record.", "who gets"),
        ("A relayed value is hearsay.", "hearsay"),
        ("The other node hears it.", "hears"),
    ],
)
def test_the_words_are_found_in_prose(text: str, word: str) -> None:
    found = [hit[0].lower() for form in PROSE for hit in form.finditer(text)]
    assert found == ([word] if word else [])


def telegraphic(path: Path) -> Iterator[tuple[int, str, str]]:
    """Places that name no subject: line, text, and what is expected instead."""
    source = path.read_text("utf-8")
    if path.suffix != ".py":
        source = re.sub(r"`[^`\n]*`", "` `", source)  # quoted code and examples
    if not any(pattern.search(source) for pattern in GRAMMAR):
        return  # to split a file into its strings and comments takes much longer than to search it
    for begin, text in prose(source) if path.suffix == ".py" else [(1, source)]:
        if path.is_relative_to(ROOT / "tests") and not text.startswith(('"""', "#")):
            continue  # data of a test
        for pattern, instead in GRAMMAR.items():
            for hit in pattern.finditer(text):
                line = begin + text.count("\n", 0, hit.start())
                yield line, text[max(0, hit.start() - 30) : hit.end() + 20], instead


def uses(path: Path) -> Iterator[tuple[int, str, str]]:
    """Private words of a file: line, the identifier or the text around the word, and what is expected."""
    source = path.read_text()
    for line, identifier in defined(parsed(path)):
        parts = [part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)]
        for i, part in enumerate(parts):
            # `tell` of a file object; `at_least`, `at_most`
            if identifier == "tell" or identifier in TERMS or (i and parts[i - 1] == "at"):
                continue
            yield from (
                (line, identifier, instead) for form, instead in NAMES.items() if form.fullmatch(part)
            )
    if ANY_IN_PROSE.search(source):
        for line, text in prose(source):
            yield from found_in(line, text)


def found_in(line: int, text: str) -> Iterator[tuple[int, str, str]]:
    if not ANY_IN_PROSE.search(text):
        return
    for form, instead in PROSE.items():
        for hit in form.finditer(text):
            found = line + text.count("\n", 0, hit.start())
            yield found, text[max(0, hit.start() - 30) : hit.end() + 20], instead


def defined(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Identifiers where they are made: classes, functions, parameters, variables, attributes."""
    for node in walked(tree):
        match node:
            case ast.ClassDef(name=found) | ast.FunctionDef(name=found) | ast.AsyncFunctionDef(name=found):
                yield node.lineno, found
            case ast.arg(arg=found):
                yield node.lineno, found
            case ast.Name(id=found, ctx=ast.Store()) | ast.Attribute(attr=found, ctx=ast.Store()):
                yield node.lineno, found
            case ast.MatchAs(name=str(found)) | ast.MatchStar(name=str(found)):
                yield node.lineno, found


def prose(source: str) -> Iterator[tuple[int, str]]:
    """Comments, and strings of more than one word: docstrings, help, messages."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and " " in token.string):
            yield token.start[0], token.string


def classes() -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(name(path))
    return found


def docstrings(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Docstrings of a module and of its public classes, functions and methods: line, text."""
    if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return
    if (text := ast.get_docstring(node)) is not None:
        yield node.body[0].lineno, text
    if isinstance(node, ast.Module | ast.ClassDef):
        for inner in node.body:
            if not getattr(inner, "name", "").startswith("_"):
                yield from docstrings(inner)
