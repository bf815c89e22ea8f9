"""The field's language: no private words, and no class name with two meanings.

`language.toml` lists what is still to be renamed, by file. The list only shrinks: an entry that is not needed
any more must go (`.venv/bin/python tests/architecture/test_language.py` removes it), and a new file is never
put on it; a file that moves takes its entry along.
"""

import ast
import io
import re
import tokenize
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

ROOT = Path(__file__).parents[2]
EXCEPTIONS = Path(__file__).with_name("language.toml")
SOURCES = [
    path
    for folder in ("lib", "daemons", "cli")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if "__pycache__" not in path.parts
]
SHORTEST: Final = 4
"""Words of a docstring: fewer leave out the subject or the object."""
LONGEST: Final = 67
"""Entries when the list was made: it is never longer."""

INSTEAD: Final = {
    "told": "announced, acknowledged, sent, reported",
    "tell": "announce, report, send, distinguish",
    "heard": "received; for a class: what was received",
    "wish": "subscription, request, specification",
    "anew": "again",
    "doubt": "variance, suspect, to be verified",
    "goodbye": "leave message",
    "newborn": "starting",
    "wrong": "error, invalid",
    "most": "max",
    "least": "min",
    "accumulator": "battery",
    "akin": "same_epoch",
    "heritage": "inherited epoch",
    "bury": "remove, clean up",
    "stranger": "unknown platform, unknown process",
    "hurry": "urgent",
    "restless": "livelock",
    "rumour": "indirect report",
    "said": "reported, announced",
    "stands there": "exists, is present, is defined",
    "no more": "no longer, not any more",
    "manieth": "every n-th",
    "will not have it": "refuses",
    "is no": "is not a",
}
"""Private words, and what the field says."""

IN_NAMES: Final = {
    word: re.compile(pattern)
    for word, pattern in {
        "told": r"told",
        "tell": r"tells?|telling",
        "heard": r"heard",
        "wish": r"wish(es)?",
        "anew": r"anew",
        "doubt": r"doubt(s|ed|ful)?",
        "goodbye": r"goodbyes?",
        "newborn": r"newborn",
        "wrong": r"wrong",
        "most": r"most",
        "least": r"least",
        "accumulator": r"accumulators?",
        "akin": r"akin",
        "heritage": r"heritage",
        "bury": r"bury|buried",
        "stranger": r"strangers?",
        "hurry": r"hurry|hurries|hurried",
        "restless": r"restless",
        "rumour": r"rumours?",
        "said": r"said",
    }.items()
}
"""Whole parts of an identifier: of `told_ns`, `_told`, `Told`."""

IN_PROSE: Final = {
    word: re.compile(rf"\b({pattern})\b", re.IGNORECASE)
    for word, pattern in {
        "told": r"told",
        "tell": r"(?<!\.)tells?|telling",
        "wish": r"wish|wishes|wished",
        "anew": r"anew",
        "doubt": r"doubt(s|ed|ful)?",
        "goodbye": r"goodbyes?",
        "newborn": r"newborn",
        "accumulator": r"accumulators?",
        "akin": r"akin",
        "heritage": r"heritage",
        "bury": r"bury|buries|buried",
        "stranger": r"strangers?",
        "hurry": r"hurry|hurries|hurried",
        "restless": r"restless",
        "rumour": r"rumours?",
        "stands there": r"stands? there",
        "no more": r"no more(?! than)",
        "manieth": r"manieth",
        "will not have it": r"will not have it",
        "is no": r"(?<!there )(?:is|are|was|were) no(?! (?:longer|more|other|one|such|better|worse|less)\b)",
    }.items()
}
"""In docstrings, comments, messages."""


def test_names_and_texts_use_the_terms_of_the_field() -> None:
    listed = exceptions()
    found = [
        f"{name(path)}:{line}: {text!r} uses {word!r}; expected {INSTEAD[word]}"
        for path in SOURCES
        for word, line, text in uses(path)
        if word not in listed.get(name(path), ())
    ]
    assert not found, "\n".join(found)


def test_what_has_been_renamed_is_taken_off_the_list() -> None:
    stale = [f"remove {word!r} at {file!r}" for file, word in superfluous()]
    assert not stale, f"{removal()}\n" + "\n".join(stale)


