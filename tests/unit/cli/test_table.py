"""Tables within the width of a terminal."""

import pytest

from swarmctl.terminal.table import Cell, Column, Detail, fitted_table, rows_of, show
from swarmctl.terminal.wrapping import wrapped

COLUMNS = (
    Column("NEIGHBOUR"),
    Column("ADDRESS", drop=1),
    Column("BEACON", drop=2),
    Column("LOSS OUT", right=True),
    Column("SAYS"),
)
CELLS = (
    ("uav1", "127.0.0.1:55777", "multicast", "0 %", "waits at the barrier formed"),
    ("gcs", "[fd00::1]:59432", "seeds", "12 %", "-"),
)
NAMES = [column.name for column in COLUMNS]


def words(place: int) -> set[str]:
    return {word for row in (*CELLS, NAMES) for word in row[place].split()}


def test_table_with_room_is_one_line_per_row() -> None:
    assert fitted_table(COLUMNS, CELLS, 200) == fitted_table(COLUMNS, CELLS)
    assert fitted_table(COLUMNS, CELLS, 200).rows == [
        "uav1       127.0.0.1:55777  multicast       0 %  waits at the barrier formed",
        "gcs        [fd00::1]:59432  seeds          12 %  -",
    ]


@pytest.mark.parametrize("width", range(24, 120))
def test_no_width_breaks_words_or_exceeds_lines(width: int) -> None:
    table = fitted_table(COLUMNS, CELLS, width)
    assert max(map(len, table.text.splitlines())) <= width
    kept = [place for place, name in enumerate(NAMES) if name not in table.hidden]
    assert set(table.text.split()) == set[str]().union(*map(words, kept))


def test_headers_wrap_first_then_columns_hide() -> None:
    natural = len(fitted_table(COLUMNS, CELLS).rows[0])
    header = fitted_table(COLUMNS, CELLS, natural - 3)
    assert (header.hidden, len(header.header), len(header.rows)) == ([], 2, 2)
    one = fitted_table(COLUMNS, CELLS, natural - 5)
    assert (one.hidden, len(one.rows)) == (["BEACON"], 2), "the one with the highest number"
    cells = fitted_table(COLUMNS, CELLS, 40)
    assert cells.hidden == ["ADDRESS", "BEACON"]
    assert len(cells.rows) == 3
    assert cells.rows[0].endswith("waits at the barrier")
    assert cells.rows[1].strip() == "formed"


def test_path_breaks_after_slashes_as_last_resort() -> None:
    columns = (Column("PATH"), Column("N", right=True))
    cells = (("/uav1/sensor/a_rather_long_name/range", "7"),)
    assert fitted_table(columns, cells, 40).rows == ["/uav1/sensor/a_rather_long_name/range  7"]
    broken = ["/uav1/sensor/                7", "a_rather_long_name/range"]
    assert fitted_table(columns, cells, 30).rows == broken
    narrow = [row.split()[0] for row in fitted_table(columns, cells, 9).rows]
    assert narrow == ["/uav1/sensor/", "a_rather_long_name/", "range"], "a name stays whole"


def test_text_column_wraps_before_another_hides() -> None:
    cells = (("tree/services", "a long list of names that has no place", "node.toml:4"),)
    for wraps in (True, False):
        columns = (Column("KEY"), Column("VALUE", wraps=wraps), Column("FROM", drop=1))
        assert fitted_table(columns, cells, 50).hidden == ([] if wraps else ["FROM"])
        assert fitted_table(columns, cells, 40).hidden == ["FROM"], "it has to stay readable"


def test_an_empty_table_is_its_header() -> None:
    assert fitted_table(COLUMNS, (), 80).rows == []
    assert fitted_table((Column("A"), Column("B")), ()).text == "A  B"


@pytest.mark.parametrize(
    ("text", "width", "lines"),
    [
        ("short", 10, ["short"]),
        ("two words", 5, ["two", "words"]),
        ('{"x_m":-34.41,"y_m":-0.4}', 14, ['{"x_m":-34.41,', '"y_m":-0.4}']),
        ("see /a/very/long/path now", 12, ["see /a/very/", "long/path", "now"]),
        ("unbreakable", 4, ["unbreakable"]),
        ("0.5 s old, 5 Hz, live", 13, ["0.5 s old,", "5 Hz, live"]),
        ("used 100 % of 2.0 GiB", 8, ["used", "100 % of", "2.0 GiB"]),
        ("roster 3 members", 9, ["roster 3", "members"]),
    ],
)
def test_text_is_wrapped_between_words_or_after_punctuation(text: str, width: int, lines: list[str]) -> None:
    assert wrapped(text, width) == lines


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (None, "-"),
        ("", "-"),
        (True, "yes"),
        (False, "no"),
        (0, "0"),
        (0.0, "0"),
        (1.23456, "1.235"),
        (123456.7, "123457"),
    ],
)
def test_cells_are_written_for_people(cell: Cell, text: str) -> None:
    assert show(cell) == text


def test_long_value_does_not_stretch_piped_lines() -> None:
    columns = [Column("KEY"), Column("VALUE", wraps=True), Column("FROM")]
    rows = [["services", "x" * 500, "default"], ["platform", "uav1", "node.toml"]]
    table = fitted_table(columns, rows)
    assert table.header == ["KEY       VALUE  FROM"]
    assert table.rows == [f"services  {'x' * 500}  default", "platform  uav1   node.toml"]


def test_details_make_a_cell_of_each_item() -> None:
    details: list[Detail[int]] = [
        Detail("N", value=lambda n: n, right=True),
        Detail("SQUARE", value=lambda n: n * n),
    ]
    assert rows_of(details, range(3)) == [(0, 0), (1, 1), (2, 4)]
    assert details[0].right
