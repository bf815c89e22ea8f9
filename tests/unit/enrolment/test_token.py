"""The token that an operator copies: what it carries, and what is said when it was mistyped."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput
from swarmware.transport.enrolment.token import HOSTS_MAX, JoinToken

SECRET, ROOT = bytes(range(16)), bytes(range(100, 116))
TOKEN = JoinToken(SECRET, ROOT, 1_800_000_000, ("10.9.8.1",), 7449)
TEXT = TOKEN.text()


@pytest.mark.parametrize(
    "hosts", [(), ("10.0.0.1",), ("10.0.0.1", "192.168.4.7"), ("fd00::7",), ("base.example",), ("a" * 63,)]
)
def test_a_token_is_read_as_it_was_written(hosts: tuple[str, ...]) -> None:
    token = JoinToken(SECRET, ROOT, 4_294_967_295, hosts, 65535)
    assert JoinToken.parse(token.text()) == token


def test_token_of_one_address_is_short_word() -> None:
    assert len(TEXT) <= 80
    assert TEXT.isalnum() and TEXT.lower() == TEXT


@pytest.mark.parametrize(
    "typed",
    [
        TEXT.upper(),
        f" {TEXT}\n",
        "-".join(TEXT[at : at + 5] for at in range(0, len(TEXT), 5)),
        TEXT.replace("0", "O"),
        TEXT.replace("1", "l"),
        TEXT.replace("1", "I"),
    ],
)
def test_token_ignores_case_dashes_and_lookalikes(typed: str) -> None:
    assert JoinToken.parse(typed) == TOKEN


@pytest.mark.parametrize("place", range(len(TEXT)))
def test_one_mistyped_character_is_noticed_at_each_place(place: int) -> None:
    other = "7" if TEXT[place] != "7" else "8"
    with pytest.raises(InvalidInput, match="mistyped"):
        JoinToken.parse(TEXT[:place] + other + TEXT[place + 1 :])


@pytest.mark.parametrize("place", range(len(TEXT) - 1))
def test_two_exchanged_characters_are_noticed(place: int) -> None:
    typed = TEXT[:place] + TEXT[place + 1] + TEXT[place] + TEXT[place + 2 :]
    if typed != TEXT:
        with pytest.raises(InvalidInput, match="mistyped"):
            JoinToken.parse(typed)


@pytest.mark.parametrize(
    ("typed", "reason"),
    [
        ("", "its end is missing"),
        (TEXT[:20], "its end is missing"),
        (TEXT[:-1], "mistyped or incomplete"),
        (TEXT + "00", "mistyped or incomplete"),
        ("u" + TEXT[1:], "character 1 is 'u'"),
        (TEXT[:9] + "!" + TEXT[10:], "character 10 is '!'"),
        ("0" * 2000, "2000 characters"),
    ],
)
def test_what_is_wrong_with_a_token_is_said(typed: str, reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason) as caught:
        JoinToken.parse(typed)
    assert "swarmctl keys invite" in str(caught.value)


@pytest.mark.parametrize("hosts", [("",), ("ü.example",), ("a" * 64,), ("10.0.0.1",) * (HOSTS_MAX + 1)])
def test_hosts_that_do_not_fit_are_refused(hosts: tuple[str, ...]) -> None:
    with pytest.raises(InvalidInput):
        JoinToken(SECRET, ROOT, 0, hosts, 1).text()


@given(st.text(max_size=200) | st.text(alphabet="0123456789abcdefghjkmnpqrstvwxyz", max_size=200))
def test_any_text_is_a_token_or_refused(text: str) -> None:
    try:
        token = JoinToken.parse(text)
    except InvalidInput:
        return
    assert JoinToken.parse(token.text()) == token


def test_number_and_keys_differ_without_showing_secret() -> None:
    other = JoinToken(bytes(16), ROOT, 1)
    made = [TOKEN.number, TOKEN.key(b"a"), TOKEN.key(b"b"), other.number, other.key(b"a")]
    assert len(set(made)) == len(made)
    assert all(SECRET not in one for one in made)
