"""What the shipped loop functions do to the world and count in it, timestep by timestep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from tests.conftest import Place, States
from vsense.base.errors import VsenseError
from vsense.config.experiment import SHIPPED_FOLDER, load
from vsense.config.placement import settle
from vsense.run.environment import Environment
from vsense.world.entities import Light, Zone

START = str(SHIPPED_FOLDER / "start" / "start.argos")
"""What `vsense new` copies."""

AWAY: Place = (0.0, 1.15, 0.0)
"""Where robots are that a test does not put elsewhere."""

POLLUTER = 52447
TIMESTEP_NS = 100_000_000

Living = Callable[..., Environment]


@pytest.fixture
def live(state: States) -> Living:
    """Lives an experiment with robots at places that the test says, by number, per timestep."""

    def make(
        name: str, steps: Sequence[Mapping[int, Place]], blind: bool = False, **settings: str
    ) -> Environment:
        changed = {key.replace("__", "."): value for key, value in settings.items()}
        experiment = settle(load(name, settings=changed), 1)
        environment = Environment(experiment, 1, blind)
        tags = [robot.tag for robot in experiment.robots]
        for timestep, said in enumerate(steps):
            places = {tag: said.get(number, AWAY) for number, tag in enumerate(tags)}
            now = state(places, 1_000_000_000 + timestep * TIMESTEP_NS)
            environment.step(now, timestep, {})
        return environment

    return make


def standing(times: int, **places: Place) -> list[dict[int, Place]]:
    return [{int(name[1:]): place for name, place in places.items()}] * times


def test_the_light_goes_once_round_and_is_measured_on_the_floor(live: Living) -> None:
    quarter = live(
        "phototaxis", standing(2), lamp__position="0.9,0,0.5", loop_functions__turn_s="0.4"
    )
    lamp = quarter.world.entities["lamp"]
    assert isinstance(lamp, Light)
    assert lamp.position_m == pytest.approx((0.0, 0.54, 0.5))
    assert quarter.world.results["light_distance_m"] == pytest.approx(1.15 - 0.54)
    whole = live("phototaxis", standing(5), loop_functions__turn_s="0.4")
    assert whole.world.entities["lamp"].position_m == pytest.approx((0.9, 0.0, 0.3))
    assert whole.end()["light_distance_mean_m"] == pytest.approx(
        np.mean([np.hypot(0.9, 1.15), 0.61, np.hypot(0.9, 1.15), 1.69, np.hypot(0.9, 1.15)])
    )


def test_the_start_experiment_counts_who_stands_on_its_spot(live: Living) -> None:
    spot = live(START, [{}]).world.entities["spot"]
    assert isinstance(spot, Zone)
    on, off = (spot.x_m, spot.y_m, 0.0), (spot.x_m + 2.0 * spot.radius_m, spot.y_m, 0.0)
    counted = live(START, [{0: on, 1: off}, {0: off, 1: off}, {0: on, 1: on}])
    assert dict(counted.world.results) == {"robots_on_spot": 2.0}
    assert counted.end()["robots_on_spot_mean"] == 1.0


def test_robots_are_counted_by_the_colour_that_they_stand_on(live: Living) -> None:
    places = standing(4, r0=(-0.75, 0.0, 0.0), r1=(-0.75, 0.3, 0.0), r2=(0.75, 0.0, 0.0))
    still = live("aggregation", places, loop_functions__swap_s="0.3")
    assert dict(still.world.results) == {"robots_on_green": 1.0, "robots_on_red": 2.0}
    assert still.end()["robots_on_green_mean"] == pytest.approx((2 + 2 + 2 + 1) / 4)
    assert still.end()["robots_on_red_mean"] == pytest.approx((1 + 1 + 1 + 2) / 4)


def test_spots_move_at_their_speed_and_stay_in_their_halves(live: Living) -> None:
    speeds = []
    for length in (100, 101, 500):
        spots = live("aggregation", standing(length), loop_functions__speed_cm_s="20").world.zones()
        for spot, side in zip(spots, (-1.0, 1.0)):
            assert spot.radius_m <= side * spot.x_m <= 1.5 - spot.radius_m
            assert abs(spot.y_m) <= 1.2 - spot.radius_m
        speeds.append([(spot.x_m, spot.y_m) for spot in spots])
    step_m = np.hypot(*(np.array(speeds[1]) - speeds[0]).T)
    assert (step_m <= 0.02 + 1e-9).all() and step_m.max() > 0.0


def test_doors_open_at_their_times_and_the_first_lamp_goes_out(live: Living) -> None:
    settings = {"first__time_s": "0.1", "second__time_s": "0.2"}
    there = [set(live("labyrinth", standing(n), **settings).world.entities) for n in (1, 2, 3)]
    assert there[0] - there[1] == {"door_west"}
    assert there[1] - there[2] == {"door_east", "lamp_middle"}


def test_crossings_of_walls_are_counted_but_not_those_of_open_doors(live: Living) -> None:
    west, middle, east = (-0.6, 0.5, 0.0), (-0.4, 0.5, 0.0), (0.6, 0.5, 0.0)
    through = [{0: west}, {0: middle}, {0: east}, {0: east}]
    world = live("labyrinth", through).world
    assert world.results["walls_crossed"] == 2.0
    assert world.results["robots_in_east"] == 1.0
    opened = live("labyrinth", through, first__time_s="0", second__time_s="0").world
    assert opened.results["walls_crossed"] == 1.0, "the east door is farther south"


def test_items_are_counted_from_the_food_to_the_nest(live: Living) -> None:
    food, nest = (1.0, 0.5, 0.0), (-1.0, -0.4, 0.0)
    ways = [{0: nest, 1: food}, {0: food}, {1: nest}, {0: nest, 1: nest}, {0: food, 1: nest}]
    counts = [dict(live("foraging", ways[: n + 1]).world.results) for n in range(len(ways))]
    assert [count["items_home"] for count in counts] == [0, 0, 1, 2, 2]
    assert [count["robots_carrying"] for count in counts] == [1, 2, 1, 0, 1]


def test_the_polluter_is_led_from_place_to_place(live: Living) -> None:
    place = f"destination_{POLLUTER}"
    far = live("pollutant-moving", standing(3, r0=(-1.4, 1.1, 0.0))).world.entities[place]
    assert isinstance(far, Zone)
    assert -1.3 <= far.x_m <= 0.5 and -0.5 <= far.y_m <= 0.5
    there = live("pollutant-moving", standing(3, r0=(far.x_m, far.y_m, 0.0)))
    assert there.world.entities[place] != far


def test_the_polluter_itself_is_not_counted(live: Living) -> None:
    cone = standing(2, r0=(0.0, 0.0, 0.0), r1=(0.5, 0.1, 0.0), r2=(-0.5, 0.0, 0.0))
    environment = live("pollutant-moving", cone)
    assert environment.world.results["robots_in_cone"] == 1.0
    assert environment.end()["robots_in_cone_mean"] == 1.0
    assert live("pollutant-moving", []).end()["robots_in_cone_mean"] == 0.0, "no timestep"


def test_prey_is_caught_once_until_it_has_rested(live: Living) -> None:
    """Robots 0 to 3 are predators, 4 to 13 prey; those that are away are together."""
    alone: dict[str, Place] = {f"r{n}": (0.1 * n - 1.4, -1.0, 0.0) for n in range(1, 4)}
    near: dict[str, Place] = {"r0": (0.0, 0.0, 0.0), "r4": (0.1, 0.0, 0.0), "r5": (0.13, 0.0, 0.0)}
    for steps, caught in ((1, 1), (3, 1), (4, 2)):
        places = standing(steps, **near, **alone)
        world = live("predator_prey", places, loop_functions__rest_s="0.3").world
        assert world.results == {"prey_caught": caught, "prey_resting": 1}


def test_a_setting_that_is_no_number_is_named(live: Living) -> None:
    with pytest.raises(VsenseError, match=r"phototaxis\.py:\d+: .*'soon'"):
        live("phototaxis", standing(1), loop_functions__turn_s="soon")
