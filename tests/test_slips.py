"""What a hasty user gets wrong, in a file that is valid, in one that is not, and on the command
line: the program has a word on each."""

from bad_files import write_case
from slips import REFUSED, REMARKED, TYPED, sound

from dobc_design.description.meaning import remarks
from dobc_design.errors import SpecError
from dobc_design.problem.load import read_problem_file


def test_none_of_95_slips_and_more_passes_without_a_word(command_line, tmp_path):
    """Some 50 change the meaning of a valid file, some 40 are refused in a file, the rest typed."""
    silent = [slip.id for slip in REMARKED if not remarks(sound(**slip.changes))]
    for case in REFUSED:
        folder = tmp_path / case.id
        folder.mkdir()
        try:
            read_problem_file(write_case(case, folder))
        except SpecError as error:
            silent += [case.id] * (not str(error))
        else:
            silent.append(case.id)
    silent += [line for line, _, _ in TYPED if not command_line(*line.split())[2]]
    assert silent == []
    names = {slip.id for slip in (*REMARKED, *REFUSED)} | {line for line, _, _ in TYPED}
    assert len(names) >= 95