def test_a_class_name_has_one_meaning() -> None:
    listed = tomllib.loads(EXCEPTIONS.read_text())["classes"]
    found = [
        f"class {cls} is defined {len(files)} times: {', '.join(files)}; expected one meaning of a name"
        for cls, files in classes().items()
        if len(files) > 1 and cls not in listed
    ]
    assert not found, "\n".join(found)


def test_a_class_name_that_has_one_meaning_is_taken_off_the_list() -> None:
    stale = [f"remove {cls!r} from [classes]" for cls in single()]
    assert not stale, f"{removal()}\n" + "\n".join(stale)


def test_a_public_docstring_has_four_words_or_more() -> None:
    found = [
        f"{name(path)}:{line}: {text!r}; expected {SHORTEST} words or more: subject, verb, object"
        for path in SOURCES
        for line, text in docstrings(ast.parse(path.read_text()))
        if len(re.findall(r"[\w'-]+", text)) < SHORTEST
    ]
    assert not found, "\n".join(found)


def test_the_list_is_never_longer_than_it_was() -> None:
    listed = tomllib.loads(EXCEPTIONS.read_text())
    assert sum(map(len, listed["files"].values())) + len(listed["classes"]) <= LONGEST


def exceptions() -> dict[str, list[str]]:
    found: dict[str, list[str]] = tomllib.loads(EXCEPTIONS.read_text())["files"]
    return found


def removal() -> str:
    where = EXCEPTIONS.relative_to(ROOT)
    return (
        f"{where} lists what is not needed any more; edit it, or run: .venv/bin/python {name(Path(__file__))}"
    )


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@cache
def uses(path: Path) -> list[tuple[str, int, str]]:
    """Private words of a file: the word, its line, the identifier or the text around it."""
    return list(_uses(path))


def _uses(path: Path) -> Iterator[tuple[str, int, str]]:
    source = path.read_text()
    for line, identifier in defined(ast.parse(source)):
        parts = [part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)]
        for i, part in enumerate(parts):
            if identifier == "tell" or (i and parts[i - 1] == "at"):  # of a file object; at_least, at_most
                continue
            yield from ((word, line, identifier) for word, form in IN_NAMES.items() if form.fullmatch(part))
    for line, text in prose(source):
        for word, form in IN_PROSE.items():
            for hit in form.finditer(text):
                yield (
                    word,
                    line + text.count("\n", 0, hit.start()),
                    text[max(0, hit.start() - 30) : hit.end() + 20],
                )


def defined(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Identifiers where they are made: classes, functions, parameters, variables, attributes."""
    for node in ast.walk(tree):
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


@cache
def classes() -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
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


def superfluous() -> list[tuple[str, str]]:
    """Entries of the list that nothing needs: (file, word)."""
    used = {name(path): {word for word, _, _ in uses(path)} for path in SOURCES}
    return [
        (file, word)
        for file, words in exceptions().items()
        for word in words
        if word not in used.get(file, ())
    ]


def single() -> list[str]:
    """Class names on the list that are defined once, or not at all."""
    found = classes()
    return [cls for cls in tomllib.loads(EXCEPTIONS.read_text())["classes"] if len(found.get(cls, ())) < 2]


def remove_superfluous() -> None:
    """Takes off the list what it need not have; blank lines between entries stay, so that removals merge."""
    text = EXCEPTIONS.read_text()
    for file, word in superfluous():
        line = re.compile(rf'^"{re.escape(file)}" = \[(.*)\]\n', re.MULTILINE)
        found = line.search(text)
        assert found is not None, file
        words = [one for one in re.findall(r'"([^"]*)"', found[1]) if one != word]
        rest = ", ".join(f'"{one}"' for one in words)
        text = text[: found.start()] + (f'"{file}" = [{rest}]\n' if words else "") + text[found.end() :]
    for cls in single():
        text = re.sub(rf"^{cls} = .*\n", "", text, flags=re.MULTILINE)
    EXCEPTIONS.write_text(text)


if __name__ == "__main__":
    remove_superfluous()
