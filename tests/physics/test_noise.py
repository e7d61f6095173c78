"""Noise and models of imperfect motors and sensors have the distributions of their names."""

import math

import numpy as np
import pytest

from minerva_bus.world.readings import Sighting
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.noise import BeamModel, DriveStep, MotionModel, Noise, SightingModel

MANY = 20_000


def generator(seed: int = 7) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_zero_noise_draws_nothing_and_returns_its_input() -> None:
    noise, rng, untouched = Noise(), generator(), generator()
    distances = np.array([1.0, 2.0])
    sightings = (Sighting("m", 1.0, 2.0),)
    assert noise.scan(distances, 5.0, rng) is distances
    assert noise.drive_errors(10.0, 0.1, rng) == (10.0, 0.1)
    assert noise.sightings(sightings, rng) is sightings
    assert rng.random() == untouched.random()


def test_a_laser_is_unbiased_and_has_the_configured_noise() -> None:
    distances = np.full(MANY, 2.0)
    measured = Noise(laser_m=0.05).scan(distances, 5.0, generator())
    assert measured.mean() == pytest.approx(2, abs=0.002)
    assert measured.std() == pytest.approx(0.05, rel=0.03)
    assert (distances == 2).all()


def test_a_laser_stays_in_its_range_and_invents_no_walls() -> None:
    distances = np.concatenate([np.zeros(1000), np.full(1000, 4.99), np.full(1000, 5.0)])
    measured = Noise(laser_m=0.5).scan(distances, 5.0, generator())
    assert measured.min() == 0
    assert measured.max() == 5
    assert (measured[2000:] == 5).all()


def test_beams_drop_out_at_the_configured_rate() -> None:
    measured = Noise(laser_dropout=0.2).scan(np.full(MANY, 2.0), 5.0, generator())
    assert set(measured.tolist()) == {2.0, 5.0}
    assert (measured == 5).mean() == pytest.approx(0.2, abs=0.01)


def test_driving_errs_relative_to_the_distance_and_turning_in_degrees() -> None:
    noise, rng = Noise(drive=0.1, turn_deg=3.0), generator()
    driven = np.array([noise.drive_errors(90.0, -2.0, rng) for _ in range(MANY)])
    assert driven.mean(0) == pytest.approx([90, -2], abs=0.1)
    assert driven.std(0) == pytest.approx([3, 0.2], rel=0.03)


def test_a_body_without_a_command_stands_still() -> None:
    assert Noise(drive=0.5, turn_deg=5.0).drive_errors(0.0, 0.0, generator()) == (0.0, 0.0)


def test_a_camera_errs_in_distance_and_bearing() -> None:
    noise = Noise(camera_m=0.1, camera_deg=2.0)
    seen = noise.sightings([Sighting("m", 3.0, 10.0)] * MANY, generator())
    values = np.array([(sighting.distance, sighting.angle) for sighting in seen])
    assert values.mean(0) == pytest.approx([3, 10], abs=0.1)
    assert values.std(0) == pytest.approx([0.1, 2], rel=0.03)
    near = noise.sightings([Sighting("m", 0.01, 0.0)] * 100, generator())
    assert min(sighting.distance for sighting in near) == 0


def test_the_same_generator_gives_the_same_noise() -> None:
    noise = Noise(laser_m=0.1, laser_dropout=0.1)
    first, other = (noise.scan(np.ones(50), 5.0, generator()) for _ in range(2))
    assert first.tobytes() == other.tobytes()


def test_drawings_do_not_depend_on_other_data() -> None:
    noise = Noise(laser_m=0.1, drive=0.1, turn_deg=1.0)
    first, other = generator(), generator()
    noise.scan(np.full(10, 5.0), 5.0, first)
    noise.scan(np.ones(10), 5.0, other)
    noise.drive_errors(0.0, 0.0, first)
    noise.drive_errors(1.0, 1.0, other)
    assert first.random() == other.random()


@pytest.mark.parametrize("field", ["laser_m", "laser_dropout", "drive", "turn_deg", "camera_deg"])
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_impossible_noise_is_refused(field: str, value: float) -> None:
    with pytest.raises(PhysicsError, match=field):
        Noise(**{field: value})


def test_a_probability_above_one_is_refused() -> None:
    with pytest.raises(PhysicsError, match="laser_dropout"):
        Noise(laser_dropout=1.5)


NAMES = ("desk", "door", "lamp")


