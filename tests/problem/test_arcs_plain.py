"""Plain tables are read many lines at a time, with the same outcome as line by line."""

from fractions import Fraction
from pathlib import Path
from random import Random
from unittest.mock import patch

import pytest

from dobc_design.errors import SpecError
from dobc_design.problem import arcs_file, arcs_plain

INDEX = {str(place + 1): place for place in range(9)} | {"from": 9, "a b": 10, "ü": 11}
PLAIN = {
    "commas": ("arcs.csv", "1,2\n2,3\n"),
    "a header and weights": ("arcs.csv", "from,to,weight\n1,2,0.1\n2,3,1e-3\n3,1,0.1\n"),
    "a header that names more": ("arcs.csv", "id,target,source,weight\n7,1,2,3\n8,2,3,1/3\n"),
    "semicolons, Windows line ends": ("arcs.csv", "1;2;0.5\r\n2;3;0.25\r\n"),
    "tabs": ("arcs.tsv", "1\t2\n2\t3"),
    "blanks": ("arcs.edgelist", "1 2 0.5\n2 3 7\n"),
    "a label that is a header elsewhere": ("arcs.csv", "from,1\n2,from\n"),
}
OTHER = {
    "a comment": ("arcs.edgelist", "1 2 # one\n2 3\n"),
    "quotes": ("arcs.csv", '"1",2\n2,3\n'),
    "blanks around": ("arcs.csv", "1, 2\n2,3\n"),
    "a label with a blank": ("arcs.csv", "a b,2\n2,3\n"),
    "a blank line": ("arcs.csv", "1,2\n\n2,3\n"),
    "some weights": ("arcs.csv", "1,2\n2,3,0.5\n"),
    "types": ("arcs.csv", "source,target,type\n1,2,Undirected\n"),
    "a letter beyond ASCII": ("arcs.csv", "ü,2\n2,3\n"),
    "two blanks": ("arcs.edgelist", "1  2\n2 3\n"),
    "attributes": ("arcs.edgelist", "1 2 {}\n2 3 {}\n"),
}
WRONG = {
    "an unknown label": ("arcs.csv", "1,2\n2,77\n", "line 2"),
    "a duplicate": ("arcs.csv", "from,to\n1,2\n2,3\n1,2\n", "line 4"),
    "a self-arc": ("arcs.csv", "1,2\n3,3\n", "line 2"),
    "a weight of 0": ("arcs.csv", "1,2,1\n2,3,0\n", "line 2"),
    "a decimal comma": ("arcs.csv", "1;2;0.5\n2;3;0,5\n", "line 2"),
    "an empty weight": ("arcs.csv", "1,2,1\n2,3,\n", "line 2"),
    "no weight": ("arcs.edgelist", "1 2 1\n2 3 \n3 4 1\n4 4\n", "line 4"),
    "only a header": ("arcs.csv", "from,to\n", "empty"),
}


def read(folder: Path, name: str, text: str):
    folder.joinpath(name).write_bytes(text.encode())
    found = arcs_file.read_arcs_file(name, folder=folder, index=INDEX, arrow="listens_to", key="G")
    return found.arcs


def line_by_line(folder: Path, name: str, text: str):
    with patch.object(arcs_file, "plain_columns", lambda *given: None):
        return read(folder, name, text)


def outcome(reader, folder: Path, name: str, text: str):
    """The arcs, or the whole message."""
    try:
        return reader(folder, name, text)
    except SpecError as error:
        return str(error)


@pytest.mark.parametrize("case", [*PLAIN, *OTHER])
def test_every_table_means_the_same_read_at_once_and_line_by_line(case, tmp_path):
    name, text = (PLAIN | OTHER)[case]
    assert read(tmp_path, name, text) == line_by_line(tmp_path, name, text)


@pytest.mark.parametrize("case", PLAIN)
def test_plain_tables_are_not_read_line_by_line(case, tmp_path):
    with patch.object(arcs_file, "_arcs", side_effect=AssertionError):
        assert len(read(tmp_path, *PLAIN[case])) >= 2


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_line_is_named_as_it_is_line_by_line(case, tmp_path):
    name, text, words = WRONG[case]
    with pytest.raises(SpecError, match=words) as found:
        read(tmp_path, name, text)
    assert str(found.value) == outcome(line_by_line, tmp_path, name, text)


def test_random_tables_have_one_outcome(tmp_path):
    """300 tables of likely and unlikely pieces: the same arcs, or the same message."""
    r = Random(5)
    pieces = [
        "1",
        "2",
        "3",
        "9",
        "12",
        "from",
        "to",
        "weight",
        "0.5",
        "2/3",
        ",",
        ",",
        " ",
        ";",
        "\n",
        "\n",
        "\t",
        '"',
    ]
    pieces += [
        "#",
        "%",
        "{",
        "\r\n",
        "\x0b",
        "\x1c",
        "1,2\n",
        "3,4\n",
        "1 2\n",
        "2,3,0.1\n",
        "2 3 4\n",
    ]
    met = set()
    for _ in range(300):
        name = r.choice(["arcs.csv", "arcs.tsv", "arcs.edgelist"])
        text = r.choice(["", "from,to\n", "1,2\n", "1 2\n"])
        drawn = r.choices(pieces, k=r.randrange(1, 7))
        text += "".join(drawn)
        quick = outcome(read, tmp_path, name, text)
        slow = outcome(line_by_line, tmp_path, name, text)
        assert quick == slow, (name, text)
        met.add(type(quick))
    assert len(met) == 2


def test_a_table_is_split_into_pieces_without_losing_a_line(tmp_path):
    lines = []
    for k in range(81):
        listener = 1 + k % 9
        speaker = 1 + (k // 9 + k) % 9
        if listener != speaker:
            lines.append(f"{listener},{speaker},{k + 1}/7")
    with patch.object(arcs_plain, "PIECE", 10):
        arcs = read(tmp_path, "arcs.csv", "\n".join(lines) + "\n")
    assert [f"{i + 1},{j + 1},{(7 * w)}/7" for i, j, w in arcs] == lines


def test_equal_texts_of_weights_are_one_exact_number(tmp_path):
    arcs = read(tmp_path, "arcs.csv", "1,2,0.1\n2,3,0.1\n3,1,0.10\n")
    assert arcs.weights == (Fraction(1, 10),) * 3
    assert arcs.weights[0] is arcs.weights[1]
