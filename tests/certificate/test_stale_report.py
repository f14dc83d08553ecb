"""A folder never holds a certificate beside the report of another one."""

import dobc_design as dd
from dobc_design import Network, Problem


def pair(gain):
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    return Problem(name="pair", network=network, coupling="y", gains={1: gain})


def test_a_new_certificate_takes_the_old_report_away_and_the_same_one_keeps_it(tmp_path):
    first = dd.certify(pair(1))
    first.save(tmp_path)
    for name in ("report.html", "report.md"):
        (tmp_path / name).write_text("of the first", "utf-8")
    (tmp_path / "notes.txt").write_text("mine", "utf-8")

    first.save(tmp_path)
    assert (tmp_path / "report.html").is_file()

    dd.certify(pair(2)).save(tmp_path)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["certificate.json", "notes.txt", "problem.json"]
