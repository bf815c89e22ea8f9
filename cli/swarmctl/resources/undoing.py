"""Takes back the last change of a setting."""

from typing import Any

import msgspec

from swarmctl.resources.access import confirm_change, read, undo
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmware.model import names


class SettingUndone(msgspec.Struct, frozen=True):
    """A setting whose last change was undone."""

    path: str
    before: Any
    value: Any
    version: int


async def undo_resource(session: Session, path: str, *, yes: bool) -> None:
    """Takes back the last change of a setting and prints both values, without a confirmation if `yes`.

    Raises: as `confirm_change`; NotFound when it was not changed, InvalidInput when it is not a setting;
    NoAnswer when an application has not taken it.
    """
    full = session.path(path)
    await confirm_change(session, full, f"undo the last change of {names.split(full)[1]}", yes=yes)
    # from the owner: a mirror may still have the value before the change that is undone
    before = await read(session, full, fresh=True)
    done = await undo(session, full)
    if session.settings.structured:
        session.out.document(SettingUndone(done.path, before.value, done.value, done.version))
    else:
        was, now = brief(before.value), brief(done.value)
        session.out.text(f"{done.path} = {now} ({done.details}; was {was})")
    done.check_applied()
