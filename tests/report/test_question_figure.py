"""Labels of the question's figure stand apart."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.report.question_figure import LINE, spread_out


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30))
def test_labels_keep_their_order_never_overlap_and_stay_at_their_height_where_they_can(heights):
    wanted, line = np.sort(heights), min(LINE, 1 / len(heights))
    placed = spread_out(wanted)
    assert np.all(np.diff(placed) >= line - 1e-9)
    assert placed[0] >= -1e-9 and placed[-1] <= 1 + 1e-9
    if np.all(np.diff(wanted) >= line):
        np.testing.assert_allclose(placed, wanted, atol=1e-9)
