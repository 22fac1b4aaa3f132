"""What the command line shows while kernels are compiled."""

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.runs.progress import ProgressLine, compilation_text


def test_time_left_follows_from_the_kernels_so_far():
    assert compilation_text(100, 20.0, 400) == "compiling kernels: 100 of about 400, about 60 s left"


def test_no_total_is_claimed_where_it_is_unknown_or_exceeded():
    assert compilation_text(7, 2.0, None) == "compiling kernels: 7"
    assert compilation_text(401, 80.0, 400) == "compiling kernels: 401"


def test_line_counts_each_kernel_once():
    @kernel(cache=False)
    def twice(a):
        return 2.0 * a

    line = ProgressLine(quiet=True)
    with line, line.compilation():
        assert twice(2.0) == 4.0
        assert twice(3.0) == 6.0
        (task,) = line._bar.tasks
        assert task.completed == 1
        assert np.isfinite(task.total)
