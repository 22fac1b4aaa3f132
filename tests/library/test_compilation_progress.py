"""What a progress display shows while kernels are compiled."""

from lwrprobe.compiled import kernel
from lwrprobe.runs.progress import compilation_shown, compilation_text


def test_time_left_follows_from_the_kernels_so_far():
    assert compilation_text(100, 20.0, 400) == "compiling kernels: 100 of about 400, about 60 s left"


def test_no_total_is_claimed_where_it_is_unknown_or_exceeded():
    assert compilation_text(7, 2.0, None) == "compiling kernels: 7"
    assert compilation_text(401, 80.0, 400) == "compiling kernels: 401"


def test_a_display_is_told_of_each_kernel_once():
    @kernel(cache=False)
    def twice(a):
        return 2.0 * a

    class Display:
        def __init__(self):
            self.counts = []

        def compiled(self, count, seconds, total):
            assert seconds >= 0.0
            self.counts.append(count)

    display = Display()
    with compilation_shown(display):
        assert twice(2.0) == 4.0
        assert twice(3.0) == 6.0
    assert display.counts == [1]
