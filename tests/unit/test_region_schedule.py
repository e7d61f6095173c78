"""How far regions run ahead of each other: three functions that follow from one."""

from itertools import product

import pytest

from minerva_bus.regions.schedule import Schedule

SCHEDULES = [Schedule(every, ahead) for every, ahead in product(range(1, 7), range(8))]


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_a_frame_needs_the_parcels_before_it_except_the_latest(schedule):
    for frame in range(30):
        last_move = frame - frame % schedule.every
        needed = [
            number for number in range(frame)
            if schedule.ahead == 0 or number < last_move or frame - number > schedule.ahead
        ]  # fmt: skip
        assert list(range(schedule.needs(frame))) == needed
        assert schedule.waits(frame) == (len(needed) == frame) or schedule.ahead >= frame
        assert schedule.moves(frame) == (frame == last_move)


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_each_parcel_is_new_in_one_frame_and_the_last_frame_is_the_last_that_can_run(schedule):
    seen = []
    for frame in range(30):
        seen += schedule.new(frame)
        assert seen == list(range(schedule.needs(frame)))
        # Before all regions have finished `frame`, only the parcels of those before are there.
        can_run = [later for later in range(frame, 60) if schedule.needs(later) <= frame]
        assert schedule.last(frame) == max(can_run)
