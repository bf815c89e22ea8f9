"""The two copies of a resource: in a template, where each field may be missing, and in a listing."""

import msgspec
from msgspec import UnsetType

from swarmware.model.resource import Access, Kind, Resource
from swarmware.model.template import Entry
from swarmware.types.tree import Quality, TreeEntry, TreeListing

POSE = Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator", description="Where it is")


def test_template_entry_has_resource_fields_but_path() -> None:
    ours = {field.name: field.type for field in msgspec.structs.fields(Resource)}
    theirs = {field.name: field.type for field in msgspec.structs.fields(Entry)}
    assert theirs.keys() == ours.keys() - {"path"}
    assert all(UnsetType in getattr(kind, "__args__", ()) for kind in theirs.values())
    for name in ("kind", "access", "choices", "range", "critical"):
        expected = {"kind": Kind, "access": Access, "choices": tuple[str, ...], "critical": bool}.get(name)
        assert expected is None or expected in theirs[name].__args__


def test_listed_resource_has_resource_fields_and_view() -> None:
    entry = TreeEntry.of(POSE, "/uav1/nav/pose", 0.2, Quality.LIVE)
    assert (entry.path, entry.age_s, entry.quality) == ("/uav1/nav/pose", 0.2, Quality.LIVE)
    shared = set(TreeEntry.__struct_fields__) - {"path", "age_s", "quality", "measured_hz", "rule"}
    assert {name: getattr(entry, name) for name in shared} == {name: getattr(POSE, name) for name in shared}
    assert set(Resource.__struct_fields__) - shared == {"path", "critical", "max_age_s", "default"}, (
        "not listed"
    )


def test_kind_of_later_version_is_listed_only() -> None:
    entry = TreeEntry.of(POSE, "/uav1/nav/pose", None, Quality.NONE)
    plain = msgspec.to_builtins(TreeListing((entry,)))
    plain[0][0][1] = "hologram"
    (listed,) = msgspec.convert(plain, TreeListing).entries
    assert listed.kind == "hologram"
    assert not listed.kind.known
