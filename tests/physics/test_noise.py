"""Noise has the given size, uses the caller's generator, and is zero for size zero."""

import math

import numpy as np
import pytest

from minerva_bus.world.readings import Sighting
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.noise import Noise

MANY = 20_000


def generator() -> np.random.Generator:
    return np.random.default_rng(7)


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
