"""Names of files from outside: one file of a folder, never a way to another one."""

from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.mission.manifest import RoleSpec
from swarmware.types.bounds import FileName, OptionalFileName, is_file_name
from swarmware.types.file import FileBlock, FileOffer, FileQuery, FileRead

PLACES: list[tuple[type[msgspec.Struct], str]] = [
    *((cls, "name") for cls in (FileOffer, FileBlock, FileQuery, FileRead)),
    (RoleSpec, "file"),
]
"""Fields that a receiver joins to one of its folders."""
WAYS = [
    *("..", ".", "../x", "a/../../x", "/etc/hostname", "a/b", ".hidden", "x\n", "x\0", "-rf", "", "x" * 101),
    *("..\\x", "~/x", "x\u2215y"),
]


def accepted(kind: Any, text: str) -> bool:
    try:
        msgspec.convert(text, kind)
    except msgspec.ValidationError:
        return False
    return True


@pytest.mark.parametrize("name", ["map", "map.tar.gz", "a+b_c-d", "0", "x" * 100])
def test_the_name_of_a_file_is_accepted(name: str) -> None:
    assert is_file_name(name)
    assert accepted(FileName, name)
    assert accepted(OptionalFileName, name)


@pytest.mark.parametrize("name", WAYS)
def test_what_may_lead_elsewhere_is_refused(name: str) -> None:
    assert not is_file_name(name)
    assert not accepted(FileName, name)
    assert accepted(OptionalFileName, name) == (name == "")


@given(st.text(st.sampled_from("./\\a\n\0 -~"), max_size=12) | st.text(max_size=8))
def test_accepted_name_is_entry_of_folder_itself(name: str) -> None:
    assert accepted(FileName, name) == is_file_name(name)
    if is_file_name(name):
        assert (Path("/folder") / name).parent == Path("/folder")
        assert Path("/folder", name).resolve() == Path("/folder", name)


@pytest.mark.parametrize(("cls", "field"), PLACES, ids=lambda one: getattr(one, "__name__", one))
def test_fields_joined_to_folder_accept_names_alone(cls: type[msgspec.Struct], field: str) -> None:
    kind = next(one.type for one in msgspec.structs.fields(cls) if one.name == field)
    assert get_origin(kind) is Annotated
    assert get_args(kind)[0] is str
    assert not [name for name in WAYS if name and accepted(kind, name)]
