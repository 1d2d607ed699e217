import json

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.support.files import atomic_write, read_json, read_table, read_text, write_json


@pytest.mark.parametrize(("mode", "content"), [("w", "über\n"), ("wb", b"\x00\xff")])
def test_a_file_appears_whole_in_a_new_folder(tmp_path, mode, content):
    path = tmp_path / "a" / "b" / "file"
    with atomic_write(path, mode) as file:
        file.write(content)
        assert not path.exists()
    assert path.read_bytes() == (content if mode == "wb" else content.encode())
    assert [p.name for p in path.parent.iterdir()] == ["file"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path, error):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with pytest.raises(error), atomic_write(path) as file:
        file.write("half")
        raise error
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "plain").touch()
    with atomic_write(tmp_path / "atomic") as file:
        file.write("x")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_place_that_cannot_be_written_is_a_data_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="cannot be written"), atomic_write(tmp_path / "file" / "below"):
        pass


def test_an_unknown_mode_is_refused(tmp_path):
    with pytest.raises(ValueError, match="mode"), atomic_write(tmp_path / "x", "a"):
        pass


def test_json_round_trip(tmp_path):
    value = {"a": [1, 2.5, None, "ü", True], "b": {}}
    write_json(tmp_path / "x.json", value)
    assert read_json(tmp_path / "x.json") == value
    assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8")) == value


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object()])
def test_what_json_does_not_have_is_not_written(tmp_path, value):
    with pytest.raises((ValueError, TypeError)):
        write_json(tmp_path / "x.json", {"a": value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["", "{", '{"a": NaN}', "[Infinity]", "[" * 100_000])
def test_invalid_json_is_a_data_error_of_one_line(tmp_path, text):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"x\.json: not valid JSON") as caught:
        read_json(path)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_data_errors(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_json(tmp_path / "none.json")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not a text file"):
        read_text(tmp_path / "binary")
    with pytest.raises(DataError, match="cannot be read"):
        read_text(tmp_path)


def test_table_skips_empty_lines_and_comments_and_keeps_line_numbers(tmp_path):
    (tmp_path / "t").write_text("# head\n1 2\n\n3e0\t4 # tail\r\n")
    rows, lines = read_table(tmp_path / "t", 2, "pairs")
    np.testing.assert_array_equal(rows, [[1, 2], [3, 4]])
    np.testing.assert_array_equal(lines, [2, 4])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n1\n", "line 2: 1 columns, but expected pairs"),
        ("1 nan\n", "line 1: 'nan' is not a finite number"),
        ("1 2\n1 -inf\n", "line 2: '-inf'"),
        ("1 two\n", "line 1: 'two'"),
        ("# only a comment\n", "empty"),
    ],
)
def test_table_errors_name_file_and_line(tmp_path, text, message):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(DataError, match=f"t.txt.*{message}"):
        read_table(tmp_path / "t.txt", 2, "pairs")
