"""Rate limits for log lines that others cause: few lines, and a count of those omitted."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.runtime.metrics import AT_ONCE, GUESTS, MAX_SUBJECTS, Restraint


def lines(restraint, times, subject="m"):
    """The lines logged for events at these times, with omitted lines checked every second."""
    said, looked = [], 0.0
    for now in times:
        while looked + 1.0 <= now:
            looked += 1.0
            said += [text for _, text in restraint.left_out(looked)]
        if restraint.lets(subject, now):
            said.append("line")
    return said + [text for _, text in restraint.left_out(looked + 60.0)]


def test_ten_thousand_lines_in_a_second_are_a_few_and_their_number():
    said = lines(Restraint(), [n / 10_000 for n in range(10_000)])
    assert said == ["line"] * AT_ONCE + [f"{10_000 - AT_ONCE:,} more lines about it omitted"]


def test_remote_members_share_an_allowance():
    assert lines(Restraint(), [0.0] * (AT_ONCE + 2), GUESTS)[-1] == (
        f"2 more lines about {GUESTS} omitted"
    )


@given(st.lists(st.floats(0, 50), max_size=300).map(sorted))
def test_no_line_is_lost_silently_and_few_are_logged(times):
    said = lines(Restraint(), times)
    held = sum(int(text.split()[0].replace(",", "")) for text in said if text != "line")
    assert said.count("line") + held == len(times)
    assert len(said) <= AT_ONCE + 2 + (times[-1] if times else 0)


def test_subjects_are_forgotten():
    restraint = Restraint()
    for n in range(10 * MAX_SUBJECTS):
        assert restraint.lets(f"m{n}", 100.0 * n)
    assert len(restraint._subjects) <= MAX_SUBJECTS
