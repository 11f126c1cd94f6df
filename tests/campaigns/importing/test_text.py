"""Text tables as instruments, spreadsheets and programs write them: read right, or refused with line and fix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns.importing.sources import select
from campaigns.importing.text import CellError, TextSource
from sim_backend.errors import ConfigError, DataError

T, U, Y = [0.0, 0.001, 0.002, 0.003], [0.5, -1.25, 2.0, 1e-3], [1.0, 4.0, -9.5, 16.25]
ROWS = "0.0,0.5,1.0\n0.001,-1.25,4.0\n0.002,2.0,-9.5\n0.003,1e-3,16.25\n"


def written(tmp_path: Path, text: str | bytes, name: str = "a.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def table(tmp_path: Path, text: str | bytes, **options: object) -> TextSource:
    return TextSource(written(tmp_path, text), **options)  # type: ignore[arg-type]


COMMAS = ROWS.replace(",", ";").replace(".", ",")
READ: dict[str, str | bytes] = {
    "plain": f"t,u,y\n{ROWS}",
    "byte order mark": f"\ufefft,u,y\n{ROWS}",
    "UTF-16": f"t,u,y\n{ROWS}".encode("utf-16"),
    "carriage returns": f"t,u,y\n{ROWS}".replace("\n", "\r\n"),
    "old Macintosh": f"t,u,y\n{ROWS}".replace("\n", "\r"),
    "names in quotes": f'"t","u","y"\n{ROWS}',
    "all in quotes": f"t,u,y\n{ROWS}".replace("\n", '"\n"').replace(",", '","').join(['"', ""]).removesuffix('"'),
    "semicolons": f"t,u,y\n{ROWS}".replace(",", ";"),
    "tabs": f"t,u,y\n{ROWS}".replace(",", "\t"),
    "blanks": f"t,u,y\n{ROWS}".replace(",", "   "),
    "blanks before": "  t  u  y\n" + "".join(f"  {line}\n" for line in ROWS.replace(",", "  ").splitlines()),
    "decimal commas": f"t;u;y\n{COMMAS}",
    "decimal commas in quotes": "t,u,y\n"
    + "".join('"' + line.replace(";", '","') + '"\n' for line in COMMAS.splitlines()),
    "preamble": f"Recorder 7\nStarted 2026-11-25\n\nt,u,y\n{ROWS}",
    "units below": f"t,u,y\ns,V,mm\n{ROWS}",
    "units in brackets below": f"t,u,y\n[s],[V],[mm]\n{ROWS}",
    "names behind a remark": f"# t,u,y\n{ROWS}",
    "names behind a remark, blanks": f"% made by hand\n% t u y\n{ROWS.replace(',', ' ')}",
    "remarks among the data": f"t,u,y\n# begun\n{ROWS.replace('0.002,2.0,-9.5', '0.002,2.0,-9.5 # a step')}",
    "remark line among the data": f"t,u,y\n{ROWS.replace('0.002,', '# half time' + chr(10) + '0.002,')}",
    "Fortran": f"t,u,y\n{ROWS.replace('1e-3', '1.0D-03')}",
    "comma at every end": f"t,u,y\n{ROWS}".replace("\n", ",\n"),
    "comma at every end of the data": f"t,u,y\n{ROWS.replace(chr(10), ',' + chr(10))}",
    "units of time below": f"t,u,y\nmin,V,mm\n{ROWS}",
    "blank lines at the end": f"t,u,y\n{ROWS}\n\n",
    "no end of line": f"t,u,y\n{ROWS.strip()}",
    "micro sign in a code page": f"t,u,y (\u00b5m)\n{ROWS}".encode("cp1252"),
}


@pytest.mark.parametrize("rows", [1, 2])
def test_one_column_of_decimal_commas_below_a_number_is_no_table_of_two(tmp_path, rows):
    """The name is a number, and so might be the first row: two columns below a title."""
    (tmp_path / "a.txt").write_text("0" + rows * "\n0,0")
    with pytest.raises(DataError, match="no row of data" if rows == 1 else "may be the digits behind a decimal comma"):
        TextSource(tmp_path / "a.txt", header=True).array("")
    told = TextSource(tmp_path / "a.txt", separator=";", decimal=",", header=True).array("")
    assert told is not None and told.shape == (rows, 1)


@pytest.mark.parametrize("how", READ)
def test_the_same_table_is_read_however_it_is_written(tmp_path, how):
    source = table(tmp_path, READ[how])
    names = source.names()
    assert [name.partition(" ")[0] for name in names] == ["t", "u", "y"]
    for name, values in zip(names, (T, U, Y), strict=True):
        np.testing.assert_array_equal(source.array(name), values)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("u,y\n1.5,2.5\n1.#QNAN,3.5\n", "line 3: column 'u' holds '1.#QNAN'"),
        ("u,y\n1.5,2.5\n#N/A,3.5\n2.5,4.5\n", "line 3: column 'u' holds '#N/A'"),
        ("u,y\n1.5,2.5\n,3.5\n", "line 3: column 'u' has an empty cell"),
        ("u,y\n1.5,2.5\n\n2.5,3.5\n", "line 3 is empty and data follow"),
        ("u,y\n1.5,2.5\n2.5\n", "line 3 has 1 cells, the others have 2"),
        ("t,u,y\n0,000,2,041,0,000\n0,001,-2,556,4,082\n", "3 names over 6 cells: is the decimal sign a comma"),
        ("u,y\n0,0.5,1.0\n1,0.6,2.0\n", "2 names over 3 cells"),
        ("u,u\n1.5,2.5\n2.5,3.5\n", "2 columns 'u', columns 1, 2"),
        ("u,y\n1.5,inf\n2.5,3.5\n", "line 2: column 'y' holds 'inf'"),
        ("u;y\n1.234,5;2\n3.456,7;3\n", "column 'u' holds '1.234,5'"),
        ("u;y\n1,234;2,345\n3,456;4,567\n", "thousands set off"),
        ("0,1\n0.5,1.0\n0.6,2.0\n", "may be names or data: say header"),
        ("Recorder\n\n0,1\n0.5,1.0\n0.6,2.0\n", "may be names or data: say header"),
        ("u,y\n1,1\n0.5,1.5\n0.6,2e0\n", "may be units or data: take it out, or write 1.0"),
        ("1,05\n2,10\n3,05\n", "may be the digits behind a decimal comma"),
        ("0,1,25,2,5\n1,1,75,3,5\n", "the cell '1' may be the digits behind a decimal comma"),
        ("2026-11-25T11:00:00.5,1,25\n2026-11-25T11:00:01.5,1,75\n", "may be the digits behind a decimal comma"),
        ("u,y\n1_000,2\n1_001,3\n", "holds '1_000'"),
        ("u,y\n1.5,0x10\n2.5,0x11\n", "holds '0x10'"),
        (b"u,y\n1.5,2.5\x00\n", "zero bytes"),
        ("ERR,1\n2,3.5\n4,5.5\n", "stands where names do and holds the number 1"),
        ('t,u,note\n0,1,"ok\n1,2,ok"\n2,3,x\n3,3,x\n', "line 2 has a quote that does not end"),
        ("1.5,2,\n" * 500 + "5.5,6,7\n", "line 501 has 3 cells, the others have 3"),
        (f'u,y\n1.5,"{"x" * 200_000}"\n', "is not a row of cells"),
    ],
)
def test_what_cannot_be_read_for_certain_is_refused_with_its_place(tmp_path, text, said):
    source = table(tmp_path, text)
    with pytest.raises(DataError) as refused:
        for name in source.names() or [""]:
            source.array(name)
    assert said in str(refused.value), refused.value


@pytest.mark.parametrize("decimal", [".", ","])
def test_words_and_dates_beside_decimal_commas_do_not_hide_what_separates(tmp_path, decimal):
    rows = [f"2026-11-25T11:00:0{k}.25;pump;{k}.125" for k in range(4)]
    source = table(tmp_path, "t;name;y\n" + "\n".join(rows).replace(".", decimal) + "\n")
    assert source.names() == ["t", "name", "y"]
    np.testing.assert_array_equal(source.array("y"), [0.125, 1.125, 2.125, 3.125])


def test_known_names_are_names_whatever_the_first_rows_hold(tmp_path):
    text = "t\tname\ty\n0.0\tdoor 1\tclosed\n0.0\tpump 2\t1.5\n1.0\tpump 2\t2.5\n"
    source = table(tmp_path, text, known=("t", "name", "y"))
    assert source.names() == ["t", "name", "y"] and source.dialect.separator == "\t"
    np.testing.assert_array_equal(source.numbers("y"), [np.nan, 1.5, 2.5])


def test_a_head_of_numbers_that_a_table_without_names_gets_is_no_row(tmp_path):
    # what pandas writes for a frame whose columns have no names
    source = table(tmp_path, ",0,1\n0,0.5,1.0\n1,0.25,2.0\n")
    np.testing.assert_array_equal(source.array(""), [[0, 0.5, 1.0], [1, 0.25, 2.0]])
    assert source.names() == ["", "0", "1"]
    first = table(tmp_path, '"0,5","1,0"\n"0,25","2,0"\n', decimal=",")
    np.testing.assert_array_equal(first.array(""), [[0.5, 1.0], [0.25, 2.0]])


def test_the_map_decides_where_two_ways_are_open(tmp_path):
    text = "0,1\n0.5,1.0\n0.6,2.0\n"
    assert table(tmp_path, text, header=True).names() == ["0", "1"]
    titled = table(tmp_path, f"Recorder\n\n{text}", header=True)
    assert titled.names() == ["0", "1"]
    np.testing.assert_array_equal(titled.array(""), [[0.5, 1.0], [0.6, 2.0]])
    np.testing.assert_array_equal(table(tmp_path, text, header=False).array(""), [[0, 1], [0.5, 1], [0.6, 2]])
    np.testing.assert_array_equal(table(tmp_path, "u;y\n1,234;2,345\n", decimal=",").array("u"), [1.234])


def test_a_column_of_words_is_no_hindrance_to_others(tmp_path):
    source = table(tmp_path, "when,u,note\n12:00:01,0.5,warm\n12:00:02,0.75,\n")
    np.testing.assert_array_equal(source.array("u"), [0.5, 0.75])
    assert source.cells("when") == ["12:00:01", "12:00:02"]
    with pytest.raises(CellError, match="line 2: column 'note' holds 'warm'") as refused:
        source.array("note")
    assert (refused.value.line, refused.value.column, refused.value.cell) == (2, "note", "warm")


def test_units_below_names_and_in_brackets(tmp_path):
    source = table(tmp_path, "t,u\ns,mN m\n0.0,0.5\n0.1,0.75\n")
    assert (source.unit("t"), source.unit("u")) == ("s", "mN m")
    assert table(tmp_path, "t [ms],u\n0.5,0.5\n").unit("t [ms]") == "ms"


def test_every_digit_is_read(tmp_path):
    values = np.random.default_rng(5).standard_normal(2000) * 10.0 ** np.arange(-250, 250, 0.25)
    source = table(tmp_path, "x\n" + "\n".join(map(repr, values.tolist())))
    np.testing.assert_array_equal(source.array("x"), values)


def test_a_remark_behind_the_first_row_is_no_name(tmp_path):
    source = table(tmp_path, "0.5,1.5,2.5 # start\n1.5,2.5,3.5\n2.5,3.5,4.5\n")
    rows = source.array("")
    assert rows is not None
    np.testing.assert_array_equal(rows[0], [0.5, 1.5, 2.5])


def test_a_last_column_that_is_mostly_empty_is_a_column(tmp_path):
    rows = "".join(f"{k},{k + 0.5},\n" for k in range(500)) + "500,500.5,warm\n"
    source = table(tmp_path, f"t,u,note\n{rows}")
    u = source.array("u")
    assert u is not None and u.size == 501 and source.names() == ["t", "u", "note"]


def test_a_column_is_selected_by_number_whatever_others_hold(tmp_path):
    source = table(tmp_path, "when,u,u\n2026-11-25 12:00:00,0.5,1.5\n2026-11-25 12:00:01,0.75,2.5\n")
    np.testing.assert_array_equal(select(source, "[:, 2]"), [1.5, 2.5])
    np.testing.assert_array_equal(select(source, "[:, -2]"), [0.5, 0.75])
    with pytest.raises(ConfigError, match="3 columns, none of number 3"):
        select(source, "[:, 3]")


def test_names_that_are_numbers_are_taken_when_the_map_says_so(tmp_path):
    source = table(tmp_path, "t,1,2\n0.5,1.5,2.5\n0.6,2.5,3.5\n", header=True)
    assert source.names() == ["t", "1", "2"]
    assert table(tmp_path, "# remark\n1,2\n0.5,0.6\n", header=True).names() == ["1", "2"]


def test_a_strange_digit_is_no_number(tmp_path):
    with pytest.raises(DataError):
        table(tmp_path, "u\n²\n").array("u")


@pytest.mark.parametrize(
    ("head", "units"),
    [
        ("u [1],y [%]", ("1", "%")),  # beside a unit in brackets a one is one
        ("u [1],u [2]", (None, None)),  # channels with a number
        ("u [1],y", (None, None)),
        ("u [2],y [%]", (None, "%")),
    ],
)
def test_a_number_in_brackets_is_an_index_but_for_a_one_beside_units(tmp_path, head, units):
    path = tmp_path / "a.csv"
    path.write_text(head + "\n1.5,2.5\n2.5,3.5\n0.5,1.5\n", encoding="utf-8")
    source = TextSource(path)
    assert tuple(source.unit(name) for name in source.names()) == units
