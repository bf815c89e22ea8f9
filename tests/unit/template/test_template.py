"""Templates: inheritance, errors that name file, path and expectation, and the schema."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import ConfigError
from swarmware.model import config, document, template
from swarmware.model.resource import Kind

SHARE = config.share_dir()
SHIPPED = sorted((SHARE / "templates").glob("*.toml"))


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_template_loads_and_fits_the_schema(path: Path) -> None:
    loaded = template.load(path.stem, path.parent)
    assert loaded.resources
    schema = json.loads((SHARE / "schemas" / "template.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(tomllib.loads(path.read_text()))


def test_shipped_schema_is_one_of_code() -> None:
    shipped = json.loads((SHARE / "schemas" / "template.schema.json").read_text())
    assert shipped == json.loads(json.dumps(template.schema())), "make docs"


@pytest.fixture
def parsed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Files, as often as they are parsed."""
    found: list[str] = []
    toml = document.toml

    def counting(text: str, source: str) -> dict[str, object]:
        found.append(source)
        return toml(text, source)

    monkeypatch.setattr(document, "toml", counting)
    return found


def test_folder_templates_parse_each_file_once(parsed: list[str]) -> None:
    found = template.whole(SHARE / "templates")
    assert {kind for one in found for kind in one.kinds} >= {"uav", "ugv", "gcs"}
    assert sorted(parsed) == [str(path) for path in SHIPPED]


def test_templates_loaded_in_turn_share_bases(
    parsed: list[str],
) -> None:
    folder = SHARE / "templates"
    alone = [template.load(name, folder) for name in template.names_in(folder)]
    assert len(parsed) > len(SHIPPED)
    parsed.clear()
    files: dict[Path, template.TemplateFile] = {}
    assert [template.load(name, folder, files) for name in template.names_in(folder)] == alone
    assert sorted(parsed) == [str(path) for path in SHIPPED]


def test_resources_are_sorted_by_path() -> None:
    paths = [resource.path for resource in template.load("common", SHARE / "templates").resources]
    assert paths == sorted(paths)


def test_child_overrides_field_by_field_and_keeps_rest(tmp_path: Path) -> None:
    write(
        tmp_path,
        base='[resources."nav/pose"]\ntype="Pose"\nrate_hz=10\nowner="navigator"\n',
        child='extends="base"\n[resources."nav/pose"]\nrate_hz=20\n',
    )
    (resource,) = template.load("child", tmp_path).resources
    assert (resource.type, resource.rate_hz, resource.owner) == ("Pose", 20.0, "navigator")


def test_of_two_parents_the_later_wins(tmp_path: Path) -> None:
    write(
        tmp_path,
        one='[resources.a]\ntype="Float"\nunit="m"\n',
        two='[resources.a]\ntype="Float"\nunit="ft"\n',
        child='extends=["one", "two"]\n',
    )
    assert template.load("child", tmp_path).resources[0].unit == "ft"


def test_inherited_resources_can_be_removed_by_pattern(tmp_path: Path) -> None:
    write(
        tmp_path,
        base='[resources."sim/truth"]\ntype="Pose"\n[resources."sim/a/b"]\ntype="Pose"\n[resources.x]\ntype="Pose"\n',
        child='extends="base"\nremove=["sim/**"]\n',
    )
    assert [resource.path for resource in template.load("child", tmp_path).resources] == ["x"]


def test_digest_follows_content_and_not_way_there(tmp_path: Path) -> None:
    write(
        tmp_path,
        base='[resources.a]\ntype="Float"\n',
        child='extends="base"\n[resources.b]\ntype="Int"\n',
        flat='[resources.b]\ntype="Int"\n[resources.a]\ntype="Float"\n',
    )
    assert template.load("child", tmp_path).digest == template.load("flat", tmp_path).digest
    assert template.load("child", tmp_path).digest != template.load("base", tmp_path).digest


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("resources = 3\n", ["bad.toml", "resources", "object"]),
        ('[resources."nav/pose"]\ntipe="Pose"\n', ["bad.toml", "nav/pose", "tipe", "did you mean type?"]),
        (
            '[resources."nav/pose"]\ntype="Pose"\nrate_hz="fast"\n',
            ["bad.toml", "nav/pose", "rate_hz", "float"],
        ),
        ('[resources."nav/pose"]\ntype="Pose"\nkind="bord"\n', ["bad.toml", "nav/pose", "kind"]),
        ('[resources."nav/pose"]\nrate_hz=3\n', ["bad.toml", "nav/pose", "type", "missing"]),
        ('[resources."Nav/pose"]\ntype="Pose"\n', ["bad.toml", "Nav", "[a-z0-9_]+"]),
        ('extends="nobody"\n', ["bad.toml", "extends", "nobody", "expected one of"]),
        ('extends="bad"\n', ["bad.toml", "bad → bad"]),
        ('remove=["nav/**"]\n', ["bad.toml", "remove", "matches nothing"]),
        ('remove=["nav/{"]\n', ["bad.toml", "remove", "{"]),
        (
            '[resources.a]\ntype="Float"\n[resources."a/b"]\ntype="Float"\n',
            ["bad.toml", "a/b", "a has a value"],
        ),
        ("[resources\n", ["bad.toml", "invalid TOML"]),
        ("colour = 3\n", ["bad.toml", "colour", "unknown"]),
    ],
)
def test_mistake_is_named_by_file_path_and_expectation(tmp_path: Path, text: str, said: list[str]) -> None:
    write(tmp_path, bad=text)
    with pytest.raises(ConfigError) as caught:
        template.load("bad", tmp_path)
    missing = [word for word in said if word not in str(caught.value)]
    assert not missing, str(caught.value)


def test_an_error_in_a_parent_names_the_parent(tmp_path: Path) -> None:
    write(tmp_path, base='[resources.a]\nkind="board"\n', child='extends="base"\n')
    with pytest.raises(ConfigError, match=r"base\.toml.*type of a: missing"):
        template.load("child", tmp_path)


def test_an_unknown_template_lists_those_that_exist(tmp_path: Path) -> None:
    write(tmp_path, base="", other="")
    with pytest.raises(ConfigError, match="no template 'uav'; expected one of: base, other"):
        template.load("uav", tmp_path)


def test_branches_may_have_a_description(tmp_path: Path) -> None:
    write(
        tmp_path,
        base='[resources.nav]\nkind="branch"\ndescription="d"\n[resources."nav/pose"]\ntype="Pose"\n',
    )
    assert template.load("base", tmp_path).resources[0].kind is Kind.BRANCH


@given(text=st.text(max_size=200))
def test_any_text_is_template_or_configuration_error(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    folder = tmp_path_factory.mktemp("t")
    (folder / "x.toml").write_text(text, "utf-8", newline="")
    try:
        template.load("x", folder)
    except ConfigError as error:
        assert "x.toml" in str(error)


_leaf = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(max_size=8), st.lists(st.integers(), max_size=3)
)
_keys = st.sampled_from([*template.Entry.__struct_fields__, "colour"])


@given(
    tables=st.dictionaries(
        st.sampled_from(["a", "a/b", "c", "B", ""]), st.dictionaries(_keys, _leaf, max_size=5)
    )
)
def test_any_tables_are_template_or_configuration_error(
    tmp_path_factory: pytest.TempPathFactory, tables: dict[str, dict[str, object]]
) -> None:
    import tomli_w

    folder = tmp_path_factory.mktemp("t")
    (folder / "x.toml").write_text(tomli_w.dumps({"resources": tables}), "utf-8")
    try:
        template.load("x", folder)
    except ConfigError as error:
        assert "x.toml" in str(error)
