"""One request to a command of the tree and its answer, or one message and its outcome."""

from typing import Any

import msgspec

from swarmctl.resources.access import entry_of
from swarmctl.resources.classes import known_class
from swarmctl.resources.entering import entered
from swarmctl.resources.fields import block, shown_fields
from swarmctl.resources.values import single
from swarmctl.session.session import Session
from swarmware.errors import Denied, InvalidInput, NoAnswer
from swarmware.model.names import split
from swarmware.model.resource import Kind
from swarmware.transport.delivery.outcome import Status
from swarmware.types.typed_value import check_limits


class CallAnswer(msgspec.Struct, frozen=True):
    """Answer of a command."""

    path: str
    type: str
    """Type of the answer, or "" for a command without one."""
    value: Any
    """Plain data, as a bare value for a Struct with a single field, or null without an answer."""
    receiver: str = ""
    """Application whose inbox has the message, of a command without an answer."""


async def call_resource(session: Session, path: str, words: tuple[str, ...], *, yes: bool) -> None:
    """Sends what the words mean and prints the answer; `yes`: without a confirmation.

    Raises: InvalidInput for what is not a command or not a value of its type, Denied for a message that its
    receiver refuses, as the owner raises, NoAnswer.
    """
    entry = await entry_of(session, path)
    if entry.kind is not Kind.COMMAND:
        other = "tree set` sets" if entry.kind is Kind.SETTING else "tree get` reads"
        raise InvalidInput(f"{entry.path}: a {entry.kind}; expected a command (`swarmctl {other} it)")
    platform = split(entry.path)[0] or session.here
    request = entered(await known_class(session, platform, entry.type), words, entry.path)
    # before the confirmation: no question about a request that will be refused
    check_limits(entry, request, entry.path)
    reply = await known_class(session, platform, entry.reply) if entry.reply else None
    await session.confirm(yes, entry.confirm and f"call {split(entry.path)[1]}: {entry.confirm}")
    if reply is None:
        answer = CallAnswer(entry.path, "", None, await _send(session, entry.path, request))
    else:
        answer = CallAnswer(entry.path, entry.reply, single(await session.ask(entry.path, request, reply)))
    if session.settings.structured:
        session.out.document(answer)
    elif reply is None:
        session.out.text(f"{entry.path}: delivered to {answer.receiver}")
    elif answer.value == {}:
        session.out.text(f"{entry.path}: done")
    else:
        session.out.text(*block(shown_fields(answer.value, ""), session.out.width))


async def _send(session: Session, path: str, value: msgspec.Struct) -> str:
    """Sends a message and returns its receiver.

    Raises: Denied when the receiver refuses it, NoAnswer.
    """
    await session.reach(split(path)[0] or session.here)
    outcome = await session.module.send(path, value, timeout_s=session.settings.timeout_s)
    # a refusal is an answer, so it has another exit code than silence
    if outcome.status is Status.REFUSED:
        raise Denied(f"{path}: {outcome}")
    if not outcome:
        raise NoAnswer(f"{path}: {outcome}")
    return outcome.where