def steps(model: MotionModel, turn: float, forward: float) -> np.ndarray:
    rng = generator()
    made = [model.sample(turn, forward, rng) for _ in range(MANY // 4)]
    return np.array([(sample.turn_deg, sample.forward_m, sample.after_deg) for sample in made])


@pytest.mark.parametrize(
    ("alphas", "turn", "forward", "expected"),
    [
        ((0.04, 0, 0, 0), 90.0, 2.0, (0.2 * 90, 0, 0)),
        ((0, 0.01, 0, 0), 90.0, 2.0, (math.degrees(0.2), 0, math.degrees(0.2))),
        ((0, 0, 0.09, 0), 90.0, -2.0, (0, 0.6, 0)),
        ((0, 0, 0, 0.01), 90.0, 0.0, (0, 0.1 * math.pi / 2, 0)),
        ((0.04, 0.01, 0.09, 0.01), 0.0, 1.0, (math.degrees(0.1), 0.3, math.degrees(0.1))),
    ],
)
def test_the_motion_model_errs_by_its_variances(
    alphas: tuple[float, ...],
    turn: float,
    forward: float,
    expected: tuple[float, ...],
) -> None:
    made = steps(MotionModel(*alphas), turn, forward)
    assert made.std(0) == pytest.approx(expected, rel=0.03, abs=1e-12)
    assert made.mean(0) == pytest.approx((turn, forward, 0), abs=0.6)


def test_a_robot_ordered_to_stand_stands() -> None:
    made = MotionModel(1, 1, 1, 1).sample(0.0, 0.0, generator())
    assert made == DriveStep(0.0, 0.0, 0.0)


def test_no_alpha_is_no_model() -> None:
    assert not MotionModel()
    assert MotionModel(alpha4=0.1)


def ranges(model: BeamModel, true: float, most: float = 8.0) -> np.ndarray:
    distances = np.full(MANY, true)
    return model.sample(distances, distances, most, generator())


def test_short_ranges_are_exponential_up_to_the_hit() -> None:
    made = ranges(BeamModel(short=0.3, decay=0.7), 4.0)
    short = made[made < 4.0]
    assert len(short) / MANY == pytest.approx(0.3, abs=0.01)
    whole = 1 - math.exp(-0.7 * 4.0)
    for dist in (0.5, 1.0, 2.0, 3.0):
        part = (1 - math.exp(-0.7 * dist)) / whole
        assert (short < dist).mean() == pytest.approx(part, abs=0.02)


def test_random_ranges_are_uniform_over_all_of_the_range() -> None:
    made = ranges(BeamModel(random=0.25), 8.0)
    random = made[made < 8.0]
    assert len(random) / MANY == pytest.approx(0.25, abs=0.01)
    quarters = np.histogram(random, bins=4, range=(0, 8))[0] / len(random)
    assert quarters == pytest.approx([0.25] * 4, abs=0.02)


def test_the_four_parts_have_their_shares_of_all_beams() -> None:
    """`Noise` removes the lost beams, so these shares are relative to the kept beams."""
    made = ranges(BeamModel(short=0.2, decay=1.0, random=0.1, lost=0.5), 7.9)
    kept = 1 - 0.5
    assert (made != 7.9).mean() * kept == pytest.approx(0.3, abs=0.01)


def test_missed_markers_and_mistaken_ones() -> None:
    seen = [Sighting("door", 1.0, 2.0)] * MANY
    made = SightingModel(miss=0.3, mistake=0.2).sample(seen, NAMES, generator())
    assert len(made) / MANY == pytest.approx(0.7, abs=0.01)
    for other in ("desk", "lamp"):
        share = sum(sighting.marker == other for sighting in made) / len(made)
        assert share == pytest.approx(0.1, abs=0.01)
    assert {(sighting.distance, sighting.angle) for sighting in made} == {(1.0, 2.0)}


def test_the_only_marker_is_never_mistaken() -> None:
    seen = [Sighting("door", 1.0, 2.0)]
    assert SightingModel(mistake=1.0).sample(seen, ("door",), generator()) == tuple(seen)


def test_the_number_of_draws_does_not_depend_on_the_data() -> None:
    first, other = generator(), generator()
    for rng, true, name in ((first, 1.0, "door"), (other, 5.0, "desk")):
        BeamModel(short=0.5).sample(np.full(9, true), np.full(9, true), 8.0, rng)
        MotionModel(1, 1, 1, 1).sample(true, 0.0, rng)
        SightingModel(miss=0.5).sample([Sighting(name, true, 0.0)], NAMES, rng)
    assert first.random() == other.random()


@pytest.mark.parametrize(
    ("model", "why"),
    [
        (lambda: MotionModel(alpha1=-1), "alpha1: expected 0 or more"),
        (lambda: MotionModel(alpha3=math.nan), "alpha3"),
        (lambda: BeamModel(short=1.5), "short: expected 0 to 1"),
        (lambda: BeamModel(decay=0.0), "decay"),
        (lambda: BeamModel(short=0.6, random=0.3, lost=0.2), "more than all"),
        (lambda: SightingModel(miss=-0.1), "miss: expected 0 to 1"),
        (lambda: SightingModel(mistake=math.inf), "mistake"),
    ],
)
def test_invalid_values_are_rejected(model: object, why: str) -> None:
    with pytest.raises(PhysicsError, match=why):
        model()  # type: ignore[operator]
