"""World files: what stands where, who begins where, and what is wrong with a file."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import ConfigError, InvalidInput
from swarmware.geometry.course import Course
from swarmware.geometry.world import Bounds, Box, Circle, World
from swarmware.model.config import load, parse

WORLDS = Path(__file__).parents[2] / "share/swarm/worlds"
BOUNDS = Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0))


@pytest.mark.parametrize("path", sorted(WORLDS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_world_is_sound(path: Path) -> None:
    world = load(path, World)
    for kind in ("ugv", "uav"):
        starts = [world.start_pose(kind, number) for number in range(1, 11)]
        for pose in starts:
            assert world.bounds.contains(pose.x_m, pose.y_m, pose.z_m)
            assert world.touching(pose.x_m, pose.y_m, 0.0, 1.5) is None


def test_formation_course_leads_past_obstacles_and_over_one() -> None:
    world = load(WORLDS / "formation.toml", World)
    course = Course(((0.0, 0.0), (32.0, 0.0), (62.0, 20.0), (95.0, 20.0)))
    assert course.length_m == pytest.approx(100.0, abs=0.1)
    on_leaders_lane = [
        obstacle.name
        for obstacle in world.obstacles()
        if any(obstacle.distance_m(p.x_m, p.y_m) < 0.35 for p in map(course.at, range(100)))
    ]
    assert on_leaders_lane == ["boulder_leader", "mast"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "key description: missing; expected a text"),
        ('description = "x"\n[bounds]\nx_m = [5.0, 1.0]\ny_m = [0.0, 1.0]', r"x_m: \[5.0, 1.0\], expected"),
        ('description = "x"\n[bounds]\nx_m = [0.0, 1.0]\ny_m = [0.0, 1.0]\nz = 1', "key bounds.z: unknown"),
        (
            'description = "x"\n[bounds]\nx_m = [0.0, 1.0]\ny_m = [0.0, 1.0]\n'
            '[[circles]]\nname = "a"\nx_m = 0.0\ny_m = 0.0\nradius_m = -1.0\nheight_m = 1.0',
            r"key circles\[0\].radius_m",
        ),
        (
            'description = "x"\n[bounds]\nx_m = [0.0, 1.0]\ny_m = [0.0, 1.0]\n[start.uav]\nx_m = 0.0\n'
            'y_m = 0.0\nshape = "heap"',
            "shape",
        ),
    ],
)
def test_a_mistake_is_named_by_file_and_key(text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint) as caught:
        parse(text, World, "meadow.toml")
    assert "meadow.toml" in str(caught.value)


def test_two_obstacles_of_one_name_are_refused() -> None:
    twice = Circle(name="oak", x_m=0.0, y_m=0.0, radius_m=1.0, height_m=1.0)
    with pytest.raises(InvalidInput, match="'oak': the name is used twice"):
        World(description="", bounds=BOUNDS, circles=(twice, twice))


def test_a_kind_without_a_rule_has_no_start() -> None:
    with pytest.raises(InvalidInput, match="a rule for none only"):
        World(description="", bounds=BOUNDS).start_pose("usv", 1)


def test_starts_stand_in_their_shape_with_jitter() -> None:
    world = parse(
        'description = "x"\n[bounds]\nx_m = [-9.0, 9.0]\ny_m = [-9.0, 9.0]\n'
        "[start.ugv]\nx_m = 1.0\ny_m = 2.0\nyaw_rad = 1.5707963267948966\nspacing_m = 4.0\njitter_m = 0.5",
        World,
        "world.toml",
    )
    pose = world.start_pose("ugv", 2, (1.0, -1.0))
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((-2.5, 1.5, math.pi / 2))


@pytest.mark.parametrize(
    ("x", "y", "z", "hit"),
    [
        (3.0, 0.0, 0.0, None),
        (1.4, 0.0, 0.0, "tree"),
        (1.4, 0.0, 4.9, "tree"),
        (0.0, 0.0, 5.4, "tree"),
        (0.0, 0.0, 5.6, None),
        (10.0, 2.4, 0.0, "wall"),
        (10.0, 2.6, 0.0, None),
        (13.3, 0.0, 0.0, "wall"),
    ],
)
def test_a_sphere_touches_or_does_not(x: float, y: float, z: float, hit: str | None) -> None:
    world = World(
        description="",
        bounds=BOUNDS,
        circles=(Circle(name="tree", x_m=0.0, y_m=0.0, radius_m=1.0, height_m=5.0),),
        boxes=(Box(name="wall", x_m=10.0, y_m=0.0, size_m=(6.0, 4.0), height_m=2.0),),
    )
    found = world.touching(x, y, z, 0.5)
    assert (found.name if found else None) == hit


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi), st.floats(0, 3), st.booleans())
def test_scan_equals_exhaustive_beam_search(x: float, y: float, yaw: float, turned: float, low: bool) -> None:
    world = World(
        description="",
        bounds=BOUNDS,
        circles=(
            Circle(name="a", x_m=3.0, y_m=1.0, radius_m=1.0, height_m=2.0),
            Circle(name="b", x_m=-6.0, y_m=4.0, radius_m=2.0, height_m=0.5 if low else 9.0),
        ),
        boxes=(Box(name="c", x_m=0.0, y_m=-7.0, size_m=(6.0, 2.0), height_m=3.0, yaw_rad=turned),),
    )
    if world.touching(x, y, 1.0, 0.01):
        return
    beams, most = 72, 12.0

    def plain(angle: float) -> float:
        hits = [
            o.hit_m(x, y, math.cos(angle), math.sin(angle)) for o in world.obstacles() if o.height_m > 1.0
        ]
        return min(most, *hits)

    for beam, found in enumerate(world.scan(x, y, 1.0, yaw, beams, most)):
        angle = yaw - math.pi + beam * math.tau / beams
        # a beam that grazes an edge hits or misses by the last bit: both answers are right
        around = [plain(angle + turn) for turn in (-1e-9, 0.0, 1e-9)]
        assert min(around) - 1e-5 <= found <= max(around) + 1e-5, (beam, found, around)


def test_a_beam_meets_the_face_of_a_box() -> None:
    box = Box(name="wall", x_m=10.0, y_m=0.0, size_m=(6.0, 4.0), height_m=2.0)
    assert box.hit_m(0.0, 0.0, 1.0, 0.0) == pytest.approx(7.0)
    assert box.hit_m(0.0, 3.0, 1.0, 0.0) == math.inf
    assert box.hit_m(0.0, 0.0, -1.0, 0.0) == math.inf
