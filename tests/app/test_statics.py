"""What is checked of a quasi-static cycle before anything is told of it."""

import numpy as np
import pytest

from jaxgear.study._statics import SolverFailure, require_solved


def test_an_unsolved_phase_is_named():
    solved = np.ones((2, 8), dtype=bool)
    require_solved(solved)
    solved[1, 5] = False
    with pytest.raises(SolverFailure, match=r"not solved at 1 of 16 positions \(phases \[5\]\)"):
        require_solved(solved)
