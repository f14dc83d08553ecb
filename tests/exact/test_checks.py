"""The shape checks of floor 0, on the matrices of this room."""

import numpy as np
import pytest

from dobc_design._checks import require_shape, require_square
from dobc_design.errors import ShapeError


def test_a_fitting_matrix_gives_its_shape():
    """None leaves a side free; arrays and nested tuples alike."""
    assert require_shape(((1, 2, 3), (4, 5, 6)), (2, None), name="C") == (2, 3)
    assert require_shape(np.zeros((4, 1)), (None, 1), name="W") == (4, 1)
    assert require_square(((1, 2), (3, 4)), name="A") == 2


def test_the_error_names_matrix_shape_and_reason():
    """Style page: "exosystem.C must have 2 columns, one per exosystem state ...; got shape (1, 3)."."""
    with pytest.raises(ShapeError) as caught:
        require_shape(((1, 2, 3),), (None, 2), name="exosystem.C", because="one per exosystem state (A is 2x2)")
    assert str(caught.value) == (
        "exosystem.C must have 2 columns, one per exosystem state (A is 2x2); got shape (1, 3)."
    )
    assert caught.value.key == "exosystem.C"


@pytest.mark.parametrize(
    ("matrix", "shape", "text"),
    [
        (((1, 2),), (2, 2), r"must have shape \(2, 2\); got shape \(1, 2\)"),
        (((1, 2),), (2, None), r"must have 2 rows; got"),
        (((1, 2),), (None, 1), r"must have 1 column; got"),
        (((1, 2), (3,)), (None, None), r"rows of one length; got 2 in row 1 and 1 in row 2"),
        ((), (1, 0), r"must have shape \(1, 0\); got shape \(0, 0\)"),
    ],
)
def test_a_wrong_shape_is_refused(matrix, shape, text):
    """Every error path is walked."""
    with pytest.raises(ShapeError, match=text):
        require_shape(matrix, shape, name="M")


def test_a_matrix_that_is_not_square_is_refused():
    """With its reason."""
    with pytest.raises(ShapeError, match=r"A must be square, xi' = A xi; got shape \(1, 2\)"):
        require_square(((1, 2),), name="A", because="xi' = A xi")


def test_no_rows_fit_any_number_of_columns():
    """Nested sequences cannot say how many columns no rows have."""
    assert require_shape((), (None, 5), name="T") == (0, 0)
